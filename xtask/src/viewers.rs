//! A viewer that nobody here wrote the transport of, beside `hmd replay --serve` and `hmd run --serve`.

use std::fs;

use anyhow::Context;

use crate::programs::Programs;
use crate::python::Python;
use crate::shell::{program, run, target_dir};

/// What the viewer is made of.
const PACKAGES: [&str; 3] = ["websockets==17.4", "mcap==1.6.0", "mcap-protobuf-support==0.6.0"];

/// Lets the viewer compare what it is sent with what is recorded.
pub(crate) fn check() -> anyhow::Result<()> {
    let programs = Programs::build()?;
    let python = Python::with_packages(&PACKAGES)?;
    let folder = target_dir()?.join("viewers");
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let (hmd, firmware) = (programs.hmd(), programs.firmware_sim());
    let log = folder.join("life.log");
    let options = ["simulate", "--rate", "400", "--noise", "0.05", "--windows", "5", "-o"];
    run(program(&hmd, options).arg(&log))?;
    python.script("fixtures/check_viewers.py", &[&hmd, &firmware, &log, &folder])
}
