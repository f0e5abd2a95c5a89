//! `hmd recover`: what is left of a damaged recording.

use hmd_core::counted::counted;
use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;

use anyhow::{Context, bail};

use super::outputs::{Content, Outputs};
use super::{Exit, say, warn};
use hmd_storage::mcap_writer::SyncedFile;
use hmd_storage::output_file::OutputFile;
use hmd_storage::recover::{Recovered, count_frames, recover};
use hmd_storage::regular_file::open_regular;

/// Copy everything intact of a damaged MCAP file into a whole one, and say what is lost.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  hmd recover damaged.mcap -o whole.mcap")]
pub struct Args {
    /// Damaged MCAP file; it is not changed.
    #[arg(value_name = "LOG.mcap")]
    log: PathBuf,
    /// File for what is intact.
    #[arg(short, long, value_name = "OUT.mcap")]
    output: PathBuf,
}

/// Runs the verb.
///
/// # Errors
/// A file that cannot be read at all or has nothing intact, or an output that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let name = args.log.display().to_string();
    let input = open_regular(&args.log).with_context(|| name.clone())?;
    Outputs(&[(&args.output, Content::Recording)]).check([&args.log])?;
    let path = args.output.display().to_string();
    let output = OutputFile::create(&args.output).with_context(|| path.clone())?;
    let out = SyncedFile::new(output.handle().with_context(|| path.clone())?);
    let (_, report) = recover(input, &name, out, "").with_context(|| path.clone())?;
    if report.chunks == 0 && !report.is_intact() {
        for loss in &report.losses {
            warn(loss);
        }
        bail!("{name}: expected an intact chunk, found none; nothing is written");
    }
    // What was written is read again: the copy must be whole, and shows how many frames are missing.
    let copy = File::open(output.written_path()).with_context(|| path.clone())?;
    let (frames, missing) = count_frames(BufReader::new(copy), &path).with_context(|| path.clone())?;
    output.put_in_place().with_context(|| path.clone())?;
    print_report(&report, &name, &path, frames, missing)
}

fn print_report(report: &Recovered, name: &str, path: &str, frames: u64, missing: u64) -> anyhow::Result<Exit> {
    say(&format!(
        "{name}: kept {} with {} and {}, and {}, in {path}",
        counted(report.chunks, "chunk", "chunks"),
        counted(report.messages, "message", "messages"),
        counted(frames, "raw frame", "raw frames"),
        counted(report.metadata, "metadata record", "metadata records")
    ))?;
    if report.is_intact() && missing == 0 {
        return Ok(Exit::Done);
    }
    for loss in &report.losses {
        warn(loss);
    }
    let more = report.losses_total - report.losses.len() as u64;
    if more > 0 {
        warn(format_args!(
            "{name}: {}",
            counted(more, "more damaged place", "more damaged places")
        ));
    }
    warn(format_args!(
        "{name}: data lost: {}, {} missing between those kept, {}",
        counted(report.losses_total, "damaged place", "damaged places"),
        counted(missing, "raw frame", "raw frames"),
        counted(report.attachments_lost, "attachment", "attachments")
    ));
    Ok(Exit::DataLost)
}
