//! A report of a whole wear-out in headless Chromium: pictures, no console message, no request, accessible.

use std::fs;
use std::path::Path;

use anyhow::Context;

use crate::python::Python;
use crate::shell::{cargo, program, run, target_dir};

/// What drives the browser and knows the rules.
const PACKAGES: [&str; 2] = ["selenium==4.51.0", "axe-selenium-python==2.1.6"];

/// Largest report of one actuator, bytes.
const SIZE_MAX: u64 = 1 << 20;

/// Makes the report of the demo and looks at it; needs Debian's `chromium` and `chromium-driver`.
pub(crate) fn check() -> anyhow::Result<()> {
    anyhow::ensure!(
        Path::new("/usr/bin/chromedriver").exists(),
        "expected /usr/bin/chromedriver (Debian: apt-get install chromium chromium-driver), found none"
    );
    let python = Python::with_packages(&PACKAGES)?;
    let folder = target_dir()?.join("report");
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    run(cargo(["build", "--quiet", "--release", "--package", "hmd"]))?;
    let hmd = target_dir()?.join("release/hmd");
    let [life, page] = ["life.mcap", "ema0.html"].map(|name| folder.join(name));
    run(program(&hmd, ["demo", "-o"]).arg(&life))?;
    run(program(&hmd, ["report", "-o"]).arg(&page).arg(&life))?;
    let size = fs::metadata(&page).with_context(|| page.display().to_string())?.len();
    anyhow::ensure!(size < SIZE_MAX, "expected less than {SIZE_MAX} bytes, found {size}");
    python.script("fixtures/check_report.py", &[&page, &folder])
}
