//! The dated copy of the advisory database, `xtask/advisories.toml`, for where the database itself cannot be reached.

use std::collections::BTreeSet;
use std::fs;

use anyhow::{Context, bail};
use semver::{Version, VersionReq};
use serde::Deserialize;

use crate::shell::root;

/// Advisories of RustSec for the packages of a lock file, as they stood on a day.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DatedCopy {
    /// Day on which it was taken.
    taken: String,
    /// Packages that were looked up, those without an advisory included.
    looked_up: BTreeSet<String>,
    advisory: Vec<Advisory>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Advisory {
    id: String,
    package: String,
    date: String,
    /// What it tells of that is no vulnerability: `unmaintained`, `unsound`, `notice`.
    informational: Option<String>,
    /// Day on which it was taken back.
    withdrawn: Option<String>,
    patched: Vec<VersionReq>,
    unaffected: Vec<VersionReq>,
}

impl Advisory {
    fn is_of(&self, package: &Package) -> bool {
        let is_met = |requirements: &[VersionReq]| requirements.iter().any(|wanted| wanted.matches(&package.version));
        self.withdrawn.is_none() && self.package == package.name && !is_met(&self.patched) && !is_met(&self.unaffected)
    }
}

#[derive(Deserialize)]
struct Lock {
    package: Vec<Package>,
}

#[derive(Deserialize)]
struct Package {
    name: String,
    version: Version,
    /// None: a package of the workspace.
    source: Option<String>,
}

#[derive(Deserialize)]
struct Rules {
    advisories: Ignored,
}

#[derive(Deserialize)]
struct Ignored {
    ignore: Vec<Exception>,
}

#[derive(Deserialize)]
struct Exception {
    id: String,
}

/// Compares `Cargo.lock` with the copy; an advisory that `deny.toml` ignores is no finding.
///
/// # Errors
/// A package with an advisory.
pub(crate) fn check_copy() -> anyhow::Result<()> {
    let copy: DatedCopy = parse("xtask/advisories.toml")?;
    let lock: Lock = parse("Cargo.lock")?;
    let rules: Rules = parse("deny.toml")?;
    println!("{}", checked(&copy, &lock, &rules)?);
    Ok(())
}

fn parse<T: for<'de> Deserialize<'de>>(path: &str) -> anyhow::Result<T> {
    let text = fs::read_to_string(root().join(path)).with_context(|| path.to_owned())?;
    toml::from_str(&text).with_context(|| path.to_owned())
}

/// What was compared, in one line.
fn checked(copy: &DatedCopy, lock: &Lock, rules: &Rules) -> anyhow::Result<String> {
    let packages: Vec<&Package> = lock.package.iter().filter(|package| package.source.is_some()).collect();
    let unknown: Vec<&str> = packages
        .iter()
        .map(|package| package.name.as_str())
        .filter(|&name| !copy.looked_up.contains(name))
        .collect();
    let is_ignored = |id: &str| rules.advisories.ignore.iter().any(|exception| exception.id == id);
    let mut found = Vec::new();
    for advisory in copy.advisory.iter().filter(|advisory| !is_ignored(&advisory.id)) {
        for package in packages.iter().filter(|package| advisory.is_of(package)) {
            let kind = advisory.informational.as_deref().unwrap_or("vulnerability");
            found.push(format!(
                "{} {}: {} ({kind})",
                package.name, package.version, advisory.id
            ));
        }
    }
    if !found.is_empty() {
        bail!("expected no advisory, found {}", found.join("; "));
    }
    let newest = copy.advisory.iter().map(|advisory| advisory.date.as_str()).max();
    let mut line = format!(
        "advisories: {} packages compared with a copy of {} ({} advisories, the newest of {})",
        packages.len() - unknown.len(),
        copy.taken,
        copy.advisory.len(),
        newest.unwrap_or("no day"),
    );
    if !unknown.is_empty() {
        line += &format!("; {} were not looked up for it: {}", unknown.len(), unknown.join(" "));
    }
    Ok(line)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn result(version: &str, advisory: &str, ignored: &str) -> anyhow::Result<String> {
        let copy = format!(
            "taken = \"2026-01-02\"\nlooked_up = [\"a\"]\n[[advisory]]\nid = \"RUSTSEC-2026-0001\"\npackage = \"a\"\ndate = \"2026-01-01\"\n{advisory}"
        );
        let lock = format!(
            "[[package]]\nname = \"ours\"\nversion = \"0.1.0\"\n[[package]]\nname = \"a\"\nversion = \"{version}\"\nsource = \"registry\""
        );
        let rules = format!("[advisories]\nignore = [{ignored}]");
        checked(
            &toml::from_str(&copy).unwrap(),
            &toml::from_str(&lock).unwrap(),
            &toml::from_str(&rules).unwrap(),
        )
    }

    #[test]
    fn a_version_that_is_neither_patched_nor_unaffected_is_found() {
        let advisory = "patched = [\">= 1.2.3\", \"^0.9.5\"]\nunaffected = [\"< 0.4\"]";
        for version in ["1.2.3", "2.0.0", "0.9.5", "0.3.9"] {
            let line = result(version, advisory, "").unwrap();
            assert!(line.contains("1 packages compared with a copy of 2026-01-02"), "{line}");
        }
        for version in ["1.2.2", "0.9.4", "0.4.0", "0.10.0"] {
            let error = result(version, advisory, "").unwrap_err().to_string();
            let expected = format!("a {version}: RUSTSEC-2026-0001 (vulnerability)");
            assert!(error.contains(&expected), "{error}");
        }
    }

    #[test]
    fn exceptions_and_what_was_taken_back_are_no_findings() {
        let unmaintained = "informational = \"unmaintained\"\npatched = []\nunaffected = []";
        let error = result("1.0.0", unmaintained, "").unwrap_err().to_string();
        assert!(error.contains("(unmaintained)"), "{error}");
        let ignored = "{ id = \"RUSTSEC-2026-0001\", reason = \"a reason\" }";
        assert!(result("1.0.0", unmaintained, ignored).is_ok());
        let withdrawn = "withdrawn = \"2026-01-02\"\npatched = []\nunaffected = []";
        assert!(result("1.0.0", withdrawn, "").is_ok());
    }

    #[test]
    fn a_package_that_was_not_looked_up_is_told() {
        let copy: DatedCopy = toml::from_str("taken = \"2026-01-02\"\nlooked_up = []\nadvisory = []").unwrap();
        let lock = "[[package]]\nname = \"b\"\nversion = \"1.0.0\"\nsource = \"registry\"";
        let rules = toml::from_str("[advisories]\nignore = []").unwrap();
        let line = checked(&copy, &toml::from_str(lock).unwrap(), &rules).unwrap();
        assert!(line.starts_with("advisories: 0 packages compared"), "{line}");
        assert!(line.ends_with("; 1 were not looked up for it: b"), "{line}");
    }
}
