//! All verbs but the tests, one after the other; the first failure ends the run.

use std::fs;
use std::process::Command;
use std::time::Instant;

use anyhow::Context;

use crate::shell::{run, target_dir};

/// In the order of what fails soonest, each with the folders under the target directory that no later verb reads: gigabytes, and
/// a computer that checks changes may have little room.
const VERBS: &[(&str, &[&str])] = &[
    ("check", &[]),
    ("no-std", &[]),
    ("docs", &["doc"]),
    ("book", &["book-pages"]),
    ("systemd", &[]),
    ("readers", &["readers"]),
    ("viewers", &["viewers"]),
    ("oracle", &[]),
    ("python", &["wheel"]),
    ("deny", &["tools"]),
    ("model", &["model"]),
    ("power-cut", &[]),
    ("target", &[]),
    ("firmware", &["firmware"]),
    ("can", &[]),
];

/// What the next build of a changed source would read; no verb changes any.
const INCREMENTAL: [&str; 2] = ["debug/incremental", "release/incremental"];

/// Runs them, with a heading and the seconds each took.
pub(crate) fn run_all() -> anyhow::Result<()> {
    let this = std::env::current_exe().context("path of this program")?;
    let target = target_dir()?;
    let mut table = Vec::new();
    for (verb, left) in VERBS {
        eprintln!("\n== xtask {verb}");
        let since = Instant::now();
        run(Command::new(&this).arg(*verb))?;
        for folder in left.iter().copied().chain(INCREMENTAL) {
            let folder = target.join(folder);
            if folder.exists() {
                fs::remove_dir_all(&folder).with_context(|| folder.display().to_string())?;
            }
        }
        let seconds = since.elapsed().as_secs();
        eprintln!("== xtask {verb}: {seconds} s");
        table.push(format!("{verb} {seconds} s"));
    }
    eprintln!("\nall good: {}", table.join(", "));
    Ok(())
}
