//! Our forecasts beside those of NASA's `progpy` on the same histories; the table stands in `fixtures/results/progpy.md`.

use std::fs;

use anyhow::Context;

use crate::python::Python;
use crate::shell::{cargo, program, root, run_to_file, target_dir};

/// The version that the table was made with.
const PACKAGES: [&str; 1] = ["progpy==1.9.0"];

/// Histories of each fault, and the seed of the suite.
const HISTORIES: [&str; 2] = ["10", "1"];

const DOCUMENT: &str = "fixtures/results/progpy.md";
const BEGIN: &str = "<!-- $ cargo xtask progpy -->\n";
const END: &str = "<!-- end -->";

/// Draws the histories, lets both predict them, and puts the scores in place.
pub(crate) fn compare() -> anyhow::Result<()> {
    let python = Python::with_packages(&PACKAGES)?;
    let folder = target_dir()?.join("progpy");
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let [histories, forecasts, table] =
        ["histories.jsonl", "forecasts.jsonl", "table.md"].map(|name| folder.join(name));
    let example = |verb| {
        let mut command = cargo([
            "run",
            "--quiet",
            "--release",
            "--package",
            "hmd-tests",
            "--example",
            "progpy",
            "--",
        ]);
        command.arg(verb).args(HISTORIES);
        command
    };
    run_to_file(example("histories"), None, &histories)?;
    let mut predict = program(python.interpreter(), ["fixtures/reference/prognosis_progpy.py"]);
    predict.arg(&histories);
    run_to_file(predict, None, &forecasts)?;
    let mut score = example("score");
    score.arg(&forecasts);
    run_to_file(score, None, &table)?;

    let document = root().join(DOCUMENT);
    let text = fs::read_to_string(&document).context(DOCUMENT)?;
    let scores = fs::read_to_string(&table).with_context(|| table.display().to_string())?;
    fs::write(&document, replaced(&text, BEGIN, &scores)?).context(DOCUMENT)
}

/// A document with this table between the line `begin` and the end mark.
pub(crate) fn replaced(text: &str, begin: &str, table: &str) -> anyhow::Result<String> {
    let (before, rest) = text
        .split_once(begin)
        .with_context(|| format!("expected {begin:?}, found none"))?;
    let (_, after) = rest
        .split_once(END)
        .with_context(|| format!("expected {END:?}, found none"))?;
    Ok(format!("{before}{begin}{table}{END}{after}"))
}
