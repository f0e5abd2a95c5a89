//! Coverage-guided fuzzing of every reader, with `cargo-fuzz` and a nightly compiler.
//!
//! The short form has AddressSanitizer, all readers beside each other. The long form does without: hardly anything here is `unsafe`, the C
//! of decompressors is not instrumented, and as many runs take a fifth of the time; debug assertions and overflow checks are on in both.

use std::fs::{self, File};
use std::path::PathBuf;
use std::process::{Command, ExitStatus, Stdio};
use std::sync::Mutex;
use std::thread;

use anyhow::{Context, anyhow, ensure};

use crate::shell::{program, root, run, succeeds, target_dir};

/// Version that is installed where there is none.
const VERSION: &str = "0.13.2";

/// One of `fuzz/targets`.
struct Target {
    name: &'static str,
    /// Files that its reader takes, to begin with.
    seeds: &'static [&'static str],
    /// Words of its format, if it is text.
    dictionary: Option<&'static str>,
    /// Longest input, bytes: the files to begin with fit. What is read faster is read more often.
    longest: u32,
}

const TARGETS: [Target; 8] = [
    target("can", &[], 4 << 10),
    target("serial", &[], 4 << 10),
    Target {
        dictionary: Some("fuzz/dictionaries/config.dict"),
        ..target("config", &["fixtures/hmd.toml"], 8 << 10)
    },
    target("candump", &["fixtures/foreign/frames.log"], 4 << 10),
    target(
        "foreign",
        &[
            "fixtures/foreign/transposed.mf4",
            "fixtures/foreign/deflated.mf4",
            "fixtures/foreign/unfinalised.mf4",
            "fixtures/foreign/frames.blf",
            "fixtures/foreign/frames.asc",
        ],
        16 << 10,
    ),
    target(
        "signals",
        &[
            "fixtures/measured/samples-snappy.parquet",
            "fixtures/measured/samples-zstd.parquet",
            "fixtures/measured/samples-signals-transposed.mf4",
        ],
        32 << 10,
    ),
    Target {
        dictionary: Some("fuzz/dictionaries/dbc.dict"),
        ..target("dbc", &["fixtures/foreign.dbc"], 4 << 10)
    },
    target("mcap", &["fixtures/logs/healthy-400hz.mcap"], 32 << 10),
];

const fn target(name: &'static str, seeds: &'static [&'static str], longest: u32) -> Target {
    Target {
        name,
        seeds,
        dictionary: None,
        longest,
    }
}

/// Seconds of each target in the short form, which finds what is broken outright.
const SHORT_S: u32 = 20;
/// Runs of each target in the long form.
const LONG_RUNS: u32 = 10_000_000;
/// Seconds after which a target of the long form ends with fewer.
const LONG_S: u32 = 4 * 3600;
/// A row for each target, of its last long form.
const PAGES: &str = "fixtures/results/fuzz";

/// Most memory of one run, MiB: a record, its content and the sanitiser's own.
const MEMORY_MIB: u32 = 1024;
/// Longest single run, s.
const RUN_S: u32 = 10;

/// Runs all targets beside each other for a short time; a crash, a hang or too much memory fails the verb.
pub(crate) fn check() -> anyhow::Result<()> {
    let fuzz = Fuzz::install(&[])?;
    let all: Vec<&Target> = TARGETS.iter().collect();
    let limits = [format!("-max_total_time={SHORT_S}")];
    ended_well(fuzz.run_all(&all, TARGETS.len(), &limits)?)
}

/// Runs all targets, or the one of this name, ten million times each, as many at a time as there are processors, and writes their rows.
pub(crate) fn check_long(wanted: Option<&str>) -> anyhow::Result<()> {
    let targets: Vec<&Target> = TARGETS
        .iter()
        .filter(|target| wanted.is_none_or(|wanted| wanted == target.name))
        .collect();
    ensure!(
        !targets.is_empty(),
        "expected one of {:?}",
        TARGETS.map(|target| target.name)
    );
    fs::create_dir_all(root().join(PAGES)).context(PAGES)?;
    let fuzz = Fuzz::install(&["--sanitizer", "none"])?;
    let limits = [format!("-runs={LONG_RUNS}"), format!("-max_total_time={LONG_S}")];
    let ended = fuzz.run_all(&targets, thread::available_parallelism()?.get(), &limits)?;
    for target in ended.iter().filter(|target| target.status.success()) {
        let page = root().join(PAGES).join(format!("{}.md", target.name));
        fs::write(&page, target.row()?).with_context(|| page.display().to_string())?;
    }
    ended_well(ended)
}

/// A target that has ended.
struct Ended {
    name: &'static str,
    log: PathBuf,
    status: ExitStatus,
}

impl Ended {
    /// What libFuzzer counted.
    fn statistic(&self, key: &str) -> anyhow::Result<String> {
        let text = fs::read_to_string(&self.log).with_context(|| self.log.display().to_string())?;
        let key = format!("stat::{key}:");
        let value = text.lines().find_map(|line| line.strip_prefix(key.as_str()));
        Ok(value.unwrap_or("?").trim().to_owned())
    }

    /// Its row of the table: runs, longest run, s, and peak of memory, MiB.
    fn row(&self) -> anyhow::Result<String> {
        let [runs, slowest_s, peak_mib] =
            ["number_of_executed_units", "slowest_unit_time_sec", "peak_rss_mb"].map(|key| self.statistic(key));
        // Whole seconds, rounded down.
        Ok(format!(
            "| `{}` | {} | {} | {} |\n",
            self.name, runs?, slowest_s?, peak_mib?
        ))
    }
}

/// Says how each ended; fails if one did not end well.
fn ended_well(ended: Vec<Ended>) -> anyhow::Result<()> {
    for target in &ended {
        println!("{} {}", target.row()?.trim_end(), target.status);
    }
    let failed: Vec<String> = ended
        .iter()
        .filter(|target| !target.status.success())
        .map(|target| target.log.display().to_string())
        .collect();
    ensure!(
        failed.is_empty(),
        "expected no crash, found some: see {}",
        failed.join(", ")
    );
    Ok(())
}

/// The installed fuzzer.
struct Fuzz {
    tools: PathBuf,
    /// Options of every build.
    options: &'static [&'static str],
}

