//! The shipped unit under `systemd-analyze`: every directive understood, and no more exposed than promised.

use std::fs;
use std::path::Path;

use anyhow::{Context, ensure};

use crate::programs::Programs;
use crate::shell::{program, root, run, succeeds, target_dir};

/// What each variant adds to the unit, and the highest exposure that is accepted, in tenths.
const VARIANTS: [(&str, Option<&str>, &str); 3] = [
    ("CAN only", None, "11"),
    ("with serial ports", Some("serial.conf"), "15"),
    ("with HTTP", Some("http.conf"), "18"),
];

/// Checks all variants.
pub(crate) fn check() -> anyhow::Result<()> {
    install()?;
    let hmd = Programs::build()?.hmd();
    let folder = target_dir()?.join("systemd");
    for (name, variant, threshold) in VARIANTS {
        eprintln!("{name}:");
        let _ = fs::remove_dir_all(&folder);
        let units = folder.join("etc/systemd/system");
        fs::create_dir_all(units.join("hmd.service.d"))?;
        let unit = fs::read_to_string(root().join("dist/systemd/hmd.service"))?;
        // The program must be there to be verified.
        let unit = unit.replace("/usr/lib/hmd/hmd", &hmd.display().to_string());
        fs::write(units.join("hmd.service"), unit)?;
        if let Some(variant) = variant {
            let from = root().join("dist/systemd/variants").join(variant);
            fs::copy(&from, units.join("hmd.service.d").join(variant)).with_context(|| from.display().to_string())?;
        }
        verify(&units.join("hmd.service"))?;
        let exposure = ["security", "--offline=true", "--no-pager", "--quiet"];
        let mut security = program("systemd-analyze", exposure);
        security.arg(format!("--root={}", folder.display()));
        security.arg(format!("--threshold={threshold}")).arg("hmd.service");
        let output = security.output().context("systemd-analyze")?;
        let text = String::from_utf8_lossy(&output.stdout);
        let last = text.lines().last().unwrap_or_default();
        eprintln!("  {last}");
        ensure!(
            output.status.success() && last.contains("exposure level"),
            "{name}: expected an exposure of at most {threshold} tenths, found {last:?}"
        );
    }
    Ok(())
}

/// `verify` says what it does not understand, and succeeds all the same.
fn verify(unit: &Path) -> anyhow::Result<()> {
    let mut verify = program("systemd-analyze", ["verify", "--man=no", "--recursive-errors=no"]);
    let output = verify.arg(unit).output().context("systemd-analyze")?;
    let text = String::from_utf8_lossy(&output.stderr);
    // The manager of a computer without systemd has no units of its own to order the unit by.
    let unit_lines: Vec<_> = text.lines().filter(|line| line.contains("hmd.service")).collect();
    ensure!(
        output.status.success() && unit_lines.is_empty(),
        "systemd-analyze verify: {}",
        text.trim()
    );
    Ok(())
}

/// Installs systemd, as root on Debian; else says what to install.
fn install() -> anyhow::Result<()> {
    let there = || succeeds(program("systemd-analyze", ["--version"]));
    if there() {
        return Ok(());
    }
    let may = succeeds(program("sh", ["-c", "test $(id -u) = 0 && command -v apt-get"]));
    ensure!(
        may,
        "expected systemd-analyze of the Debian package systemd; not installed here"
    );
    run(program("apt-get", ["update", "-qq"]))?;
    let install = ["install", "-qq", "--yes", "--no-install-recommends", "systemd"];
    run(program("apt-get", install).env("DEBIAN_FRONTEND", "noninteractive"))?;
    ensure!(there(), "expected systemd-analyze after its installation");
    Ok(())
}
