//! What lets user-mode Linux run on processors with more register state than the kernel in it knows of.

use std::path::PathBuf;

use crate::shell::{program, run, target_dir};

/// Builds the library that is preloaded into the guest's kernel, as it says itself.
pub(crate) fn library() -> anyhow::Result<PathBuf> {
    let library = target_dir()?.join("guest_state.so");
    run(program(
        "cc",
        [
            "-shared",
            "-fPIC",
            "-O2",
            "-Wall",
            "-Werror",
            "xtask/src/guest_state.c",
            "-o",
        ],
    )
    .arg(&library))?;
    Ok(library)
}
