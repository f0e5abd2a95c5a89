//! What the program is made of, in the words of CycloneDX 1.5: every crate that is linked into it, from cargo's own resolution.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context, ensure};
use serde_json::{Value, json};

use crate::shell::cargo;

/// Writes the bill of materials of `hmd` for a target.
pub(crate) fn write(target: &str, path: &Path) -> anyhow::Result<()> {
    let metadata = [
        "metadata",
        "--locked",
        "--format-version",
        "1",
        "--filter-platform",
        target,
    ];
    let output = cargo(metadata).output().context("cargo metadata")?;
    ensure!(output.status.success(), "cargo metadata: {}", output.status);
    let metadata: Value = serde_json::from_slice(&output.stdout).context("cargo metadata")?;
    let bom = of(&metadata, target)?;
    std::fs::write(path, serde_json::to_string_pretty(&bom)? + "\n").with_context(|| path.display().to_string())
}

fn of(metadata: &Value, target: &str) -> anyhow::Result<Value> {
    let packages = by_id(&metadata["packages"]);
    let nodes = by_id(&metadata["resolve"]["nodes"]);
    let hmd = packages.iter().find(|(_, package)| package["name"] == "hmd");
    let (root, hmd) = hmd.context("expected the package hmd")?;
    let (mut linked, mut waiting) = (BTreeMap::new(), vec![*root]);
    while let Some(id) = waiting.pop() {
        if linked.contains_key(id) {
            continue;
        }
        let node = nodes.get(id).with_context(|| id.to_owned())?;
        let needs: BTreeSet<&str> = list(&node["deps"])
            .filter(|dep| list(&dep["dep_kinds"]).any(|kind| kind["kind"].is_null()))
            .filter_map(|dep| dep["pkg"].as_str())
            .collect();
        waiting.extend(&needs);
        linked.insert(id, needs);
    }
    let component = |id: &str, kind: &str| -> anyhow::Result<Value> {
        let package = packages.get(id).with_context(|| id.to_owned())?;
        let reference = reference(package);
        let mut component = json!({
            "type": kind, "bom-ref": reference, "name": package["name"], "version": package["version"], "purl": reference,
        });
        if let Some(license) = package["license"].as_str() {
            // Old crates write a slash for a choice.
            component["licenses"] = json!([{ "expression": license.replace('/', " OR ") }]);
        }
        Ok(component)
    };
    let others = linked.keys().filter(|id| *id != root);
    let components: Vec<Value> = others.map(|id| component(id, "library")).collect::<Result<_, _>>()?;
    let dependencies = linked.iter().map(|(id, needs)| {
        let needs: Vec<_> = needs.iter().map(|id| reference(packages[*id])).collect();
        json!({ "ref": reference(packages[*id]), "dependsOn": needs })
    });
    ensure!(!components.is_empty(), "expected crates below {}", hmd["name"]);
    Ok(json!({
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "component": component(root, "application")?,
            "properties": [{ "name": "target", "value": target }],
        },
        "components": components,
        "dependencies": dependencies.collect::<Vec<_>>(),
    }))
}

fn by_id(values: &Value) -> BTreeMap<&str, &Value> {
    list(values)
        .filter_map(|value| Some((value["id"].as_str()?, value)))
        .collect()
}

fn list(values: &Value) -> impl Iterator<Item = &Value> {
    values.as_array().into_iter().flatten()
}

/// A package URL.
fn reference(package: &Value) -> String {
    let text = |key: &str| package[key].as_str().unwrap_or_default();
    format!("pkg:cargo/{}@{}", text("name"), text("version"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_linked_is_listed_and_nothing_else() {
        let package = |id: &str| json!({ "id": id, "name": id, "version": "1.0.0", "license": "MIT/Apache-2.0" });
        let dep = |id: &str, kind: Value| json!({ "pkg": id, "dep_kinds": [{ "kind": kind }] });
        let metadata = json!({
            "packages": [package("hmd"), package("a"), package("b"), package("test")],
            "resolve": { "nodes": [
                { "id": "hmd", "deps": [dep("a", Value::Null), dep("test", json!("dev"))] },
                { "id": "a", "deps": [dep("b", Value::Null)] },
                { "id": "b", "deps": [] },
                { "id": "test", "deps": [] },
            ] },
        });
        let bom = of(&metadata, "any").unwrap();
        let names: Vec<_> = list(&bom["components"])
            .map(|of| of["name"].as_str().unwrap())
            .collect();
        assert_eq!(names, ["a", "b"]);
        assert_eq!(bom["components"][0]["licenses"][0]["expression"], "MIT OR Apache-2.0");
        assert_eq!(
            bom["dependencies"][2],
            json!({ "ref": "pkg:cargo/hmd@1.0.0", "dependsOn": ["pkg:cargo/a@1.0.0"] })
        );
    }
}
