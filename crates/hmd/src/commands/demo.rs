//! `hmd demo`: a simulated actuator wears out while the pipeline watches.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context;
use ema_wire::ActuatorId;

use super::table::{HEALTH_HEAD, health_row, left_cell};
use super::{Exit, say};
use hmd_core::config::Config;
use hmd_lab::demo::{CONFIG, Demo, DemoError};
use hmd_storage::mcap_writer::{McapWriter, SyncedFile};
use hmd_storage::recorder::metadata;

/// Watch a simulated actuator wear out.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd demo\n\
    \x20 hmd demo -o demo.mcap && hmd report demo.mcap -o demo.html")]
pub struct Args {
    /// MCAP file for all records.
    #[arg(short, long, default_value = "hmd-demo.mcap")]
    output: PathBuf,
    /// Seed of the simulation and of the search.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Runs the verb.
///
/// # Errors
/// An output that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let config = Arc::new(Config::from_toml_str(CONFIG, "demo")?);
    let path = args.output.display().to_string();
    let at_path = |error| match error {
        DemoError::Write(cause) => anyhow::Error::from(cause).context(path.clone()),
        other => other.into(),
    };
    let file = std::fs::File::create(&args.output).with_context(|| path.clone())?;
    let writer = McapWriter::new(SyncedFile::new(file), &metadata(&config, "simulated", args.seed))
        .with_context(|| path.clone())?;
    let actuator = ActuatorId::new(0).context("actuator 0")?;
    let mut demo = Demo::new(writer, &config, actuator, args.seed).map_err(at_path)?;

    say("A simulated flight-control actuator wears out; every 100 hours one actuation is watched.")?;
    say("The life that is left counts to a damage of 80 %: hours by which it ends with 10, 50 and 90 % probability.")?;
    say(&format!("  hours left (10…90 %), h  {HEALTH_HEAD}"))?;
    while let Some((hours, windows)) = demo.next_actuation().map_err(at_path)? {
        for assessed in windows {
            say(&format!(
                "{hours:>7} {:<18} {}",
                left_cell(&assessed.rul),
                health_row(&assessed.health)
            ))?;
        }
    }
    let counts = demo.finish().map_err(at_path)?;
    say(&format!(
        "{} frames in, {} windows identified; {} records written to {path}",
        counts.frames,
        counts.windows.ok + counts.windows.degraded,
        counts.written.records
    ))?;
    Ok(Exit::Done)
}
