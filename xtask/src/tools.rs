//! Programs from crates.io, built under the target directory where they are missing.

use std::fs;
use std::path::PathBuf;

use anyhow::Context;

use crate::shell::{cargo, run, target_dir};

/// A program of a crate, of this very version.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tool {
    /// The crate.
    pub(crate) krate: &'static str,
    /// Its version.
    pub(crate) version: &'static str,
    /// The program.
    pub(crate) program: &'static str,
    /// Further arguments of `cargo install`.
    pub(crate) options: &'static [&'static str],
}

impl Tool {
    /// Where it is, after it was built if need be.
    ///
    /// # Errors
    /// No network, or it cannot be built.
    pub(crate) fn path(&self) -> anyhow::Result<PathBuf> {
        let folder = target_dir()?.join("tools");
        // A root of its own for each version: another version is another program.
        let root = folder.join(format!("{}-{}", self.krate, self.version));
        let path = root.join("bin").join(self.program);
        if !path.is_file() {
            // Unoptimised: it takes a minute to build instead of three, and a second to run.
            let install = ["install", self.krate, "--version", self.version, "--locked", "--debug"];
            let build = folder.join("build");
            run(cargo(install)
                .args(self.options)
                .arg("--root")
                .arg(&root)
                .env("CARGO_TARGET_DIR", &build))?;
            // Gigabytes that nothing reads again.
            fs::remove_dir_all(&build).with_context(|| build.display().to_string())?;
        }
        Ok(path)
    }
}
