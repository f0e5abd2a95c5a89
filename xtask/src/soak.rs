//! A day of sixteen actuators in compressed time.

use crate::shell::{cargo, run};

/// Runs so many simulated minutes; the test says what it saw, and fails when something grew or was lost.
pub(crate) fn check(minutes: u32) -> anyhow::Result<()> {
    let test = ["test", "--release", "--package", "hmd", "--test", "soak", "--"];
    let long = ["a_day", "--ignored", "--nocapture"];
    run(cargo(test).args(long).env("HMD_SOAK_MINUTES", minutes.to_string()))
}
