//! What the flight build of `hmd` contains: none of what only the ground needs.

use anyhow::{Context, ensure};

use crate::dist::Build;
use crate::shell::{cargo, run};

/// Crates that no aircraft needs.
const GROUND: [&str; 6] = ["hmd-lab", "hmd-report", "ratatui", "clap_mangen", "parquet", "csv-core"];

/// Features of crates that do fly, as `cargo tree` prints them.
const GROUND_FEATURES: [&str; 1] = ["ema-models feature \"reference\""];

/// Asks cargo's resolution of its normal dependencies, and lints the build itself: in the workspace all features are on.
///
/// # Errors
/// One of them is in it, or it does not compile without a warning.
pub(crate) fn check() -> anyhow::Result<()> {
    let crates = tree("normal")?;
    for name in GROUND {
        let found = crates.lines().find(|line| line.split(' ').next() == Some(name));
        ensure!(found.is_none(), "flight build: expected no {name}, found it");
    }
    let features = tree("features,normal")?;
    for feature in GROUND_FEATURES {
        ensure!(
            !features.contains(feature),
            "flight build: expected no {feature}, found it"
        );
    }
    let mut clippy = cargo(["clippy", "--quiet", "--package", "hmd"]);
    clippy.args(Build::Flight.features()).args(["--", "-D", "warnings"]);
    run(clippy)
}

fn tree(edges: &str) -> anyhow::Result<String> {
    let tree = [
        "tree",
        "--quiet",
        "--locked",
        "--package",
        "hmd",
        "--prefix",
        "none",
        "--edges",
        edges,
    ];
    let output = cargo(tree)
        .args(Build::Flight.features())
        .output()
        .context("cargo tree")?;
    ensure!(output.status.success(), "cargo tree: {}", output.status);
    let output = String::from_utf8(output.stdout).context("cargo tree")?;
    ensure!(
        output.contains("hmd-core"),
        "cargo tree: expected hmd-core below hmd, found none"
    );
    Ok(output)
}
