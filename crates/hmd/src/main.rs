//! `hmd`: health monitoring of electromechanical actuators.

#![deny(clippy::print_stdout, clippy::print_stderr)]

use std::process::ExitCode;

#[cfg(feature = "full")]
use clap::CommandFactory;
use clap::{Parser, Subcommand};
#[cfg(feature = "full")]
use hmd::commands::{bench, demo, evaluate, export, manual, map, report, simulate, top};
use hmd::commands::{calibrate, check_config, code_of, event, inspect, record, recover, replay, run, sentence, warn};

/// Health monitoring of electromechanical actuators: which part wears, how far, and how sure.
#[derive(Debug, Parser)]
#[command(
    version,
    about,
    after_help = "Examples:\n\
                  \x20 hmd demo                         see what it does, without hardware\n\
                  \x20 hmd replay flight.log            assess a recorded log\n\
                  \x20 hmd help replay                  options and examples of a verb\n\n\
                  Exit codes: 0 done, 1 failed, 2 usage, 3 finished but data were lost, 78 bad config."
)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    #[cfg(feature = "full")]
    Demo(demo::Args),
    Run(run::Args),
    Record(record::Args),
    Replay(replay::Args),
    #[cfg(feature = "full")]
    Top(top::Args),
    Recover(recover::Args),
    Event(event::Args),
    Inspect(inspect::Args),
    #[cfg(feature = "full")]
    Map(map::Args),
    #[cfg(feature = "full")]
    Report(report::Args),
    #[cfg(feature = "full")]
    Export(export::Args),
    #[cfg(feature = "full")]
    Simulate(simulate::Args),
    Calibrate(calibrate::Args),
    #[cfg(feature = "full")]
    Evaluate(evaluate::Args),
    #[cfg(feature = "full")]
    Bench(bench::Args),
    CheckConfig(check_config::Args),
    #[cfg(feature = "full")]
    Completions(manual::Completions),
    #[cfg(feature = "full")]
    Man(manual::Man),
}

fn main() -> ExitCode {
    let ended = match Cli::parse().verb {
        #[cfg(feature = "full")]
        Verb::Demo(args) => demo::run(&args),
        Verb::Run(args) => run::run(&args),
        Verb::Record(args) => record::run(&args),
        Verb::Replay(args) => replay::run(&args),
        #[cfg(feature = "full")]
        Verb::Top(args) => top::run(&args),
        Verb::Recover(args) => recover::run(&args),
        Verb::Inspect(args) => inspect::run(&args),
        #[cfg(feature = "full")]
        Verb::Map(args) => map::run(&args),
        #[cfg(feature = "full")]
        Verb::Export(args) => export::run(&args),
        #[cfg(feature = "full")]
        Verb::Report(args) => report::run(&args),
        Verb::Event(args) => event::run(&args),
        #[cfg(feature = "full")]
        Verb::Simulate(args) => simulate::run(&args),
        Verb::Calibrate(args) => calibrate::run(&args),
        #[cfg(feature = "full")]
        Verb::Evaluate(args) => evaluate::run(&args),
        #[cfg(feature = "full")]
        Verb::Bench(args) => bench::run(&args),
        Verb::CheckConfig(args) => check_config::run(&args),
        #[cfg(feature = "full")]
        Verb::Completions(args) => manual::completions(&args, Cli::command()),
        #[cfg(feature = "full")]
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Every verb shows how it is used, and every example is one that the program takes.
    #[test]
    fn every_verb_has_examples_that_parse() {
        let mut program = Cli::command();
        program.build();
        for verb in program.get_subcommands().filter(|verb| verb.get_name() != "help") {
            let help = verb.get_after_help().map(ToString::to_string).unwrap_or_default();
            let lines = help.lines().filter_map(|line| line.strip_prefix("  hmd "));
            let examples: Vec<&str> = lines.flat_map(|line| line.split(" && ")).collect();
            assert!(!examples.is_empty(), "hmd {}: no example", verb.get_name());
            let own = examples.iter().filter(|example| example.contains(verb.get_name()));
            assert!(own.count() > 0, "hmd {}: examples of others only", verb.get_name());
            for example in examples.iter().filter(|example| !example.starts_with("man ")) {
                let example = example.trim_start_matches("hmd ");
                let arguments = example.split(" > ").next().unwrap_or_default().split_whitespace();
                if let Err(error) = Cli::try_parse_from(std::iter::once("hmd").chain(arguments)) {
                    panic!("hmd {example}: {error}");
                }
            }
        }
    }
}
