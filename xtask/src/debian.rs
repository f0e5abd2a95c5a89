//! Debian packages that a verb needs.

use std::path::Path;

use anyhow::ensure;

use crate::shell::{program, run, succeeds};

/// Installs what is missing, as root on Debian; else says what to install. Each package comes with a file that tells
/// whether it is there.
pub(crate) fn install(packages: &[(&str, &str)]) -> anyhow::Result<()> {
    let there = |file: &str| Path::new(file).exists() || Path::new(&file.replacen("/usr", "", 1)).exists();
    let missing = || {
        packages
            .iter()
            .filter(|(_, file)| !there(file))
            .map(|(package, _)| *package)
    };
    let wanted: Vec<_> = missing().collect();
    if wanted.is_empty() {
        return Ok(());
    }
    let may = succeeds(program("sh", ["-c", "test $(id -u) = 0 && command -v apt-get"]));
    ensure!(
        may,
        "expected the Debian packages {}; not installed here",
        wanted.join(", ")
    );
    run(program("apt-get", ["update", "-qq"]))?;
    let install = ["install", "-qq", "--yes", "--no-install-recommends"];
    run(program("apt-get", install)
        .args(&wanted)
        .env("DEBIAN_FRONTEND", "noninteractive"))?;
    let wanted: Vec<_> = missing().collect();
    ensure!(
        wanted.is_empty(),
        "installed, but not where expected: {}",
        wanted.join(", ")
    );
    Ok(())
}
