//! The verbs that CI uses, in plain Rust, so that a fresh machine needs nothing but cargo (and Python for some of them).
//!
//! `cargo xtask VERB`; `cargo xtask ci` runs all of them but the tests, the fuzzing and the long forms.

mod advisories;
mod alerts;
mod book;
mod boot;
mod can;
mod ci;
mod circles;
mod coverage;
mod deb;
mod debian;
mod deny;
mod dist;
mod firmware;
mod fleet;
mod flight;
mod fuzz;
mod guest_state;
mod links;
mod miri;
mod model;
mod mutants;
mod no_std;
mod oracle;
mod package;
mod peers;
mod pictures;
mod power_cut;
mod progpy;
mod programs;
mod python;
mod readers;
mod report;
mod results;
mod robust;
mod sbom;
mod semver_checks;
mod shell;
mod soak;
mod survive;
mod systemd;
mod target;
mod tools;
mod viewers;
mod wheel;
mod world;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use shell::{cargo, run};

/// Checks of this workspace.
#[derive(Debug, Parser)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Clone, Subcommand)]
enum Verb {
    /// Formatting, lints as errors, import cycles, and what the flight build contains.
    Check,
    /// Modules of one crate that import each other; one such cycle is an error.
    Circles,
    /// All tests.
    Test,
    /// Each no_std crate alone, without features, for this computer and for a Cortex-M7.
    NoStd,
    /// Documentation; a broken link is an error.
    Docs,
    /// The book: built without a warning, its links followed, the commands in it run and their output compared.
    Book {
        /// Put what the commands print now into the pages.
        #[arg(long)]
        update: bool,
    },
    /// Licences, duplicate versions and sources of all dependencies.
    Deny,
    /// Readers that nobody here wrote read what hmd writes.
    Readers,
    /// A drive that nobody here wrote against the reference: the motor alone, and a whole actuator in logs that hmd reads.
    Oracle,
    /// A report, and that of a fleet, in headless Chromium: no console message, no request, accessible; with pictures.
    Report,
    /// Pictures in the documentation, in headless Chromium: demo, `hmd top`, reports.
    Pictures,
    /// A viewer beside the program: it gets what is recorded.
    Viewers,
    /// Alert rules under a real Prometheus, until a worn actuator fires one.
    Alerts,
    /// Our forecasts beside those of NASA's progpy, on the same histories.
    Progpy,
    /// Minimisers and filters by others on our windows, monitor and cost, beside our search; puts the table in place.
    Peers {
        /// Windows.
        #[arg(long, default_value_t = 40, value_parser = clap::value_parser!(u32).range(1..))]
        windows: u32,
    },
    /// The Python package: built, installed in a fresh environment, tested, its notebook run.
    Python,
    /// Two thousand logs on a local Dask cluster: one worker, four, one of them killed, and again.
    Fleet {
        /// Logs.
        #[arg(long, default_value_t = 2000)]
        logs: u32,
    },
    /// The daemon on real SocketCAN, in a user-mode Linux.
    Can,
    /// Identification on an emulated Cortex-M7, bit for bit, and what it costs.
    Target {
        /// Identify the windows of all golden logs, not of three only.
        #[arg(long)]
        all: bool,
    },
    /// Firmware on an emulated Cortex-M7, its serial port, and the daemon, until a growing fault is found.
    Firmware,
    /// Fuzzing of every reader, seconds each; needs a nightly compiler.
    Fuzz,
    /// The same without a sanitiser, ten million times each; hours.
    FuzzLong {
        /// One reader alone.
        target: Option<String>,
    },
    /// Branches of the modules that a verdict rests on, taken by tests; needs a nightly compiler.
    Coverage,
    /// Changes to the modules that a verdict rests on, one at a time: whether a test sees them.
    Mutants {
        /// One module alone.
        module: Option<String>,
        /// Only what no test saw in the last run, of which all else is kept: after tests were added.
        #[arg(long)]
        iterate: bool,
    },
    /// Undefined behaviour and byte order: unit tests of library crates in Miri, on a big-endian processor; needs a nightly compiler.
    Miri,
    /// The shipped systemd unit: understood by systemd, and hardened as promised.
    Systemd,
    /// The Debian package on a fresh Debian under a real systemd.
    Boot,
    /// Storage under kill -9, cuts and flips: the long forms.
    Survive,
    /// The power cut while the daemon writes to ext4 in a user-mode Linux.
    PowerCut {
        /// How many times; a hundred is the long form.
        #[arg(default_value_t = 5)]
        cuts: u32,
    },
    /// Sixteen actuators in compressed time: memory, descriptors, records and the disk budget.
    Soak {
        /// Simulated minutes; a day without it.
        #[arg(long, default_value_t = 1440, value_parser = clap::value_parser!(u32).range(11..))]
        minutes: u32,
    },
    /// Static release builds for x86-64 and aarch64, flight and full, each made twice and compared byte by byte.
    Dist,
    /// The Debian packages of these builds: `hmd` for flight, `hmd-tools` with manual pages and completions; both processors
    /// replay the golden logs with the same bytes.
    Deb,
    /// The library crates as they would be published, each built from its package.
    Package,
    /// What the library crates offer, compared with a revision: whether their version is high enough for what changed since.
    Semver {
        /// The last release, by its tag or commit.
        since: String,
    },
    /// Model checking of what runs concurrently.
    Model,
    /// The whole daemon in a simulated world, under disturbances from seeds; planted bugs.
    World(world::Args),
    /// The suite of units with imperfections, in a small form, with bounds.
    Robust,
    /// Runs every command whose output stands in a document, and draws the figures, again.
    Results,
    /// Everything but the tests, the fuzzing and the long forms.
    Ci {
        /// Put the seconds that each took into `docs/design/checks.md`.
        #[arg(long)]
        record: bool,
    },
}

