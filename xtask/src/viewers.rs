//! A viewer that nobody here wrote the transport of, beside `hmd replay --serve` and `hmd run --serve`.

use std::fs;

use anyhow::Context;

use crate::python::Python;
use crate::shell::{cargo, program, run, target_dir};

/// What the viewer is made of.
const PACKAGES: [&str; 3] = ["websockets==17.4", "mcap==1.6.0", "mcap-protobuf-support==0.6.0"];

/// Lints and tests of the feature, then the viewer.
pub(crate) fn check() -> anyhow::Result<()> {
    let with_it = ["--package", "hmd", "--features", "serve"];
    run(cargo(["clippy", "--all-targets"])
        .args(with_it)
        .args(["--", "--deny", "warnings"]))?;
    run(cargo(["test", "--lib"]).args(with_it).args(["--", "serve::"]))?;
    let python = Python::with_packages(&PACKAGES)?;
    let folder = target_dir()?.join("viewers");
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    run(cargo(["build", "--quiet", "--package", "firmware_sim"]))?;
    run(cargo(["build", "--quiet"]).args(with_it))?;
    // Other verbs build and run the one without the feature, in the same place.
    let [built, hmd] = [target_dir()?.join("debug/hmd"), folder.join("hmd")];
    fs::copy(&built, &hmd).with_context(|| built.display().to_string())?;
    let firmware = target_dir()?.join("debug/firmware_sim");
    let log = folder.join("life.log");
    let options = ["simulate", "--rate", "400", "--noise", "0.05", "--windows", "5", "-o"];
    run(program(&hmd, options).arg(&log))?;
    python.script("fixtures/check_viewers.py", &[&hmd, &firmware, &log, &folder])
}
