//! `hmd`: health monitoring of electromechanical actuators.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};
use hmd::commands::{
    bench, calibrate, check_config, code_of, demo, evaluate, event, export, inspect, manual, record, recover, replay,
    report, run, sentence, simulate, top, warn,
};

/// Health monitoring of electromechanical actuators: which part wears, how far, and how sure.
#[derive(Debug, Parser)]
#[command(
    version,
    about,
    after_help = "Exit codes: 0 done, 1 failed, 2 usage, 3 finished but data were lost, 78 bad config."
)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    Demo(demo::Args),
    Run(run::Args),
    Record(record::Args),
    Replay(replay::Args),
    Top(top::Args),
    Recover(recover::Args),
    Event(event::Args),
    Inspect(inspect::Args),
    Report(report::Args),
    Export(export::Args),
    Simulate(simulate::Args),
    Calibrate(calibrate::Args),
    Evaluate(evaluate::Args),
    Bench(bench::Args),
    CheckConfig(check_config::Args),
    Completions(manual::Completions),
    Man(manual::Man),
}

fn main() -> ExitCode {
    let ended = match Cli::parse().verb {
        Verb::Demo(args) => demo::run(&args),
        Verb::Run(args) => run::run(&args),
        Verb::Record(args) => record::run(&args),
        Verb::Replay(args) => replay::run(&args),
        Verb::Top(args) => top::run(&args),
        Verb::Recover(args) => recover::run(&args),
        Verb::Inspect(args) => inspect::run(&args),
        Verb::Export(args) => export::run(&args),
        Verb::Report(args) => report::run(&args),
        Verb::Event(args) => event::run(&args),
        Verb::Simulate(args) => simulate::run(&args),
        Verb::Calibrate(args) => calibrate::run(&args),
        Verb::Evaluate(args) => evaluate::run(&args),
        Verb::Bench(args) => bench::run(&args),
        Verb::CheckConfig(args) => check_config::run(&args),
        Verb::Completions(args) => manual::completions(&args, Cli::command()),
        Verb::Man(args) => manual::man(&args, Cli::command()),
    };
    match ended {
        Ok(exit) => ExitCode::from(exit as u8),
        Err(error) => {
            warn(format_args!("hmd: {}", sentence(&error)));
            ExitCode::from(code_of(&error))
        }
    }
}
