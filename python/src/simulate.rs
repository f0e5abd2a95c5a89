//! `hmd simulate`, its arguments checked by the command's own parser.

use clap::Parser;
use hmd::commands::simulate::{Args, run};
use pyo3::prelude::*;

use crate::error::{misuse, raised};

#[derive(Debug, Parser)]
struct Simulate {
    #[command(flatten)]
    args: Args,
}

/// Writes a log and its truth; takes the options as the command does.
#[pyfunction]
pub(crate) fn simulate(py: Python<'_>, options: Vec<String>) -> PyResult<()> {
    let words = std::iter::once("simulate".to_owned()).chain(options);
    let parsed = Simulate::try_parse_from(words).map_err(|error| {
        // What follows the first line is help for a shell.
        let text = error.to_string();
        let line = text.lines().next().unwrap_or_default();
        misuse(line.trim_start_matches("error: "))
    })?;
    py.detach(|| run(&parsed.args)).map_err(raised)?;
    Ok(())
}
