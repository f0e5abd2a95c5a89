//! Coverage-guided fuzzing of every reader, with `cargo-fuzz` and a nightly compiler.

use std::fs::{self, File};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};

use anyhow::{Context, ensure};

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
/// Seconds, and runs, after which each target has had enough in the long form.
const LONG_S: u32 = 1800;
/// See [`LONG_S`].
const LONG_RUNS: u32 = 10_000_000;

/// Most memory of one run, MiB: a record, its content and the sanitiser's own.
const MEMORY_MIB: u32 = 1024;
/// Longest single run, s.
const RUN_S: u32 = 10;

/// Runs all targets beside each other for their time; a crash, a hang or too much memory fails the verb.
pub(crate) fn check(long: bool) -> anyhow::Result<()> {
    let fuzz = Fuzz::install()?;
    run(fuzz.cargo(["build"]))?;
    let mut running = Vec::new();
    for target in &TARGETS {
        running.push((target.name, fuzz.start(target, long)?));
    }
    let mut failed = Vec::new();
    for (target, (mut child, log)) in running {
        let status = child.wait().with_context(|| target.to_owned())?;
        let text = fs::read_to_string(&log).with_context(|| log.display().to_string())?;
        let statistic = |key: &str| {
            text.lines()
                .find_map(|line| line.strip_prefix(key))
                .unwrap_or("?")
                .trim()
        };
        let (runs, peak) = (
            statistic("stat::number_of_executed_units:"),
            statistic("stat::peak_rss_mb:"),
        );
        println!("{target}: {runs} runs, at most {peak} MiB, {status}");
        if !status.success() {
            failed.push(log.display().to_string());
        }
    }
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
}

impl Fuzz {
    fn install() -> anyhow::Result<Self> {
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
        Ok(Self { tools })
    }

    fn cargo<const N: usize>(&self, args: [&str; N]) -> Command {
        let path = std::env::var("PATH").unwrap_or_default();
        let path = format!("{}:{path}", self.tools.join("bin").display());
        let mut command = program("cargo", ["+nightly", "fuzz"]);
        command
            .args(args)
            .env("PATH", &path)
            // The toolchain of this workspace must not override the one asked for.
            .env_remove("RUSTUP_TOOLCHAIN")
            .env_remove("CARGO");
        command
    }

    /// Starts a target, and tells where its words go.
    fn start(&self, target: &Target, long: bool) -> anyhow::Result<(Child, PathBuf)> {
        // What earlier runs found stays there, for the next to begin with.
        let corpus = target_dir()?.join("fuzz").join(target.name);
        fs::create_dir_all(&corpus).with_context(|| corpus.display().to_string())?;
        for (n, seed) in target.seeds.iter().enumerate() {
            fs::copy(root().join(seed), corpus.join(format!("seed{n}"))).with_context(|| (*seed).to_owned())?;
        }
        let log = corpus.with_extension("log");
        let file = File::create(&log).with_context(|| log.display().to_string())?;
        let mut command = self.cargo(["run", target.name]);
        command
            .arg(&corpus)
            .arg("--")
            .arg(format!("-max_len={}", target.longest))
            .arg(format!("-rss_limit_mb={MEMORY_MIB}"))
            .arg(format!("-timeout={RUN_S}"))
            .arg("-print_final_stats=1");
        if let Some(words) = target.dictionary {
            command.arg(format!("-dict={}", root().join(words).display()));
        }
        if long {
            command.args([format!("-max_total_time={LONG_S}"), format!("-runs={LONG_RUNS}")]);
        } else {
            command.arg(format!("-max_total_time={SHORT_S}"));
        }
        let child = command.stdout(Stdio::null()).stderr(file).spawn();
        Ok((child.with_context(|| target.name.to_owned())?, log))
    }
}
