//! All verbs but the tests, one after the other; the first failure ends the run.

use std::fs;
use std::process::Command;
use std::time::Instant;

use anyhow::Context;

use crate::shell::{run, target_dir};

/// In the order of what fails soonest, each with the folder under the target directory that no later verb reads: hundreds of
/// megabytes, and a computer that checks changes may have little room.
const VERBS: &[(&str, Option<&str>)] = &[
    ("check", None),
    ("no-std", None),
    ("docs", Some("doc")),
    ("book", Some("book-pages")),
    ("systemd", None),
    ("readers", Some("readers")),
    ("viewers", Some("viewers")),
    ("oracle", None),
    ("python", Some("wheel")),
    ("deny", Some("tools")),
    ("model", Some("model")),
    ("power-cut", None),
    ("target", None),
    ("firmware", Some("firmware")),
    ("can", None),
];

/// Runs them, with a heading and the seconds each took.
pub(crate) fn run_all() -> anyhow::Result<()> {
    let this = std::env::current_exe().context("path of this program")?;
    let target = target_dir()?;
    let mut table = Vec::new();
    for &(verb, left) in VERBS {
        eprintln!("\n== xtask {verb}");
        let since = Instant::now();
        run(Command::new(&this).arg(verb))?;
        if let Some(folder) = left {
            let folder = target.join(folder);
            fs::remove_dir_all(&folder).with_context(|| folder.display().to_string())?;
        }
        let seconds = since.elapsed().as_secs();
        eprintln!("== xtask {verb}: {seconds} s");
        table.push(format!("{verb} {seconds} s"));
    }
    eprintln!("\nall good: {}", table.join(", "));
    Ok(())
}
