//! Coverage-guided fuzzing of every reader, with `cargo-fuzz` and a nightly compiler.

use std::fs;

use anyhow::{Context, ensure};

use crate::shell::{program, root, run, succeeds, target_dir};

/// Version that is installed where there is none.
const VERSION: &str = "0.13.2";

/// Targets of `fuzz/targets`, each with a file that its reader takes, to begin with.
const TARGETS: [(&str, Option<&str>); 5] = [
    ("can", None),
    ("serial", None),
    ("config", Some("fixtures/hmd.toml")),
    ("candump", None),
    ("mcap", Some("fixtures/logs/backlash-low.mcap")),
];

/// Seconds of each target in the short form, which finds what is broken outright.
const SHORT_S: u32 = 20;
/// Seconds of each target in the long form.
const LONG_S: u32 = 1800;

/// Longest input, bytes; the files to begin with fit.
const INPUT_MAX: u32 = 1 << 16;
/// Most memory of one run, MiB: a record, its content and the sanitiser's own.
const MEMORY_MIB: u32 = 1024;
/// Longest single run, s.
const RUN_S: u32 = 10;

/// Runs every target for its time; a crash, a hang or too much memory ends the verb.
pub(crate) fn check(long: bool) -> anyhow::Result<()> {
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
    let seconds = if long { LONG_S } else { SHORT_S };
    let path = std::env::var("PATH").unwrap_or_default();
    let path = format!("{}:{path}", tools.join("bin").display());
    for (target, seed) in TARGETS {
        // What earlier runs found stays there, for the next to begin with.
        let corpus = target_dir()?.join("fuzz").join(target);
        fs::create_dir_all(&corpus).with_context(|| corpus.display().to_string())?;
        if let Some(seed) = seed {
            fs::copy(root().join(seed), corpus.join("seed")).with_context(|| seed.to_owned())?;
        }
        let mut fuzz = program("cargo", ["+nightly", "fuzz", "run", target]);
        fuzz.arg(&corpus)
            .arg("--")
            .arg(format!("-max_total_time={seconds}"))
            .arg(format!("-max_len={INPUT_MAX}"))
            .arg(format!("-rss_limit_mb={MEMORY_MIB}"))
            .arg(format!("-timeout={RUN_S}"))
            .arg("-print_final_stats=1")
            .env("PATH", &path)
            // The toolchain of this workspace must not override the one asked for.
            .env_remove("RUSTUP_TOOLCHAIN")
            .env_remove("CARGO");
        run(fuzz)?;
    }
    Ok(())
}
