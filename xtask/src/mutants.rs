//! Mutation tests of the modules that a verdict rests on, by `cargo-mutants`: one change at a time, and whether a test sees it.

use std::fmt::Write as _;
use std::fs;

use anyhow::{Context, ensure};
use serde_json::Value;

use crate::shell::{cargo, root, target_dir};
use crate::tools::Tool;

const CARGO_MUTANTS: Tool = Tool {
    krate: "cargo-mutants",
    version: "27.1.0",
    program: "cargo-mutants",
    options: &[],
};

/// What is changed.
struct Module {
    name: &'static str,
    package: &'static str,
    /// Its sources, below the package's folder.
    files: &'static [&'static str],
    /// One mutant in so many is tried: all of a module that takes minutes, of the others a sample.
    one_in: u32,
}

const MODULES: [Module; 6] = [
    Module {
        name: "wire",
        package: "ema-wire",
        files: &["src/**/*.rs"],
        one_in: 1,
    },
    Module {
        name: "health",
        package: "hmd-core",
        files: &["src/health.rs", "src/health/*.rs"],
        one_in: 1,
    },
    Module {
        name: "store",
        package: "hmd-storage",
        files: &["src/segment_store.rs", "src/segment_store/*.rs"],
        one_in: 1,
    },
    Module {
        name: "window",
        package: "hmd-core",
        files: &["src/window.rs", "src/window/*.rs"],
        one_in: 8,
    },
    Module {
        name: "trend",
        package: "hmd-core",
        files: &["src/rul.rs", "src/rul/*.rs"],
        one_in: 8,
    },
    Module {
        name: "configuration",
        package: "hmd-core",
        files: &["src/config.rs", "src/config/*.rs"],
        one_in: 8,
    },
];

/// Mutants that make the same program: `[[mutant]]` with a part of its `name`, and the `reason`.
const EXPLAINED: &str = "xtask/mutants.toml";
const PAGE: &str = "fixtures/results/mutants.md";

/// Seconds that all tests of a mutant may take: several times what they do.
const TIMEOUT_S: &str = "300";

/// Tries every module, or the one of this name, and writes the page from the last run of each.
pub(crate) fn check(wanted: Option<&str>) -> anyhow::Result<()> {
    ensure!(
        wanted.is_none_or(|wanted| MODULES.iter().any(|module| module.name == wanted)),
        "expected one of {:?}",
        MODULES.map(|module| module.name)
    );
    let path = CARGO_MUTANTS.path()?;
    let output = target_dir()?.join("mutants");
    fs::create_dir_all(&output).context("target/mutants")?;
    for module in MODULES
        .iter()
        .filter(|module| wanted.is_none_or(|wanted| module.name == wanted))
    {
        let mut command = cargo(["mutants", "--jobs", "1", "--colors", "never", "--no-shuffle"]);
        command
            .args(["--timeout", TIMEOUT_S, "--package", module.package])
            .args(["--shard", &format!("0/{}", module.one_in)])
            .arg("--output")
            .arg(output.join(module.name));
        for file in module.files {
            command.arg("--file").arg(format!("crates/{}/{file}", module.package));
        }
        let folder = path.parent().context("folder of a tool")?.display().to_string();
        let before = std::env::var("PATH").unwrap_or_default();
        command.env("PATH", format!("{folder}:{before}"));
        // It fails where any mutant survives.
        let ended = command.status().context("cargo mutants")?;
        ensure!(matches!(ended.code(), Some(0 | 2 | 3)), "cargo mutants: {ended}");
    }
    let explained = explained()?;
    let (mut rows, mut survivors) = (String::new(), String::new());
    for module in &MODULES {
        let outcomes = output.join(module.name).join("mutants.out/outcomes.json");
        let Ok(text) = fs::read_to_string(&outcomes) else {
            writeln!(rows, "| {} | not run | | | |", module.name)?;
            continue;
        };
        let outcomes: Value = serde_json::from_str(&text).context("outcomes.json")?;
        let count = |key: &str| outcomes[key].as_u64().unwrap_or_default();
        let (caught, missed) = (count("caught") + count("timeout"), count("missed"));
        let mut reasons = 0;
        for name in missed_names(&outcomes) {
            let reason = explained.iter().find(|(part, _)| name.contains(part.as_str()));
            reasons += u64::from(reason.is_some());
            let reason = reason.map_or("no test", |(_, reason)| reason);
            writeln!(survivors, "- `{}`: {reason}", name.trim_start_matches("crates/"))?;
        }
        let share = 100.0 * caught as f64 / (caught + missed - reasons).max(1) as f64;
        writeln!(
            rows,
            "| {} | {} | {} | {caught} | {reasons} | {share:.1} |",
            module.name,
            share_of(module.one_in),
            caught + missed
        )?;
    }
    let page = format!(
        "| module | mutants | tried | seen by a test | the same program | seen of the others, % |\n|---|---|---|---|---|---|\n{rows}\n\
         Not seen:\n\n{survivors}"
    );
    fs::write(root().join(PAGE), page).context(PAGE)
}

fn share_of(one_in: u32) -> String {
    if one_in == 1 {
        "all".to_owned()
    } else {
        format!("one in {one_in}")
    }
}

/// Names of the mutants that no test saw.
fn missed_names(outcomes: &Value) -> Vec<&str> {
    let all = outcomes["outcomes"].as_array().map(Vec::as_slice).unwrap_or_default();
    all.iter()
        .filter(|outcome| outcome["summary"] == "MissedMutant")
        .filter_map(|outcome| outcome["scenario"]["Mutant"]["name"].as_str())
        .collect()
}

fn explained() -> anyhow::Result<Vec<(String, String)>> {
    let text = fs::read_to_string(root().join(EXPLAINED)).context(EXPLAINED)?;
    let table: toml::Table = text.parse().context(EXPLAINED)?;
    let listed = table.get("mutant").and_then(toml::Value::as_array).context(EXPLAINED)?;
    let field = |entry: &toml::Value, key: &str| Some(entry.get(key)?.as_str()?.to_owned());
    let pairs = listed
        .iter()
        .map(|entry| Some((field(entry, "name")?, field(entry, "reason")?)));
    pairs
        .collect::<Option<_>>()
        .context("mutants.toml: expected name and reason of each mutant")
}
