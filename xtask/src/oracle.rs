//! The reference beside the drive model of `motulator`, and the logs of an actuator that this drive moves; see `docs/oracles.md`.

use crate::programs::Programs;
use crate::python::Python;
use crate::shell::{program, run_to_file, target_dir};

/// The version that the bounds in the scripts were measured with.
const PACKAGES: [&str; 1] = ["motulator==0.5.0"];

/// Compares the healthy motor with motulator's machine, then makes the logs of the whole actuator and compares these.
pub(crate) fn check() -> anyhow::Result<()> {
    let python = Python::with_packages(&PACKAGES)?;
    let programs = Programs::build()?;

    let recorded = target_dir()?.join("oracle.csv");
    run_to_file(program(programs.example("oracle"), [] as [&str; 0]), None, &recorded)?;
    python.script("fixtures/reference/oracle_motulator.py", &[&recorded])?;

    let logs = target_dir()?.join("oracle");
    python.script("fixtures/reference/motulator_logs.py", &[&logs])?;
    python.script("fixtures/reference/oracle_actuator.py", &[&logs, &programs.hmd()])
}
