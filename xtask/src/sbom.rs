//! What the program is made of, in the words of CycloneDX 1.5: every crate that is linked into it.
//!
//! From `cargo tree`, which resolves the features of one build. `cargo-cyclonedx` asks `cargo metadata`, which joins the features of
//! the whole workspace: the flight build's list would name what only the ground needs.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context, ensure};
use serde_json::{Value, json};

use crate::dist::Build;
use crate::shell::cargo;

/// Writes the bill of materials of a build of `hmd` for a target.
pub(crate) fn write(target: &str, kind: Build, path: &Path) -> anyhow::Result<()> {
    let tree = [
        "tree",
        "--quiet",
        "--locked",
        "--package",
        "hmd",
        "--edges",
        "normal",
        "--prefix",
        "depth",
    ];
    let output = cargo(tree)
        .args(["--format", "|{p}|{l}", "--target", target])
        .args(kind.features())
        .output()
        .context("cargo tree")?;
    ensure!(output.status.success(), "cargo tree: {}", output.status);
    let bom = bill(&String::from_utf8(output.stdout)?, target).context("cargo tree")?;
    std::fs::write(path, serde_json::to_string_pretty(&bom)? + "\n").with_context(|| path.display().to_string())
}

/// Lines are `DEPTH|NAME vVERSION …|LICENCE`, the program first, what a crate needs one deeper behind it.
fn bill(tree: &str, target: &str) -> anyhow::Result<Value> {
    let (mut components, mut needs) = (BTreeMap::new(), BTreeMap::<String, BTreeSet<String>>::new());
    let mut above: Vec<String> = Vec::new();
    for line in tree.lines() {
        let mut parts = line.split('|');
        let mut part = || {
            parts
                .next()
                .with_context(|| format!("expected DEPTH|PACKAGE|LICENCE, found {line}"))
        };
        let (depth, package, license) = (part()?.parse()?, part()?, part()?);
        let (name, version) = package.split_once(" v").with_context(|| package.to_owned())?;
        let version = version.split(' ').next().unwrap_or(version);
        let reference = format!("pkg:cargo/{name}@{version}");
        above.truncate(depth);
        if let Some(parent) = above.last() {
            needs.entry(parent.clone()).or_default().insert(reference.clone());
        }
        above.push(reference.clone());
        let kind = if depth == 0 { "application" } else { "library" };
        let mut component = json!({
            "type": kind, "bom-ref": reference, "name": name, "version": version, "purl": reference,
        });
        // Behind the licence of a crate that stands in the tree twice is an asterisk.
        let license = license.trim_end_matches(" (*)");
        if !license.is_empty() {
            // Old crates write a slash for a choice.
            component["licenses"] = json!([{ "expression": license.replace('/', " OR ") }]);
        }
        needs.entry(reference.clone()).or_default();
        components.insert(reference, component);
    }
    let root = above.first().and_then(|root| components.remove(root));
    let root = root.context("expected the program, found nothing")?;
    ensure!(!components.is_empty(), "expected crates below the program");
    let dependencies = needs.iter().map(|(of, on)| json!({ "ref": of, "dependsOn": on }));
    Ok(json!({
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": { "component": root, "properties": [{ "name": "target", "value": target }] },
        "components": components.values().collect::<Vec<_>>(),
        "dependencies": dependencies.collect::<Vec<_>>(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_linked_is_listed_and_nothing_else() {
        let tree = "0|hmd v0.1.0 (/hmd)|MIT\n1|a v1.0.0 (proc-macro)|MIT/Apache-2.0\n2|b v1.0.0|\n1|b v1.0.0|\n\
                    1|a v1.0.0 (proc-macro)|MIT/Apache-2.0 (*)\n";
        let bom = bill(tree, "any").unwrap();
        let names = |key: &str, of: &str| -> Vec<String> {
            let list = bom[key].as_array().unwrap().iter();
            list.map(|one| one[of].as_str().unwrap().to_owned()).collect()
        };
        assert_eq!(names("components", "name"), ["a", "b"]);
        assert_eq!(bom["metadata"]["component"]["name"], "hmd");
        assert_eq!(bom["components"][0]["licenses"][0]["expression"], "MIT OR Apache-2.0");
        assert_eq!(
            bom["dependencies"][2],
            json!({ "ref": "pkg:cargo/hmd@0.1.0", "dependsOn": ["pkg:cargo/a@1.0.0", "pkg:cargo/b@1.0.0"] })
        );
        assert!(bill("", "any").is_err());
    }
}
