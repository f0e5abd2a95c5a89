//! The verbs that CI uses, in plain Rust, so that a fresh machine needs nothing but cargo (and Python for four of them).
//!
//! `cargo xtask VERB`; `cargo xtask ci` runs all of them but the tests, the fuzzing and the long forms.

mod can;
mod ci;
mod debian;
mod deny;
mod fuzz;
mod no_std;
mod oracle;
mod progpy;
mod python;
mod readers;
mod report;
mod results;
mod shell;
mod survive;
mod systemd;
mod target;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use shell::{cargo, run};

/// Checks of this workspace.
#[derive(Debug, Parser)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Clone, Copy, Subcommand)]
enum Verb {
    /// Formatting, and lints as errors.
    Check,
    /// All tests.
    Test,
    /// Each no_std crate alone, without features, for this machine and for a Cortex-M7.
    NoStd,
    /// Documentation; a broken link is an error.
    Docs,
    /// Licences, duplicate versions and sources of all dependencies.
    Deny,
    /// Readers that nobody here wrote read what hmd writes.
    Readers,
    /// A drive model that nobody here wrote against the reference.
    Oracle,
    /// A report in headless Chromium: no console message, no request, accessible; with pictures.
    Report,
    /// Our forecasts beside those of NASA's progpy, on the same histories.
    Progpy,
    /// The daemon on real SocketCAN, in a user-mode Linux.
    Can,
    /// Identification on an emulated Cortex-M7, bit for bit, and what it costs.
    Target,
    /// Fuzzing of every reader, seconds each; needs a nightly compiler.
    Fuzz,
    /// The same for half an hour each.
    FuzzLong,
    /// The shipped systemd unit: understood by systemd, and hardened as promised.
    Systemd,
    /// Storage under kill -9, cuts and flips: the long forms.
    Survive,
    /// Runs every command whose output stands in a document, and draws the figures, again.
    Results,
    /// Everything but the tests, the fuzzing and the long forms.
    Ci,
}

fn main() -> ExitCode {
    let ended = match Cli::parse().verb {
        Verb::Check => check(),
        Verb::Test => run(cargo(["test", "--workspace"])),
        Verb::NoStd => no_std::build(),
        Verb::Docs => run(cargo(["doc", "--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "-Dwarnings")),
        Verb::Deny => deny::check(),
        Verb::Readers => readers::check(),
        Verb::Oracle => oracle::check(),
        Verb::Report => report::check(),
        Verb::Progpy => progpy::compare(),
        Verb::Can => can::check(),
        Verb::Target => target::check(),
        Verb::Fuzz => fuzz::check(false),
        Verb::FuzzLong => fuzz::check(true),
        Verb::Systemd => systemd::check(),
        Verb::Survive => survive::check(),
        Verb::Results => results::update(),
        Verb::Ci => ci::run_all(),
    };
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("xtask: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn check() -> anyhow::Result<()> {
    run(cargo(["fmt", "--all", "--", "--check"]))?;
    run(cargo([
        "clippy",
        "--workspace",
        "--all-targets",
        "--",
        "-D",
        "warnings",
    ]))?;
    no_std::lint()
}
