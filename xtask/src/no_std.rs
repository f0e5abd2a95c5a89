//! Each no_std crate alone: in a build of the whole workspace another crate switches its `std` feature on.

use crate::shell::{cargo, program, run};

const CRATES: [&str; 5] = ["ema-models", "ema-ga", "ema-wire", "firmware_sim", "firmware_image"];

/// A Cortex-M7 with double-precision floating point.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// Lints them without features, for the host and for the target. Their code for the target is generated and linked by the verbs
/// `target` and `firmware`, whose images hold all of them.
pub(crate) fn check() -> anyhow::Result<()> {
    // rustup installs nothing that is already there.
    run(program("rustup", ["target", "add", TARGET]))?;
    for target in [&[] as &[&str], &["--target", TARGET]] {
        for name in CRATES {
            let alone = ["clippy", "--quiet", "--package", name, "--no-default-features"];
            run(cargo(alone).args(target).args(["--", "-D", "warnings"]))?;
        }
    }
    Ok(())
}
