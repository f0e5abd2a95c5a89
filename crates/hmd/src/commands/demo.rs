//! `hmd demo`: a simulated actuator is commissioned and wears out while the pipeline watches.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context;

use super::outputs::{Content, Outputs};
use super::table::{HEALTH_HEAD, health_row, left_cell};
use super::{Exit, say_beside};
use hmd_core::commissioning::in_words;
use hmd_core::config::Config;
use hmd_core::counted::counted;
use hmd_lab::demo::{Demo, DemoError, commissioned, config_text};
use hmd_storage::mcap_writer::{McapWriter, SyncedFile};
use hmd_storage::output_file::{self, OutputFile};
use hmd_storage::recorder::metadata;

/// Watch a simulated actuator be commissioned and wear out.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd demo\n\
    \x20 hmd demo -o demo.mcap && hmd report demo.mcap -o demo.html")]
pub struct Args {
    /// MCAP file for all records; beside it the unit's calibration and the configuration with which a replay gives the same.
    #[arg(short, long, default_value = "hmd-demo.mcap")]
    output: PathBuf,
    /// Seed of the simulation and of the search.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Name of a file without its folder.
fn file_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// Runs the verb.
///
/// # Errors
/// An output that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let path = args.output.display().to_string();
    let of_output = |ending: &str| {
        args.output
            .with_file_name(format!("{}{ending}", file_name(&args.output)))
    };
    let (calibration_path, config_path) = (of_output(".calibration.toml"), of_output(".toml"));
    let text = config_text(&file_name(&calibration_path));
    let config = Arc::new(Config::from_toml_str(&text, &config_path.display().to_string())?);
    let at_path = |error| match error {
        DemoError::Write(cause) => anyhow::Error::from(cause).context(path.clone()),
        other => other.into(),
    };
    let outputs = Outputs(&[
        (&args.output, Content::Recording),
        (&calibration_path, Content::Calibration),
        (&config_path, Content::DemoConfiguration),
    ]);
    outputs.check([] as [&Path; 0])?;
    let output = OutputFile::create_recording(&args.output).with_context(|| path.clone())?;
    let file = output.handle().with_context(|| path.clone())?;
    let writer = McapWriter::new(SyncedFile::new(file), &metadata(&config, "simulated", args.seed))
        .with_context(|| path.clone())?;

    say_beside(
        "A simulated flight-control actuator, which differs from its data sheet and has a vector drive, is commissioned:",
    )?;
    let calibration = commissioned(&config, args.seed).map_err(at_path)?;
    for line in in_words(&calibration) {
        say_beside(&format!("  {line}"))?;
    }
    for (path, text) in [(&calibration_path, calibration.emit()), (&config_path, text)] {
        output_file::write(path, text).with_context(|| path.display().to_string())?;
    }
    let mut demo = Demo::new(writer, &config, &calibration, args.seed).map_err(at_path)?;

    say_beside("Then it wears out; every 100 hours one actuation is watched.")?;
    say_beside(
        "The life that is left counts to a damage of 80 %: hours by which it ends with 10, 50 and 90 % probability.",
    )?;
    say_beside(&format!("  hours left (10…90 %), h  {HEALTH_HEAD}"))?;
    while let Some((hours, windows)) = demo.next_actuation().map_err(at_path)? {
        for assessed in windows {
            say_beside(&format!(
                "{hours:>7} {:<18} {}",
                left_cell(&assessed.rul),
                health_row(&assessed.health)
            ))?;
        }
    }
    let counts = demo.finish().map_err(at_path)?;
    output.put_in_place().with_context(|| path.clone())?;
    say_beside(&format!(
        "{} in, {} identified; {} written to {path}",
        counted(counts.frames, "frame", "frames"),
        counted(counts.windows.ok + counts.windows.degraded, "window", "windows"),
        counted(counts.written.records, "record", "records")
    ))?;
    Ok(Exit::Done)
}
