//! Changes of the library crates that break their users, by `cargo-semver-checks`.

use crate::package::CRATES;
use crate::shell::{program, root, run};
use crate::tools::Tool;

const SEMVER_CHECKS: Tool = Tool {
    krate: "cargo-semver-checks",
    version: "0.51.0",
    program: "cargo-semver-checks",
    options: &[],
};

/// Compares what the library crates offer with a revision: whether their version is high enough for what changed since.
pub(crate) fn check(since: &str) -> anyhow::Result<()> {
    let packages = CRATES.iter().flat_map(|name| ["--package", name]);
    let compare = [
        "semver-checks",
        "check-release",
        "--all-features",
        "--baseline-rev",
        since,
    ];
    let mut command = program(SEMVER_CHECKS.path()?, compare);
    run(command.args(packages).current_dir(root()))
}
