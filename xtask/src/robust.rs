//! Suite `robust` in a small form: some of its entries on every built-in type, one healthy and two faulty windows of each unit; and the tests of
//! commissioned units that take too long for each `cargo test`.

use std::fs;

use anyhow::{Context, ensure};
use serde_json::Value;

use crate::programs::Programs;
use crate::shell::{cargo, program, run, run_to_file, target_dir};

/// Entries of the catalogue, at least one of each family of effects.
const ENTRIES: [&str; 7] = [
    "dead_time",
    "tolerances",
    "stribeck",
    "spring",
    "current_offsets",
    "sample_jitter",
    "shorted_turns",
];

/// Aims of the whole suite at 2 kHz; besides, no healthy window of these entries names a fault.
const JUDGED_MIN: f64 = 0.98;
const NAMED_MIN: f64 = 0.95;
const MEDIAN_ERROR_MAX: f64 = 0.02;
const COVERAGE_MIN: f64 = 0.9;

/// Where long forms are, and what their names begin with. With the whole workspace, what `cargo test --workspace` built serves.
const LONG_FORMS: [[&str; 3]; 2] = [["--test", "program", ""], ["--lib", "evaluate::sensors::", "--quiet"]];

/// Runs them.
pub(crate) fn check() -> anyhow::Result<()> {
    for long in LONG_FORMS {
        let words = long.into_iter().filter(|word| !word.is_empty());
        run(cargo(["test", "--workspace", "--locked"])
            .args(words)
            .args(["--", "--ignored"]))?;
    }
    let hmd = Programs::build()?.hmd();
    let output = target_dir()?.join("robust.json");
    let mut suite = program(&hmd, ["evaluate", "robust", "--json", "--n", "1"]);
    for entry in ENTRIES {
        suite.args(["--entry", entry]);
    }
    run_to_file(suite, None, &output)?;
    let report: Value = serde_json::from_str(&fs::read_to_string(&output)?).context("robust --json")?;
    let rate = |key: &str| {
        let value = report.pointer(key).and_then(Value::as_f64);
        value
            .inspect(|value| eprintln!("{key}: {value}"))
            .with_context(|| format!("expected a number at {key}"))
    };
    let count = |key: &str| {
        let value = report.pointer(key).and_then(Value::as_u64);
        value.with_context(|| format!("expected a number at {key}"))
    };
    let units = 3 * ENTRIES.len() as u64;
    ensure!(count("/units")? == units, "expected {units} units");
    rate("/before/judged_rate")?;
    rate("/before/false_fault_rate")?;
    ensure!(count("/refused")? == 0, "a commissioning was refused");
    ensure!(
        rate("/after/false_fault_rate")? <= 0.0,
        "a healthy window names a fault"
    );
    ensure!(
        rate("/after/judged_rate")? >= JUDGED_MIN,
        "expected {JUDGED_MIN} judged"
    );
    ensure!(rate("/after/named_rate")? >= NAMED_MIN, "expected {NAMED_MIN} named");
    let error = rate("/after/median_error")?;
    ensure!(
        error <= MEDIAN_ERROR_MAX,
        "expected a median error of {MEDIAN_ERROR_MAX}"
    );
    ensure!(
        rate("/after/coverage_95")? >= COVERAGE_MIN,
        "expected 95 % intervals to hold {COVERAGE_MIN} of the truths"
    );
    Ok(())
}
