//! `hmd report`: one page about one actuator.

use std::path::PathBuf;

use anyhow::Context;

use super::recordings::{Wanted, recordings};
use super::{Exit, Losses, no_input};
use hmd_report::report::{Files, page};

/// Write a report of an actuator: one HTML file that needs nothing else.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd replay flight.log -o flight.mcap && hmd report flight.mcap -o ema0.html\n\
    \x20 hmd report --actuator flap-left monday.mcap tuesday.mcap -o flap-left.html")]
pub struct Args {
    /// MCAP files that hmd wrote, in the order of time, or folders of them.
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
    let recorded = recordings(&args.files, Wanted::Records)?;
    no_input(&args.output, &recorded)?;
    let mut losses = Losses::default();
    let files = Files::read(&recorded, &mut |loss| losses.add(loss))?;
    let history = files.actuator(args.actuator.as_deref())?;
    std::fs::write(&args.output, page(&files, history)).with_context(|| args.output.display().to_string())?;
    Ok(losses.exit())
}
