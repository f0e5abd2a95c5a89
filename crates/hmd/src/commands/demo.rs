//! `hmd demo`: a simulated actuator wears out while the pipeline watches.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context;
use ema_models::reference::{Actuations, CurrentSensing, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::ActuatorId;

use super::table::{HEALTH_HEAD, health_row, left_cell};
use super::{Exit, say};
use hmd_core::assess::{Assessor, Models};
use hmd_core::config::Config;
use hmd_core::frame::BusNames;
use hmd_core::pipeline::Pipeline;
use hmd_core::seed::mix;
use hmd_lab::simulate::{EPOCH_NS, traffic};
use hmd_storage::mcap_writer::{Sink, SyncedFile};
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

/// Actuations shown, evenly over the life.
const ACTUATIONS: u64 = 24;

/// Flight hours between two of them.
const HOURS_BETWEEN: u64 = 100;

/// The frames show half a second of every hundred hours, so hours go by the stamps. A part that has less than this left is
/// due for repair.
const CONFIG: &str = "[rul]
hours = \"elapsed\"
warning_h = 500
critical_h = 200
";

/// Runs the verb.
///
/// # Errors
/// An output that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let config = Arc::new(Config::from_toml_str(CONFIG, "demo")?);
    let path = args.output.display().to_string();
    let file = std::fs::File::create(&args.output).with_context(|| path.clone())?;
    let mut sink =
        Sink::new(SyncedFile::new(file), &metadata(&config, "simulated", args.seed)).with_context(|| path.clone())?;
    let mut names = BusNames::new();
    names.intern("can0")?;
    let actuator = ActuatorId::new(0).context("actuator 0")?;
    let mut pipeline = Pipeline::new(config.clone());
    let mut judge = Assessor::new(config.clone(), Models::without_files(&config)?, args.seed);
    let mut ended = Vec::new();

    say("A simulated flight-control actuator wears out; every 100 hours one actuation is watched.")?;
    say("The life that is left counts to a damage of 80 %: hours by which it ends with 10, 50 and 90 % probability.")?;
    say(&format!("  hours left (10…90 %), h  {HEALTH_HEAD}"))?;
    for n in 0..ACTUATIONS {
        let hours = n * HOURS_BETWEEN;
        let scenario = Scenario {
            sensing: CurrentSensing {
                quantised: true,
                noise_rms: 0.02,
            },
            actuations: Actuations {
                rest: 0.1,
                ..Actuations::one(Profile::Mixed)
            },
            ..Scenario::new(ActuatorParams::bench(), worn(n), mix(args.seed, &[n]))
        };
        let start_ns = EPOCH_NS + hours * 3_600_000_000_000;
        for frame in traffic(&scenario, actuator, start_ns) {
            sink.raw(&frame, &names).with_context(|| path.clone())?;
            pipeline.push(&frame, &names, &mut ended);
        }
        pipeline.finish(&mut ended);
        for job in ended.drain(..) {
            let judged = judge.assess(job)?;
            let at = judged.health.t_start_ns;
            sink.write(at, &judged.window).with_context(|| path.clone())?;
            sink.write(at, &judged.health).with_context(|| path.clone())?;
            sink.write(at, &judged.rul).with_context(|| path.clone())?;
            sink.flush_window().with_context(|| path.clone())?;
            say(&format!(
                "{hours:>7} {:<18} {}",
                left_cell(&judged.rul),
                health_row(&judged.health)
            ))?;
        }
    }
    let (frames, windows) = (pipeline.frames(), judge.counts());
    let status = pipeline.status(&names, windows);
    sink.write(pipeline.last_stamp_ns(), &status)
        .with_context(|| path.clone())?;
    let (_, counts) = sink.finish().with_context(|| path.clone())?;
    say(&format!(
        "{} frames in, {} windows identified; {} records written to {path}",
        frames.received,
        windows.ok + windows.degraded,
        counts.records
    ))?;
    Ok(Exit::Done)
}

/// The life shown: friction grows steadily, backlash faster and faster, and one phase begins to short near the end.
fn worn(n: u64) -> FaultVector {
    let life = n as f64 / (ACTUATIONS - 1) as f64;
    FaultVector {
        friction: 0.75 * life,
        backlash: 0.25 * life.powi(3),
        short_b: 0.4 * (life - 0.7).max(0.0),
        ..FaultVector::NOMINAL
    }
}
