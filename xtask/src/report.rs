//! Headless Chromium: a report of a whole wear-out (pictures, no console message, no request, accessible), and live data that no page of another
//! origin gets.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;

use crate::programs::Programs;
use crate::python::Python;
use crate::shell::{program, run, target_dir};
use crate::wheel::{self, Profile};

/// What drives the browser and knows the rules.
const PACKAGES: [&str; 2] = ["selenium==4.51.0", "axe-selenium-python==2.1.6"];

/// Largest report of one actuator, bytes.
const SIZE_MAX: u64 = 1 << 20;

/// Days on which each unit of the fleet is watched.
const DAYS: u32 = 10;

/// Makes the report of the demo and that of a fleet, and looks at them; needs Debian's `chromium` and `chromium-driver`.
pub(crate) fn check() -> anyhow::Result<()> {
    anyhow::ensure!(
        Path::new("/usr/bin/chromedriver").exists(),
        "expected /usr/bin/chromedriver (Debian: apt-get install chromium chromium-driver), found none"
    );
    let python = Python::with_packages(&PACKAGES)?;
    let folder = target_dir()?.join("report");
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let hmd = Programs::build()?.hmd();
    let [life, page] = ["life.mcap", "ema0.html"].map(|name| folder.join(name));
    run(program(&hmd, ["demo", "-o"]).arg(&life))?;
    run(program(&hmd, ["report", "-o"]).arg(&page).arg(&life))?;
    let size = fs::metadata(&page).with_context(|| page.display().to_string())?.len();
    anyhow::ensure!(size < SIZE_MAX, "expected less than {SIZE_MAX} bytes, found {size}");
    python.script("fixtures/check_report.py", &[&page, &folder])?;
    python.script("fixtures/check_origins.py", &[&hmd, &life, &folder.join("origins")])?;
    let page = fleet_page(&hmd, &folder.join("fleet"))?;
    python.script("fixtures/check_report.py", &[&page, &folder.join("fleet")])
}

/// The report of a small fleet: a unit whose friction grows, one that is like new, and a log that is none.
fn fleet_page(hmd: &Path, folder: &Path) -> anyhow::Result<PathBuf> {
    let python = wheel::installed(Profile::Dev)?;
    let _ = fs::remove_dir_all(folder);
    let [logs, out] = ["logs", "out"].map(|name| folder.join(name));
    for (unit, growth) in [("growing", 0.05), ("new", 0.0)] {
        let unit = logs.join(unit);
        fs::create_dir_all(&unit).with_context(|| unit.display().to_string())?;
        for day in 0..DAYS {
            let log = unit.join(format!("day-{day}.log"));
            let fault = format!("friction={}", growth * f64::from(day));
            let start = format!("2026-11-{:02}T08:00Z", day + 1);
            let options = ["simulate", "--rate", "400", "--fault", &fault, "--start", &start, "-o"];
            run(program(hmd, options).arg(&log))?;
        }
    }
    fs::write(logs.join("empty.log"), "")?;
    let fleet = program(python.interpreter(), ["-m", "hmd.fleet", "--workers", "0", "-o"])
        .arg(&out)
        .arg(&logs)
        .status()
        .context("hmd.fleet")?;
    // Because of the log that is none.
    anyhow::ensure!(
        fleet.code() == Some(3),
        "hmd.fleet: expected exit code 3, found {fleet}"
    );
    Ok(out.join("report.html"))
}
