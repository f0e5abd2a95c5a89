//! `hmd calibrate`: the monitor against the reference.

use std::path::PathBuf;

use anyhow::Context;

use super::{Exit, load_config, unknown_type, use_threads};
use crate::calibrate::calibrate_type;
use crate::calibration::MonitorForm;
use crate::config::MONITOR_NAMES;

/// Calibrate the monitor.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Calibrate a type of actuator: the monitor against the reference model.
    #[arg(long = "type", required = true)]
    of_type: bool,
    /// Calibration file to write.
    #[arg(short, long)]
    output: PathBuf,
    /// Type to calibrate: bench, servo28 or one of the configuration's.
    #[arg(long, default_value = "bench", value_name = "TYPE")]
    actuator: String,
    /// Monitor form: three-phase, one-axis or paper.
    #[arg(long, default_value = "three-phase", value_parser = named_monitor)]
    monitor: MonitorForm,
    /// Configuration that defines further types.
    #[arg(short, long)]
    config: Option<PathBuf>,
    /// Draws the windows that the calibration learns from.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Threads; all cores without it.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

/// Runs the verb.
///
/// # Errors
/// A bad configuration, or a file that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let config = load_config(args.config.as_deref())?;
    let Some(found) = config.actuator_type(&args.actuator) else {
        return Err(unknown_type(&args.actuator).into());
    };
    use_threads(args.threads.map(usize::from))?;
    let calibration = calibrate_type(&args.actuator, &found.params, args.monitor, args.seed);
    let q = &calibration.quality;
    eprintln!("mean squared error of i_q, A²   before      after");
    eprintln!(
        "healthy                       {:.5}    {:.5}",
        q.healthy_before_a2, q.healthy_after_a2
    );
    eprintln!(
        "faulty                        {:.5}    {:.5}",
        q.faulty_before_a2, q.faulty_after_a2
    );
    std::fs::write(&args.output, calibration.emit()).with_context(|| args.output.display().to_string())?;
    Ok(Exit::Done)
}

pub(super) fn named_monitor(text: &str) -> Result<MonitorForm, String> {
    let found = MONITOR_NAMES.into_iter().find(|(name, _)| *name == text);
    found
        .map(|(_, form)| form)
        .ok_or_else(|| "expected three-phase, one-axis or paper".to_owned())
}
