//! Gives the linker the memory map of the board.

use std::{env, fs, io, path::Path};

fn main() -> io::Result<()> {
    println!("cargo::rerun-if-changed=memory.x");
    let Some(out) = env::var_os("OUT_DIR") else {
        return Err(io::Error::other("expected OUT_DIR from cargo"));
    };
    fs::copy("memory.x", Path::new(&out).join("memory.x"))?;
    println!("cargo::rustc-link-search={}", Path::new(&out).display());
    Ok(())
}
