//! The long forms of the tests that damage recordings and kill the writer.

use std::time::Instant;

use crate::shell::{cargo, run};

/// Modules of the test program `storage` whose ignored tests are long forms.
const MODULES: [&str; 2] = ["recover::", "survive::"];

/// Runs them, optimised; each says how much it did.
pub(crate) fn check() -> anyhow::Result<()> {
    for module in MODULES {
        let since = Instant::now();
        let test = ["test", "--release", "--package", "hmd", "--test", "storage"];
        run(cargo(test).args([module, "--", "--ignored", "--nocapture"]))?;
        eprintln!("== {module} {} s", since.elapsed().as_secs());
    }
    Ok(())
}