impl Fuzz {
    /// Installs it if it is not there, and builds all targets with these options.
    fn install(options: &'static [&'static str]) -> anyhow::Result<Self> {
        let nightly = succeeds(program("cargo", ["+nightly", "--version"]));
        ensure!(
            nightly,
            "expected a nightly toolchain: rustup toolchain install nightly"
        );
        let tools = target_dir()?.join("tools");
        if !succeeds(program(tools.join("bin/cargo-fuzz"), ["--version"])) {
            let install = [
                "+nightly",
                "install",
                "cargo-fuzz",
                "--version",
                VERSION,
                "--locked",
                "--debug",
                "--root",
            ];
            run(program("cargo", install).arg(&tools))?;
        }
        let fuzz = Self { tools, options };
        run(fuzz.cargo("build"))?;
        Ok(fuzz)
    }

    /// `cargo fuzz` with this verb.
    fn cargo(&self, verb: &str) -> Command {
        let path = std::env::var("PATH").unwrap_or_default();
        let path = format!("{}:{path}", self.tools.join("bin").display());
        let mut command = program("cargo", ["+nightly", "fuzz", verb]);
        command
            .args(self.options)
            .env("PATH", &path)
            // The toolchain of this workspace must not override the one asked for.
            .env_remove("RUSTUP_TOOLCHAIN")
            .env_remove("CARGO");
        command
    }

    /// Runs these targets, so many at a time, with these limits of libFuzzer.
    fn run_all(&self, targets: &[&Target], at_a_time: usize, limits: &[String]) -> anyhow::Result<Vec<Ended>> {
        let waiting = Mutex::new(targets.iter());
        let next = || waiting.lock().ok()?.next();
        thread::scope(|scope| {
            let worker = || {
                std::iter::from_fn(next)
                    .map(|target| self.run(target, limits))
                    .collect()
            };
            let workers: Vec<_> = (0..at_a_time).map(|_| scope.spawn(worker)).collect();
            let mut ended = Vec::new();
            for worker in workers {
                let of_worker: anyhow::Result<Vec<Ended>> = worker.join().map_err(|_| anyhow!("a thread panicked"))?;
                ended.extend(of_worker?);
            }
            Ok(ended)
        })
    }

    /// Runs a target; what it says goes to a log beside its corpus.
    fn run(&self, target: &Target, limits: &[String]) -> anyhow::Result<Ended> {
        // What earlier runs found stays there, for the next to begin with.
        let corpus = target_dir()?.join("fuzz").join(target.name);
        fs::create_dir_all(&corpus).with_context(|| corpus.display().to_string())?;
        for (n, seed) in target.seeds.iter().enumerate() {
            fs::copy(root().join(seed), corpus.join(format!("seed{n}"))).with_context(|| (*seed).to_owned())?;
        }
        let log = corpus.with_extension("log");
        let mut command = self.cargo("run");
        command
            .arg(target.name)
            .arg(&corpus)
            .arg("--")
            .arg(format!("-max_len={}", target.longest))
            .arg(format!("-rss_limit_mb={MEMORY_MIB}"))
            .arg(format!("-timeout={RUN_S}"))
            .arg("-print_final_stats=1")
            .args(limits);
        if let Some(words) = target.dictionary {
            command.arg(format!("-dict={}", root().join(words).display()));
        }
        let file = File::create(&log).with_context(|| log.display().to_string())?;
        let status = command.stdout(Stdio::null()).stderr(file).status();
        Ok(Ended {
            name: target.name,
            log,
            status: status.context(target.name)?,
        })
    }
}
