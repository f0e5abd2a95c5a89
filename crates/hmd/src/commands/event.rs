//! `hmd event`: tell of maintenance, so that a new unit does not inherit a trend.

use std::path::PathBuf;

use super::{Exit, Misuse, load_config};
use hmd_core::history::{Event, EventKind};
use hmd_storage::clock::now_ns;
use hmd_storage::event_file::append;

/// The year 2262, as far as other programs count nanoseconds.
const AT_MAX_NS: u64 = i64::MAX as u64;

/// Tell of maintenance: a part was replaced, and a new life begins.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  hmd event --reset flap-left -c hmd.toml")]
pub struct Args {
    /// The actuator that was replaced or overhauled; what is known of its wear is void.
    #[arg(long, value_name = "ACTUATOR")]
    reset: String,
    /// Configuration; its rul.events names the file that the event is added to.
    #[arg(short, long)]
    config: PathBuf,
    /// When it happened, UTC ns; now without it.
    #[arg(long, value_name = "NS", value_parser = clap::value_parser!(u64).range(..=AT_MAX_NS))]
    at: Option<u64>,
}

/// Runs the verb.
///
/// # Errors
/// A bad configuration, an actuator that it does not know, or a file that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let config = load_config(Some(&args.config))?;
    let Some(path) = &config.rul().events else {
        let file = args.config.display();
        return Err(Misuse(format!(
            "{file}: expected rul.events = \"FILE\", found none: events have no place"
        ))
        .into());
    };
    if config.actuator_named(&args.reset).is_none() {
        let known: Vec<&str> = config.actuators().iter().map(|a| a.name.as_str()).collect();
        let sentence = format!("--reset: expected one of {}, found {:?}", known.join(", "), args.reset);
        return Err(Misuse(sentence).into());
    }
    let event = Event {
        t_ns: args.at.unwrap_or_else(now_ns),
        actuator: args.reset.clone(),
        event: EventKind::Reset,
    };
    append(&config.resolve(path), &event)?;
    Ok(Exit::Done)
}
