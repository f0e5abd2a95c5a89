//! Mutation tests of the modules that a verdict rests on: one change at a time, and whether a test sees it.
//!
//! `cargo-mutants` lists the changes. They are built all at once into one copy of the sources and switched on one by one
//! ([`switched`]), which takes minutes where a build for each takes hours.

mod copy;
mod run;
mod switched;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;

use anyhow::{Context, ensure};
use serde_json::Value;

use crate::shell::{cargo, root, target_dir};
use crate::tools::Tool;
use copy::Copy;
use run::{Outcome, Run, Seen};
use switched::Mutant;

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
    /// Packages whose tests are run, unit tests and `tests`.
    tests: &'static [&'static str],
    /// Parts of the paths of these tests, all without any: those of the module itself, where its package has slow tests of other things.
    of_tests: &'static [&'static str],
    /// Parts of the paths of tests that are left out: those with random inputs, whose outcome is another each time, and the slowest.
    but_tests: &'static [&'static str],
    /// One mutant in so many is tried, evenly over the files.
    one_in: usize,
}

pub(crate) const MODULES: [Module; 6] = [
    Module {
        name: "wire",
        package: "ema-wire",
        files: &["src/**/*.rs"],
        tests: &["ema-wire"],
        of_tests: &[],
        but_tests: &[],
        one_in: 1,
    },
    Module {
        name: "health",
        package: "hmd-core",
        files: &["src/health.rs", "src/health/*.rs"],
        tests: &["hmd-core"],
        of_tests: &["health"],
        but_tests: &[],
        one_in: 1,
    },
    Module {
        name: "store",
        package: "hmd-storage",
        files: &["src/segment_store.rs", "src/segment_store/*.rs"],
        tests: &["hmd-storage"],
        of_tests: &["segment_store"],
        but_tests: &[],
        one_in: 4,
    },
    Module {
        name: "window",
        package: "hmd-core",
        files: &["src/window.rs", "src/window/*.rs"],
        tests: &["hmd-core"],
        of_tests: &["window"],
        but_tests: &["window_properties", "no_genuine_dynamics", "every_profile"],
        one_in: 6,
    },
    Module {
        name: "trend",
        package: "hmd-core",
        files: &["src/rul.rs", "src/rul/*.rs"],
        tests: &["hmd-core"],
        of_tests: &["rul"],
        but_tests: &[],
        one_in: 6,
    },
    Module {
        name: "configuration",
        package: "hmd-core",
        files: &["src/config.rs", "src/config/*.rs"],
        tests: &["hmd-core", "hmd-storage"],
        of_tests: &["config"],
        but_tests: &[],
        one_in: 6,
    },
];

/// Mutants that make the same program: `[[mutant]]` with a part of its `name`, and the `reason`.
const EXPLAINED: &str = "xtask/mutants.toml";
/// A page for each module, of its last run.
const PAGES: &str = "fixtures/results/mutants";

/// Tries every module, or the one of this name, and writes its page; to iterate, no mutant that a test saw before.
pub(crate) fn check(wanted: Option<&str>, iterate: bool) -> anyhow::Result<()> {
    ensure!(
        wanted.is_none_or(|wanted| MODULES.iter().any(|module| module.name == wanted)),
        "expected one of {:?}",
        MODULES.map(|module| module.name)
    );
    for module in MODULES
        .iter()
        .filter(|module| wanted.is_none_or(|wanted| module.name == wanted))
    {
        let listed = listed(module)?;
        let all = listed.len();
        let mutants: BTreeMap<usize, Mutant> = (1..).zip(listed).step_by(module.one_in).collect();
        let copy = Copy::of_sources(&target_dir()?.join("mutants"))?;
        let built = copy.built(module, &mutants)?;
        let seen = target_dir()?.join(format!("mutants-seen-{}.txt", module.name));
        let seen = Seen::kept_in(&seen, iterate)?;
        let outcomes = Run::new(built, module, &mutants)?.outcomes(seen)?;
        write_page(module, all, &mutants, &outcomes)?;
    }
    Ok(())
}

/// The changes to a module.
fn listed(module: &Module) -> anyhow::Result<Vec<Mutant>> {
    let path = CARGO_MUTANTS.path()?;
    let mut command = cargo(["mutants", "--list", "--json", "--package", module.package]);
    for file in module.files {
        command.arg("--file").arg(format!("crates/{}/{file}", module.package));
    }
    let folder = path.parent().context("folder of a tool")?.display().to_string();
    let before = std::env::var("PATH").unwrap_or_default();
    command.env("PATH", format!("{folder}:{before}"));
    let output = command.output().context("cargo mutants")?;
    ensure!(
        output.status.success(),
        "cargo mutants: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    let listed: Vec<Value> = serde_json::from_slice(&output.stdout).context("cargo mutants --list")?;
    let read = |entry: &Value| Mutant::read(entry).with_context(|| format!("cargo mutants --list: {entry}"));
    listed.iter().map(read).collect()
}

/// Writes the page of a module: a row of the table, and after an empty line the mutants that no test saw.
fn write_page(
    module: &Module,
    all: usize,
    mutants: &BTreeMap<usize, Mutant>,
    outcomes: &BTreeMap<usize, Outcome>,
) -> anyhow::Result<()> {
    let (explained, mut reasons, mut survivors) = (explained()?, 0, String::new());
    let missed = outcomes.iter().filter(|(_, outcome)| **outcome == Outcome::Missed);
    for mutant in missed.filter_map(|(number, _)| mutants.get(number)) {
        let reason = explained.iter().find(|(part, _)| mutant.name.contains(part.as_str()));
        reasons += 1 - usize::from(reason.is_none());
        let reason = reason.map_or("no test", |(_, reason)| reason);
        writeln!(survivors, "- `{}`: {reason}", mutant.name.trim_start_matches("crates/"))?;
    }
    let caught = outcomes.values().filter(|outcome| **outcome == Outcome::Caught).count();
    let share = 100.0 * caught as f64 / (outcomes.len() - reasons).max(1) as f64;
    let row = format!(
        "| {} | {} | {} | {caught} | {reasons} | {share:.1} |",
        module.name,
        share_of(module.one_in, all),
        outcomes.len()
    );
    let page = root().join(PAGES).join(format!("{}.md", module.name));
    fs::write(&page, format!("{row}\n\n{survivors}")).with_context(|| page.display().to_string())
}

fn share_of(one_in: usize, all: usize) -> String {
    if one_in == 1 {
        format!("all {all}")
    } else {
        format!("one in {one_in} of {all}")
    }
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
