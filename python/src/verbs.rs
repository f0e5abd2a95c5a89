//! Verbs of the program, their arguments checked by the command's own parser.

use std::ffi::OsString;

use clap::{Parser, Subcommand};
use hmd::commands::{Exit, calibrate, check_config, export, report, simulate};
use pyo3::prelude::*;

use crate::assessed::compute;
use crate::error::misuse;

#[derive(Debug, Parser)]
#[command(no_binary_name = true)]
struct Command {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    Calibrate(calibrate::Args),
    CheckConfig(check_config::Args),
    Export(export::Args),
    Report(report::Args),
    Simulate(simulate::Args),
}

/// Runs a verb on its own threads; what the command would write to standard output and standard error, and whether data were lost.
#[pyfunction]
pub(crate) fn run(py: Python<'_>, words: Vec<OsString>, threads: usize) -> PyResult<(String, Vec<String>, bool)> {
    let command = Command::try_parse_from(words).map_err(|error| {
        // What follows the first paragraph is help for a shell.
        let text = error.to_string();
        let paragraph: Vec<&str> = text
            .lines()
            .map(str::trim)
            .take_while(|line| !line.is_empty())
            .collect();
        misuse(paragraph.join(" ").trim_start_matches("error: "))
    })?;
    let (text, messages, exit) = compute(py, threads, move || {
        let (mut text, mut messages) = (String::new(), Vec::new());
        let mut tell = |message: &str| messages.push(message.to_owned());
        let exit = match &command.verb {
            Verb::Calibrate(args) => calibrate::run_with(args, &mut tell)?,
            Verb::CheckConfig(args) => {
                text = check_config::meaning(args, &mut tell)?;
                Exit::Done
            }
            Verb::Export(args) => export::run_with(args, &mut tell)?,
            Verb::Report(args) => report::run_with(args, &mut tell)?,
            Verb::Simulate(args) => simulate::run(args)?,
        };
        Ok((text, messages, exit))
    })?;
    Ok((text, messages, exit == Exit::DataLost))
}
