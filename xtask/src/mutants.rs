//! Mutation tests of the modules that a verdict rests on, by `cargo-mutants`: one change at a time, and whether a test sees it.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

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

/// A part that a verdict rests on, and what is changed in it.
pub(crate) struct Module {
    pub(crate) name: &'static str,
    pub(crate) package: &'static str,
    /// Its sources, below the package's folder.
    pub(crate) files: &'static [&'static str],
    /// Packages whose tests are run.
    tests: &'static str,
    /// Of these tests, as `cargo test` takes it: all that touch a module whose package has slow tests of other things.
    of_tests: &'static [&'static str],
    /// One mutant in so many is tried: all of a module that takes minutes, of the others a sample.
    one_in: u32,
}

pub(crate) const MODULES: [Module; 6] = [
    Module {
        name: "wire",
        package: "ema-wire",
        files: &["src/**/*.rs"],
        tests: "ema-wire",
        of_tests: &[],
        one_in: 1,
    },
    Module {
        name: "health",
        package: "hmd-core",
        files: &["src/health.rs", "src/health/*.rs"],
        tests: "hmd-core",
        of_tests: &[],
        one_in: 1,
    },
    Module {
        name: "store",
        package: "hmd-storage",
        files: &["src/segment_store.rs", "src/segment_store/*.rs"],
        tests: "hmd-storage",
        of_tests: &["--lib", "segment_store"],
        one_in: 1,
    },
    Module {
        name: "window",
        package: "hmd-core",
        files: &["src/window.rs", "src/window/*.rs"],
        tests: "hmd-core",
        of_tests: &[],
        one_in: 16,
    },
    Module {
        name: "trend",
        package: "hmd-core",
        files: &["src/rul.rs", "src/rul/*.rs"],
        tests: "hmd-core",
        of_tests: &[],
        one_in: 16,
    },
    Module {
        name: "configuration",
        package: "hmd-core",
        files: &["src/config.rs", "src/config/*.rs"],
        tests: "hmd-core,hmd-storage",
        of_tests: &[],
        one_in: 16,
    },
];

/// Mutants that make the same program: `[[mutant]]` with a part of its `name`, and the `reason`.
const EXPLAINED: &str = "xtask/mutants.toml";
/// A page for each module, of its last run.
const PAGES: &str = "fixtures/results/mutants";

/// Times as long as the tests take without a mutant, at least 20 s: what runs longer does not end.
const TIMEOUT_MULTIPLIER: &str = "5";

/// Tries every module, or the one of this name, and writes its page.
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
            .args(["--timeout-multiplier", TIMEOUT_MULTIPLIER])
            .args(["--package", module.package])
            .args(["--test-package", module.tests])
            .args(["--shard", &format!("0/{}", module.one_in)])
            // A sample is of all files, not of the first one.
            .args(["--sharding", "round-robin"])
            // Optimising across units again takes most of the time of a build after one change.
            .args(["--cargo-arg", "--config=profile.dev.lto='off'"])
            .arg("--output")
            .arg(output.join(module.name));
        for file in module.files {
            command.arg("--file").arg(format!("crates/{}/{file}", module.package));
        }
        command.arg("--").args(module.of_tests);
        let folder = path.parent().context("folder of a tool")?.display().to_string();
        let before = std::env::var("PATH").unwrap_or_default();
        command.env("PATH", format!("{folder}:{before}"));
        // Each module is built in a copy of its own; what it depends on is built once.
        command.env("CARGO_TARGET_DIR", target_dir()?.join("mutants-build"));
        // It fails where any mutant survives.
        let ended = command.status().context("cargo mutants")?;
        ensure!(matches!(ended.code(), Some(0 | 2 | 3)), "cargo mutants: {ended}");
        write_page(module, &output)?;
    }
    Ok(())
}

/// Writes the page of a module: a row of the table, and after an empty line the mutants that no test saw.
fn write_page(module: &Module, output: &Path) -> anyhow::Result<()> {
    let outcomes = output.join(module.name).join("mutants.out/outcomes.json");
    let text = fs::read_to_string(&outcomes).with_context(|| outcomes.display().to_string())?;
    let outcomes: Value = serde_json::from_str(&text).context("outcomes.json")?;
    let count = |key: &str| outcomes[key].as_u64().unwrap_or_default();
    let (caught, missed) = (count("caught") + count("timeout"), count("missed"));
    let (explained, mut reasons, mut survivors) = (explained()?, 0, String::new());
    for name in missed_names(&outcomes) {
        let reason = explained.iter().find(|(part, _)| name.contains(part.as_str()));
        reasons += u64::from(reason.is_some());
        let reason = reason.map_or("no test", |(_, reason)| reason);
        writeln!(survivors, "- `{}`: {reason}", name.trim_start_matches("crates/"))?;
    }
    let share = 100.0 * caught as f64 / (caught + missed - reasons).max(1) as f64;
    let row = format!(
        "| {} | {} | {} | {caught} | {reasons} | {share:.1} |",
        module.name,
        share_of(module.one_in),
        caught + missed
    );
    let page = root().join(PAGES).join(format!("{}.md", module.name));
    fs::write(&page, format!("{row}\n\n{survivors}")).with_context(|| page.display().to_string())
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
