//! Sixteen actuators: a day in compressed time, and a minute of the program itself in real time.

use crate::shell::{cargo, run};

/// Runs so many simulated minutes; the test says what it saw, and fails when something grew or was lost.
pub(crate) fn check(minutes: u32) -> anyhow::Result<()> {
    let test = ["test", "--release", "--package", "hmd", "--test", "soak", "--"];
    // One after the other: one is measured in real time.
    let long = ["--ignored", "--nocapture", "--test-threads=1"];
    run(cargo(test)
        .args(long)
        .env("HMD_SOAK_MINUTES", minutes.to_string())
        // As the unit has it.
        .env("MALLOC_ARENA_MAX", "1")
        .env("MALLOC_MMAP_THRESHOLD_", "131072"))
}