fn main() -> ExitCode {
    let ended = match Cli::parse().verb {
        Verb::Check => check(),
        Verb::Circles => circles::check(),
        Verb::Test => run(cargo(["test", "--workspace"])),
        Verb::NoStd => no_std::check(),
        Verb::Docs => docs(),
        Verb::Book { update } => book::check(update),
        Verb::Deny => deny::check(),
        Verb::Readers => readers::check(),
        Verb::Oracle => oracle::check(),
        Verb::Report => report::check(),
        Verb::Pictures => pictures::make(),
        Verb::Robust => robust::check(),
        Verb::Viewers => viewers::check(),
        Verb::Alerts => alerts::check(),
        Verb::Progpy => progpy::compare(),
        Verb::Peers { windows } => peers::compare(windows),
        Verb::Python => wheel::check(),
        Verb::Fleet { logs } => fleet::measure(logs),
        Verb::Can => can::check(),
        Verb::Target { all } => target::check(all),
        Verb::Firmware => firmware::check(),
        Verb::Fuzz => fuzz::check(),
        Verb::FuzzLong { target } => fuzz::check_long(target.as_deref()),
        Verb::Miri => miri::check(),
        Verb::Coverage => coverage::check(),
        Verb::Mutants { module, iterate } => mutants::check(module.as_deref(), iterate),
        Verb::Systemd => systemd::check(),
        Verb::Boot => boot::check(),
        Verb::Survive => survive::check(),
        Verb::PowerCut { cuts } => power_cut::check(cuts),
        Verb::Package => package::check(),
        Verb::Semver { since } => semver_checks::check(&since),
        Verb::Model => model::check(),
        Verb::World(args) => world::check(&args),
        Verb::Dist => dist::check(),
        Verb::Deb => deb::make(),
        Verb::Soak { minutes } => soak::check(minutes),
        Verb::Results => results::update(),
        Verb::Ci { record } => ci::run_all(record),
    };
    match ended {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("xtask: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// With an example among what is documented, dependencies have the features that the verb `check` has checked them with.
fn docs() -> anyhow::Result<()> {
    let doc = ["doc", "--workspace", "--no-deps", "--lib", "--bin", "xtask"];
    run(cargo(doc)
        .args(["--example", "decode_dbc"])
        .env("RUSTDOCFLAGS", "-Dwarnings"))
}

fn check() -> anyhow::Result<()> {
    // The packages beside the workspace, whose lock files follow ours only by hand.
    for beside in ["fuzz", "model"] {
        let manifest = format!("{beside}/Cargo.toml");
        run(cargo(["tree", "--quiet", "--locked", "--depth", "0", "--manifest-path"]).arg(manifest))?;
    }
    flight::check()?;
    run(cargo(["fmt", "--all", "--", "--check"]))?;
    circles::check()?;
    run(cargo([
        "clippy",
        "--workspace",
        "--all-targets",
        "--",
        "-D",
        "warnings",
    ]))?;
    // With the packages that the line above has, so that their dependencies are not checked again.
    run(cargo([
        "clippy",
        "--workspace",
        "--features",
        "hmd-tests/study",
        "--example",
        "law",
        "--",
        "-D",
        "warnings",
    ]))
}
