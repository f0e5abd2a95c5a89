//! The long forms of the tests that damage recordings and kill the writer.

use std::time::Instant;

use crate::shell::{cargo, run};

/// Test programs of `hmd` whose ignored tests are long forms.
const PROGRAMS: [&str; 2] = ["recover", "survive"];

/// Runs them, optimised; each says how much it did.
pub(crate) fn check() -> anyhow::Result<()> {
    for program in PROGRAMS {
        let since = Instant::now();
        let test = ["test", "--release", "--package", "hmd", "--test", program];
        run(cargo(test).args(["--", "--ignored", "--nocapture"]))?;
        eprintln!("== {program}: {} s", since.elapsed().as_secs());
    }
    Ok(())
}
