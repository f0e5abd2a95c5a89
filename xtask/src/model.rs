//! Model checking of what runs concurrently, with `shuttle`.

use crate::shell::{cargo, run, target_dir};

/// Runs the orders; a failing one is printed so that it can be run again.
pub(crate) fn check() -> anyhow::Result<()> {
    let test = ["test", "--locked", "--manifest-path", "model/Cargo.toml"];
    run(cargo(test).env("CARGO_TARGET_DIR", target_dir()?))
}
