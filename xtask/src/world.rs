//! The whole daemon in a simulated world: one seed, or many for a time; and how many planted bugs it finds.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Instant;

use anyhow::{Context, bail, ensure};

use crate::shell::{cargo, program, root, run, target_dir};

const PLANTED: &str = "world/planted.toml";
const PAGE: &str = "docs/design/world.md";
/// Ends of the table in the page.
const TABLE: [&str; 2] = ["<!-- planted -->\n", "<!-- end -->"];

/// Seeds among which a planted bug must be found.
const PLANTED_SEEDS: u32 = 48;

/// Seconds after which a run with a planted bug hangs: many times what all seeds take.
const HANGS_S: &str = "900";

/// What to run; a minute without anything.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Args {
    /// One seed.
    #[arg(long, conflicts_with_all = ["hours", "minutes", "planted"])]
    seed: Option<u64>,
    /// Of that seed, these disturbances alone, by their numbers: `3,14`.
    #[arg(long, requires = "seed")]
    only: Option<String>,
    /// Many seeds, for so many hours; the first that fails is shortened.
    #[arg(long, conflicts_with_all = ["minutes", "planted"])]
    hours: Option<u64>,
    /// The same for so many minutes.
    #[arg(long, default_value_t = 1, conflicts_with = "planted")]
    minutes: u64,
    /// The first of many seeds.
    #[arg(long, default_value_t = 1)]
    first: u64,
    /// Plants each bug of `world/planted.toml` in a copy of the sources, or those whose name contains this, and puts the table of what was
    /// found into the page.
    #[arg(long, num_args = 0..=1, default_missing_value = "")]
    planted: Option<String>,
}

pub(crate) fn check(args: &Args) -> anyhow::Result<()> {
    let bugs = bugs()?;
    if let Some(wanted) = &args.planted {
        return plant(&bugs, wanted);
    }
    let mut command = cargo(["run", "--locked", "--package", "hmd-world", "--"]);
    match args.seed {
        Some(seed) => command.args(["--seed", &seed.to_string()]),
        None => {
            let seconds = args.hours.map_or(60 * args.minutes, |hours| 3600 * hours);
            command.args(["--seconds", &seconds.to_string(), "--first", &args.first.to_string()])
        }
    };
    if let Some(only) = &args.only {
        command.args(["--only", only]);
    }
    run(command)
}

struct Bug {
    name: String,
    file: String,
    old: String,
    new: String,
}

/// The bugs of the list; each must still stand once in its file.
fn bugs() -> anyhow::Result<Vec<Bug>> {
    let text = fs::read_to_string(root().join(PLANTED)).context(PLANTED)?;
    let table: toml::Table = text.parse().context(PLANTED)?;
    let listed = table.get("bug").and_then(toml::Value::as_array).context(PLANTED)?;
    let bug = |bug: &toml::Value| -> Option<Bug> {
        let field = |key| Some(bug.get(key)?.as_str()?.to_owned());
        Some(Bug {
            name: field("name")?,
            file: field("file")?,
            old: field("old")?,
            new: field("new")?,
        })
    };
    let bugs: Option<Vec<Bug>> = listed.iter().map(bug).collect();
    let bugs = bugs.context("planted.toml: expected name, file, old and new of each bug")?;
    for bug in &bugs {
        let source = fs::read_to_string(root().join(&bug.file)).with_context(|| bug.file.clone())?;
        let places = source.matches(&bug.old).count();
        ensure!(
            places == 1,
            "{PLANTED}: {}: expected one place in {}, found {places}",
            bug.name,
            bug.file
        );
    }
    Ok(bugs)
}

