//! `cargo-deny` with the rules of `deny.toml`.

use crate::shell::{cargo, program, run, succeeds};
use crate::tools::Tool;

/// What is built where there is none.
const DENY: Tool = Tool {
    krate: "cargo-deny",
    version: "0.20.2",
    program: "cargo-deny",
    options: &[],
};

/// Licences, duplicates and sources, of the workspace and of the Python package. Not advisories: their database changes under a fixed commit.
pub(crate) fn check() -> anyhow::Result<()> {
    const CHECK: [&str; 4] = ["check", "licenses", "bans", "sources"];
    const PYTHON: [&str; 4] = ["--manifest-path", "python/Cargo.toml", "--config", "deny.toml"];
    if succeeds(cargo(["deny", "--version"])) {
        run(cargo(["deny"]).args(CHECK))?;
        return run(cargo(["deny"]).args(PYTHON).args(CHECK));
    }
    let deny = DENY.path()?;
    run(program(&deny, CHECK))?;
    run(program(&deny, PYTHON).args(CHECK))
}
