//! `cargo-deny` with the rules of `deny.toml`.

use crate::shell::{cargo, program, run, succeeds, target_dir};

/// Version that is installed where there is none.
const VERSION: &str = "0.20.2";

/// Licences, duplicates and sources, of the workspace and of the Python package. Not advisories: their database changes under a fixed commit.
pub(crate) fn check() -> anyhow::Result<()> {
    const CHECK: [&str; 4] = ["check", "licenses", "bans", "sources"];
    const PYTHON: [&str; 4] = ["--manifest-path", "python/Cargo.toml", "--config", "deny.toml"];
    if succeeds(cargo(["deny", "--version"])) {
        run(cargo(["deny"]).args(CHECK))?;
        return run(cargo(["deny"]).args(PYTHON).args(CHECK));
    }
    let folder = target_dir()?.join("tools");
    let deny = folder.join("bin/cargo-deny");
    if !succeeds(program(&deny, ["--version"])) {
        // Unoptimised: it takes a minute to build instead of three, and a second to run.
        let install = [
            "install",
            "cargo-deny",
            "--version",
            VERSION,
            "--locked",
            "--debug",
            "--root",
        ];
        run(cargo(install).arg(&folder))?;
    }
    run(program(&deny, CHECK))?;
    run(program(&deny, PYTHON).args(CHECK))
}
