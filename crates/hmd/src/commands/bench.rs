//! `hmd bench`: evaluations and identifications per second on this computer.

use super::{Exit, progress, say};
use hmd_lab::bench::{bench, figures};

/// Measure how fast this computer evaluates monitors and identifies windows.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd bench\n\
    \x20 hmd bench --threads 1 --json")]
pub struct Args {
    /// Threads; all cores without it.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Print everything as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the verb.
///
/// # Errors
/// Threads that cannot be started.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let threads = args.threads.map_or_else(rayon::current_num_threads, usize::from);
    let bar = progress::over_pieces(figures(threads));
    let report = bench(threads, &|| bar.inc(1))?;
    bar.finish_and_clear();
    say(&if args.json {
        serde_json::to_string(&report)?
    } else {
        report.tables()
    })?;
    Ok(Exit::Done)
}
