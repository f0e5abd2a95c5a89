//! The healthy reference against the drive model of `motulator`; see `docs/oracles.md`.

use std::path::Path;

use crate::programs::Programs;
use crate::python::Python;
use crate::shell::{program, run_to_file, target_dir};

/// The version that the bounds in the script were measured with.
const PACKAGES: [&str; 1] = ["motulator==0.5.0"];

/// Runs both and compares.
pub(crate) fn check() -> anyhow::Result<()> {
    let python = Python::with_packages(&PACKAGES)?;
    let recorded = target_dir()?.join("oracle.csv");
    let oracle = Programs::build()?.example("oracle");
    run_to_file(program(oracle, [] as [&str; 0]), None, &recorded)?;
    python.script("fixtures/reference/oracle_motulator.py", &[Path::new(&recorded)])
}
