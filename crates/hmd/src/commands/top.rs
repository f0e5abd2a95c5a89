//! `hmd top`: the state of all actuators, on a terminal.

use hmd_core::counted::counted;
use std::io::{self, IsTerminal, Write};
use std::path::PathBuf;

use anyhow::Context;

use super::live::Signals;
use super::{Exit, Misuse, say, warn};
use hmd_report::top::{ScreenEnd, Watch, show};

/// Watch all actuators of a running daemon, or the end of a recording, on the terminal.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Keys: Up/Down or k/j select, PgUp/PgDn, Home/End, w worst first, q, Esc or Ctrl-C end. \
                        NO_COLOR is honoured.\n\nExamples:\n\
                        \x20 hmd top /var/lib/hmd\n\
                        \x20 hmd top flight.mcap --once"
)]
pub struct Args {
    /// Folder that hmd run writes to, or an MCAP file that hmd wrote or writes.
    #[arg(value_name = "FOLDER|FILE.mcap")]
    place: PathBuf,
    /// Print what there is now as text, and end; no terminal is needed.
    #[arg(long)]
    once: bool,
}

/// Runs the verb.
///
/// # Errors
/// A folder or file that is none of ours; no terminal.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let mut watch = Watch::open(&args.place)?;
    if args.once {
        return once(&mut watch);
    }
    if !io::stdout().is_terminal() {
        return Err(Misuse("top: expected a terminal on stdout, found none; --once prints text".to_owned()).into());
    }
    // A file that is no log is refused before the terminal changes.
    watch.read()?;
    let signals = Signals::listen().context("signals")?;
    match show(&mut watch, || signals.poll().is_some())? {
        ScreenEnd::Asked => Ok(Exit::Done),
        ScreenEnd::HungUp => std::process::exit(Exit::Done as i32),
    }
}

fn once(watch: &mut Watch) -> anyhow::Result<Exit> {
    for line in watch.lines()? {
        say(&line)?;
    }
    io::stdout().flush().context("stdout")?;
    if watch.damaged() == 0 {
        return Ok(Exit::Done);
    }
    warn(format_args!(
        "{}: data lost: {}",
        watch.place(),
        counted(watch.damaged(), "damaged place", "damaged places")
    ));
    Ok(Exit::DataLost)
}
