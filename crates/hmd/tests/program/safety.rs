//! Every requirement of `docs/safety.md` names tests, and they are run.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Who runs a test.
#[derive(Debug, PartialEq, Eq)]
enum Runs {
    /// `cargo test`.
    Always,
    /// This verb of xtask, by the reason for which the test is ignored.
    Verb(String),
}

/// Looks a test up in its file by the attributes above its function; why it is none otherwise.
fn test_in(file: &str, test: &str) -> Result<Runs, String> {
    let lines: Vec<_> = file.lines().map(str::trim).collect();
    let head = format!("fn {test}(");
    let at = lines
        .iter()
        .position(|line| line.trim_start_matches("async ").starts_with(&head));
    let above = lines[..at.ok_or("there is no such function")?].iter().rev();
    let attributes: Vec<_> = above
        .take_while(|line| line.starts_with("#[") || line.starts_with("//"))
        .filter(|line| line.starts_with("#["))
        .collect();
    if !attributes.iter().any(|line| line.ends_with("test]")) {
        return Err("the function is no test".to_owned());
    }
    let Some(ignored) = attributes.iter().find(|line| line.starts_with("#[ignore")) else {
        return Ok(Runs::Always);
    };
    let verb = ignored.split_once("cargo xtask ").map(|(_, rest)| rest);
    let verb = verb.ok_or("it is ignored, and no verb of xtask is listed to run it")?;
    Ok(Runs::Verb(verb.trim_end_matches("\"]").to_owned()))
}

/// Checks one row of the requirements; what is wrong with it.
fn check(row: &str, page: &str, ci: &str) -> Result<(), String> {
    let shown_by = row.split('|').map(str::trim).nth(3).unwrap();
    let (mut file, mut is_run) = (String::new(), shown_by.contains("S-") || shown_by.contains("CAN"));
    for name in shown_by.split('`').skip(1).step_by(2) {
        if let Some(verb) = name.strip_prefix("cargo xtask ") {
            // A verb that the continuous integration runs stands for the tests that it runs.
            is_run |= ci.contains(&format!("\"{verb}\""));
            continue;
        }
        let test = match name.split_once("::") {
            Some((path, test)) => {
                file = read(path);
                test
            }
            None => name,
        };
        match test_in(&file, test).map_err(|error| format!("{test}: {error}"))? {
            Runs::Always => is_run = true,
            Runs::Verb(verb) if page.contains(&format!("`cargo xtask {verb}")) => {}
            Runs::Verb(verb) => return Err(format!("{test}: the page does not name its verb {verb}")),
        }
    }
    is_run
        .then_some(())
        .ok_or_else(|| "no test that is always run".to_owned())
}

#[test]
fn every_requirement_has_the_tests_that_it_names() {
    let (page, ci) = (read("docs/safety.md"), read("xtask/src/ci.rs"));
    let rows = page.lines().filter(|line| line.starts_with("| S-"));
    let mut numbers = Vec::new();
    for row in rows {
        let number = row.split('|').map(str::trim).nth(1).unwrap();
        numbers.push(number.trim_start_matches("S-").parse::<u32>().unwrap());
        check(row, &page, &ci).unwrap_or_else(|error| panic!("{number}: {error}"));
    }
    assert_eq!(
        numbers,
        (1..=numbers.len() as u32).collect::<Vec<_>>(),
        "numbered from 1 without gaps"
    );
    // Whoever is named by a hazard exists.
    for line in page.lines().filter(|line| line.starts_with("| H-")) {
        for part in line.split(['|', ',', ' ']).filter_map(|part| part.strip_prefix("S-")) {
            assert!(numbers.contains(&part.parse().unwrap()), "{line}");
        }
    }
}

#[test]
fn a_function_that_is_no_test_or_never_runs_is_found() {
    let file = "
        fn plain() {}
        #[test]
        fn always() {}
        /// Doc.
        #[test]
        #[ignore = \"an hour; cargo xtask soak\"]
        // Why.
        fn long() {}
        #[test]
        #[ignore = \"some day\"]
        fn never() {}
    ";
    assert!(test_in(file, "plain").is_err() && test_in(file, "never").is_err() && test_in(file, "none").is_err());
    assert_eq!(test_in(file, "always"), Ok(Runs::Always));
    assert_eq!(test_in(file, "long"), Ok(Runs::Verb("soak".to_owned())));
    let row = |cell: &str| format!("| S-1 | it holds | {cell} |");
    let long = "`crates/hmd/tests/soak.rs::a_day_grows_by_nothing_and_loses_nothing`";
    let page = "`cargo xtask soak`";
    assert!(check(&row(long), page, "").is_err(), "the long form alone");
    assert!(check(&row(&format!("{long}, `a_few_minutes_lose_nothing`")), page, "").is_ok());
    assert!(check(&row(&format!("{long}, `a_few_minutes_lose_nothing`")), "", "").is_err());
    assert!(check(&row(&format!("{long}; `cargo xtask soak`")), page, "\"soak\",").is_ok());
}
