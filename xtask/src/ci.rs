//! All verbs of the first table in `docs/design/checks.md`, one after the other; the first failure ends the run.

use std::fs;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, ensure};

use crate::shell::{root, run};

/// In the order of the table: what fails soonest first.
const VERBS: [&str; 18] = [
    "check",
    "no-std",
    "docs",
    "deny",
    "systemd",
    "oracle",
    "robust",
    "target",
    "firmware",
    "viewers",
    "alerts",
    "readers",
    "python",
    "model",
    "world",
    "power-cut",
    "book",
    "can",
];

const PAGE: &str = "docs/design/checks.md";

/// Runs them and prints the seconds that each took; with `record`, these go into the page.
pub(crate) fn run_all(record: bool) -> anyhow::Result<()> {
    let this = std::env::current_exe().context("path of this program")?;
    let mut took = Vec::new();
    for verb in VERBS {
        eprintln!("\n== xtask {verb}");
        let since = Instant::now();
        run(Command::new(&this).arg(verb))?;
        let seconds = since.elapsed().as_secs();
        eprintln!("== xtask {verb}: {seconds} s");
        took.push((verb, seconds));
    }
    eprintln!("\nseconds  verb");
    for (verb, seconds) in &took {
        eprintln!("{seconds:>7}  {verb}");
    }
    if record {
        let path = root().join(PAGE);
        let page = fs::read_to_string(&path).context(PAGE)?;
        fs::write(&path, with_seconds(&page, &took)?).context(PAGE)?;
    }
    Ok(())
}

fn with_seconds(page: &str, took: &[(&str, u64)]) -> anyhow::Result<String> {
    let mut lines: Vec<String> = page.lines().map(str::to_owned).collect();
    for (verb, seconds) in took {
        let row = format!("| `{verb}` | ");
        let mut rows = lines.iter_mut().filter(|line| line.starts_with(&row));
        let line = rows.next().with_context(|| format!("{PAGE}: expected a row {row}"))?;
        let reason = line[row.len()..].split(" | ").next().unwrap_or_default();
        *line = format!("{row}{reason} | {seconds} |");
        ensure!(rows.next().is_none(), "{PAGE}: expected one row {row}");
    }
    Ok(lines.join("\n") + "\n")
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_page_has_each_verb_once_and_those_that_run_here_in_their_order() {
        let page = fs::read_to_string(root().join(PAGE)).expect(PAGE);
        let named = |line: &str| Some(line.strip_prefix("| `")?.split_once('`')?.0.to_owned());
        let mut rows = page.lines().filter_map(named);
        assert_eq!(rows.next().as_deref(), Some("cargo test --workspace"));
        let rows: Vec<_> = rows.collect();
        assert_eq!(rows[..VERBS.len()], VERBS);
        let mut rows: Vec<_> = rows.iter().map(String::as_str).collect();
        rows.sort_unstable();
        let cli = crate::Cli::command();
        let all = cli.get_subcommands().map(clap::Command::get_name);
        let mut all: Vec<_> = all.filter(|verb| !["ci", "test"].contains(verb)).collect();
        all.sort_unstable();
        assert_eq!(rows, all);
    }

    #[test]
    fn seconds_go_into_the_row_of_the_verb() {
        let page = "# Checks\n\n| `a` | one thing | 3 |\n| `b` | another | 4 |\n";
        let expected = "# Checks\n\n| `a` | one thing | 3 |\n| `b` | another | 57 |\n";
        assert_eq!(with_seconds(page, &[("b", 57)]).expect("a page"), expected);
        assert!(with_seconds(page, &[("c", 1)]).is_err());
    }
}
