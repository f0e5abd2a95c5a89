//! All verbs but the tests, one after the other; the first failure ends the run.

use std::process::Command;
use std::time::Instant;

use anyhow::Context;

use crate::shell::run;

/// In the order of what fails soonest.
const VERBS: &[&str] = &[
    "check",
    "no-std",
    "docs",
    "book",
    "systemd",
    "readers",
    "viewers",
    "oracle",
    "python",
    "deny",
    "model",
    "power-cut",
    "target",
    "firmware",
    "can",
];

/// Runs them, with a heading and the seconds each took.
pub(crate) fn run_all() -> anyhow::Result<()> {
    let this = std::env::current_exe().context("path of this program")?;
    let mut table = Vec::new();
    for &verb in VERBS {
        eprintln!("\n== xtask {verb}");
        let since = Instant::now();
        run(Command::new(&this).arg(verb))?;
        let seconds = since.elapsed().as_secs();
        eprintln!("== xtask {verb}: {seconds} s");
        table.push(format!("{verb} {seconds} s"));
    }
    eprintln!("\nall good: {}", table.join(", "));
    Ok(())
}
