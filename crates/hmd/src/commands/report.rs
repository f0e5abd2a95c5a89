//! `hmd report`: one page about one actuator.

use std::path::PathBuf;

use anyhow::Context;

use super::outputs::Outputs;
use super::{Exit, Losses};
use hmd_report::report::{Files, page};
use hmd_storage::output_file;

/// Write a report of an actuator: one HTML file that needs nothing else.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd replay flight.log -o flight.mcap && hmd report flight.mcap -o ema0.html\n\
    \x20 hmd report --actuator flap-left monday.mcap tuesday.mcap -o flap-left.html")]
pub struct Args {
    /// MCAP files that hmd wrote, in the order of time.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// The HTML file.
    #[arg(short, long)]
    output: PathBuf,
    /// The actuator; needed where the files have several.
    #[arg(long, value_name = "NAME")]
    actuator: Option<String>,
}

/// Runs the verb.
///
/// # Errors
/// A file that is none of ours, an actuator that it does not have, an output that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let outputs = Outputs {
        others: &[&args.output],
        ..Outputs::default()
    };
    outputs.check(&args.files)?;
    let mut losses = Losses::default();
    let files = Files::read(&args.files, &mut |loss| losses.add(loss))?;
    let history = files.actuator(args.actuator.as_deref())?;
    let page = page(&files, history);
    output_file::write(&args.output, page).with_context(|| args.output.display().to_string())?;
    Ok(losses.exit())
}
