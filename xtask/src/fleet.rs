//! How long a fleet takes: figures for `docs/fleet.md`. Not a check, because it needs cores of its own.

use crate::shell::{program, run, target_dir};
use crate::wheel::{self, Profile};

/// Simulates logs and assesses them with one worker, with four, and with one of four killed.
pub(crate) fn measure(logs: u32) -> anyhow::Result<()> {
    let python = wheel::installed(Profile::Release)?;
    let place = target_dir()?.join("fleet");
    run(program(python.interpreter(), ["python/measure_fleet.py"])
        .arg(place)
        .arg(logs.to_string()))
}