fn plant(bugs: &[Bug], wanted: &str) -> anyhow::Result<()> {
    let tree = target_dir()?.join("planted");
    copy_sources(&tree)?;
    let world = build(&tree)?.map_err(anyhow::Error::msg).context("without a bug")?;
    let clean = runs(&world)?;
    ensure!(clean.status.success(), "without a bug: {}", said(&clean));
    let mut rows = String::new();
    let (mut found, mut planted) = (0, 0);
    for bug in bugs.iter().filter(|bug| bug.name.contains(wanted)) {
        let place = tree.join(&bug.file);
        let before = fs::read_to_string(&place).with_context(|| bug.file.clone())?;
        fs::write(&place, before.replace(&bug.old, &bug.new))?;
        let since = Instant::now();
        let built = build(&tree)?;
        let (built_s, since) = (since.elapsed().as_secs(), Instant::now());
        let by = match built {
            Ok(world) => {
                let ended = runs(&world)?;
                (!ended.status.success()).then(|| said(&ended))
            }
            Err(error) => bail!("{}: does not compile: {error}", bug.name),
        };
        fs::write(&place, before)?;
        planted += 1;
        found += u32::from(by.is_some());
        let seconds = since.elapsed().as_secs();
        eprintln!(
            "{}: {} ({built_s} s to build, {seconds} s to run)",
            bug.name,
            by.as_deref().unwrap_or("NOT FOUND")
        );
        let by = by.map_or_else(|| "**not found**".to_owned(), |by| by.replace('|', "\\|"));
        writeln!(
            rows,
            "| {} | {} | {by} |",
            bug.name,
            bug.file.trim_start_matches("crates/")
        )?;
        if wanted.is_empty() {
            // After each: the whole list takes ten minutes or more.
            write_table(
                &format!("{found} of {planted} were found by one of {PLANTED_SEEDS} seeds."),
                &rows,
            )?;
        }
    }
    println!("{found} of {planted} planted bugs found");
    Ok(())
}

fn write_table(sentence: &str, rows: &str) -> anyhow::Result<()> {
    let path = root().join(PAGE);
    let page = fs::read_to_string(&path).context(PAGE)?;
    let place = |mark: &str| page.find(mark).with_context(|| format!("{PAGE}: expected {mark}"));
    let (begin, end) = (place(TABLE[0])? + TABLE[0].len(), place(TABLE[1])?);
    let table = format!("\n{sentence}\n\n| planted bug | where | found by |\n|---|---|---|\n{rows}\n");
    fs::write(&path, format!("{}{table}{}", &page[..begin], &page[end..])).context(PAGE)
}

/// Whatever is under version control, as it stands; files that are the same keep their time, so that little is built again.
fn copy_sources(tree: &Path) -> anyhow::Result<()> {
    let listed = program("git", ["ls-files", "-z"]).output().context("git ls-files")?;
    let listed = String::from_utf8(listed.stdout).context("git ls-files")?;
    for name in listed.split('\0').filter(|name| !name.is_empty()) {
        let (from, to) = (root().join(name), tree.join(name));
        let Ok(content) = fs::read(&from) else { continue };
        if fs::read(&to).is_ok_and(|there| there == content) {
            continue;
        }
        fs::create_dir_all(to.parent().context("a file in a folder")?)?;
        fs::write(to, content)?;
    }
    Ok(())
}

/// The world with the sources as they are now, or what the compiler says.
fn build(tree: &Path) -> anyhow::Result<Result<PathBuf, String>> {
    let target = target_dir()?;
    let mut command = cargo(["build", "--quiet", "--package", "hmd-world"]);
    // Built often and run for a minute.
    for package in ["hmd-core", "hmd-storage", "hmd-ingest", "hmd", "hmd-world"] {
        command.args(["--config", &format!("profile.dev.package.{package}.opt-level=1")]);
    }
    command.args(["--config", "profile.dev.debug=false"]);
    command
        .current_dir(tree)
        .env("CARGO_TARGET_DIR", &target)
        .env("CARGO_INCREMENTAL", "1");
    let built = command.output().context("cargo build")?;
    if !built.status.success() {
        return Ok(Err(String::from_utf8_lossy(&built.stderr).into_owned()));
    }
    // Another build may come meanwhile.
    let world = tree.join("hmd-world");
    fs::copy(target.join("debug/hmd-world"), &world).context("hmd-world")?;
    Ok(Ok(world))
}

fn runs(world: &Path) -> anyhow::Result<Output> {
    let mut command = Command::new("timeout");
    // What hangs is found, too.
    command.arg(HANGS_S).arg(world).args(["--quick", "--seconds", HANGS_S]);
    command.args(["--seeds", &PLANTED_SEEDS.to_string()]);
    command.output().context("hmd-world")
}

/// The first violation, without its numbers' places, or how it ended.
fn said(ended: &Output) -> String {
    let text = String::from_utf8_lossy(&ended.stdout);
    let first = text.lines().find_map(|line| line.strip_prefix("violation: "));
    let panicked = || {
        let text = String::from_utf8_lossy(&ended.stderr).into_owned();
        text.lines().find(|line| line.contains("panicked")).map(str::to_owned)
    };
    let short = |line: &str| line.chars().take(90).collect();
    first
        .map(short)
        .or_else(panicked)
        .unwrap_or_else(|| ended.status.to_string())
}
