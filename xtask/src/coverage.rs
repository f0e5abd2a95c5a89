//! Branches of the modules that a verdict rests on, and how many the tests of their crates take.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::{Context, ensure};
use serde_json::Value;

use crate::mutants::{MODULES, Module};
use crate::shell::{program, root, run, succeeds, target_dir};
use crate::tools::Tool;

const CARGO_LLVM_COV: Tool = Tool {
    krate: "cargo-llvm-cov",
    version: "0.9.1",
    program: "cargo-llvm-cov",
    options: &[],
};

/// The page: a row for each module, and the branches that no test takes.
const PAGE: &str = "fixtures/results/coverage.md";

/// Least share of each module's branches, %.
const LEAST_PERCENT: f64 = 95.0;

/// Place of a branch in a file: its condition's first line and column, and whether it is the one taken where the condition holds.
type Branch = (u64, u64, bool);

/// Runs the tests of the modules' crates, counts branches, and writes the page.
///
/// # Errors
/// Without a nightly compiler with its LLVM tools, when a test fails, or when a module has too few branches taken.
pub(crate) fn check() -> anyhow::Result<()> {
    ensure!(
        succeeds(program("rustc", ["+nightly", "--version"])),
        "expected a nightly toolchain: rustup toolchain install nightly --component llvm-tools"
    );
    let tool = CARGO_LLVM_COV.path()?;
    let output = target_dir()?.join("coverage.json");
    let mut command = program("cargo", ["+nightly", "llvm-cov", "--branch", "--json", "--output-path"]);
    command.arg(&output);
    let packages: BTreeSet<&str> = MODULES.iter().map(|module| module.package).collect();
    command.args(packages.into_iter().flat_map(|package| ["--package", package]));
    let folder = tool.parent().context("folder of a tool")?.display().to_string();
    let before = std::env::var("PATH").unwrap_or_default();
    command
        .env("PATH", format!("{folder}:{before}"))
        .env("CARGO_TARGET_DIR", target_dir()?.join("coverage"))
        // The toolchain of this workspace must not override the one asked for.
        .env_remove("RUSTUP_TOOLCHAIN")
        .env_remove("CARGO");
    run(command)?;
    let text = fs::read_to_string(&output).with_context(|| output.display().to_string())?;
    let (page, too_few) = page(&text)?;
    fs::write(root().join(PAGE), page).context(PAGE)?;
    ensure!(
        too_few.is_empty(),
        "expected {LEAST_PERCENT} % of the branches, found fewer in {}: see {PAGE}",
        too_few.join(", ")
    );
    Ok(())
}

/// The page of an export, and the modules with too few branches taken.
fn page(export: &str) -> anyhow::Result<(String, Vec<&'static str>)> {
    let export: Value = serde_json::from_str(export).context("coverage.json")?;
    let files = export["data"][0]["files"].as_array().context("coverage.json: files")?;
    let (mut rows, mut missing, mut too_few) = (String::new(), String::new(), Vec::new());
    for module in &MODULES {
        let (mut all, mut taken) = (0, 0);
        for file in files {
            let path = file["filename"].as_str().unwrap_or_default();
            let Some(name) = path.strip_prefix(&format!("{}/crates/", root().display())) else {
                continue;
            };
            if !belongs(module, name) {
                continue;
            }
            let source = fs::read_to_string(path).with_context(|| path.to_owned())?;
            let branches = branches(file, lines_before_tests(&source));
            all += branches.len();
            taken += branches.values().filter(|taken| **taken).count();
            for ((line, column, holds), _) in branches.iter().filter(|(_, taken)| !**taken) {
                let condition = source.lines().nth(*line as usize - 1).unwrap_or_default().trim();
                writeln!(missing, "- `{name}:{line}:{column}` never {holds}: `{condition}`")?;
            }
        }
        let percent = 100.0 * taken as f64 / all.max(1) as f64;
        writeln!(rows, "| {} | {all} | {taken} | {percent:.1} |", module.name)?;
        if percent < LEAST_PERCENT {
            too_few.push(module.name);
        }
    }
    let head = "| module | branches | taken by a test | % |\n|---|---|---|---|\n";
    Ok((format!("{head}{rows}\nNot taken:\n\n{missing}"), too_few))
}

/// Whether a file, below `crates`, is a source of the module and none of its tests.
fn belongs(module: &Module, name: &str) -> bool {
    let Some(inner) = name.strip_prefix(&format!("{}/", module.package)) else {
        return false;
    };
    let tests = Path::new(inner)
        .iter()
        .any(|part| part == "tests" || part == "tests.rs");
    let named = |file: &&str| match file.split_once('*') {
        Some((folder, _)) => inner.starts_with(folder),
        None => inner == *file,
    };
    !tests && module.files.iter().any(named)
}

/// How many lines stand before the module of unit tests at the end of a source.
fn lines_before_tests(source: &str) -> u64 {
    source.lines().take_while(|line| *line != "#[cfg(test)]").count() as u64
}

/// The branches of a file up to a line, and whether one of the compiled forms of its function takes each.
fn branches(file: &Value, last_line: u64) -> BTreeMap<Branch, bool> {
    let mut branches = BTreeMap::new();
    for branch in file["branches"].as_array().into_iter().flatten() {
        let number = |n: usize| branch[n].as_u64().unwrap_or_default();
        let (line, column) = (number(0), number(1));
        if line > last_line {
            continue;
        }
        for (holds, count) in [(true, number(4)), (false, number(5))] {
            *branches.entry((line, column, holds)).or_insert(false) |= count > 0;
        }
    }
    branches
}
