//! Each no_std crate alone: in a build of the whole workspace another crate switches its `std` feature on.

use crate::shell::{cargo, program, run};

const CRATES: [&str; 5] = ["ema-models", "ema-ga", "ema-wire", "firmware_sim", "firmware_image"];

/// A Cortex-M7 with double-precision floating point.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// Builds them for the host and for the target.
pub(crate) fn build() -> anyhow::Result<()> {
    // rustup installs nothing that is already there.
    run(program("rustup", ["target", "add", TARGET]))?;
    for name in CRATES {
        run(cargo(["build", "--package", name, "--no-default-features"]))?;
        run(cargo([
            "build",
            "--package",
            name,
            "--no-default-features",
            "--target",
            TARGET,
        ]))?;
    }
    Ok(())
}

/// Lints them without features.
pub(crate) fn lint() -> anyhow::Result<()> {
    for name in CRATES {
        run(cargo([
            "clippy",
            "--package",
            name,
            "--no-default-features",
            "--",
            "-D",
            "warnings",
        ]))?;
    }
    Ok(())
}
