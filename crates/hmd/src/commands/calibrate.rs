//! `hmd calibrate`: the monitor against the reference, or one motor from healthy windows of it.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, bail};

use super::{Exit, load_config, no_input, unknown_type, use_threads, warn};
use crate::calibrate::calibrate_type;
use crate::config::{Config, MONITOR_NAMES};
use crate::health::{Health, Levels};
use crate::judge::{Judge, conditions, judgement};
use crate::outliers::identify_without_outliers;
use crate::unit::{UnitCalibration, WINDOWS_MIN, fit_motor, windows_of};
use ema_identify::calibration::MonitorForm;
use ema_identify::is_unmodelled;

/// Calibrate the monitor for a type of actuator, or for one unit from logs in which it was healthy.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd calibrate healthy.mcap -c hmd.toml -o unit.calibration.toml\n\
    \x20 hmd calibrate --type --actuator own -c hmd.toml -o own.calibration.toml")]
pub struct Args {
    /// Logs of one unit in health, five windows or more; without them --type.
    #[arg(required_unless_present = "of_type")]
    logs: Vec<PathBuf>,
    /// Calibrate a type of actuator: the monitor against the reference model.
    #[arg(long = "type", conflicts_with = "logs")]
    of_type: bool,
    /// Name of the unit, where the logs hold several.
    #[arg(long, conflicts_with = "of_type")]
    name: Option<String>,
    /// Calibration file to write.
    #[arg(short, long)]
    output: PathBuf,
    /// Type to calibrate: bench, servo28 or one of the configuration's.
    #[arg(long, default_value = "bench", value_name = "TYPE", requires = "of_type")]
    actuator: String,
    /// Monitor form of the type: three-phase, one-axis or paper.
    #[arg(long, default_value = "three-phase", value_parser = named_monitor, requires = "of_type")]
    monitor: MonitorForm,
    /// Configuration that defines further types, and the actuators of the logs.
    #[arg(short, long)]
    config: Option<PathBuf>,
    /// Draws the windows that the calibration of a type learns from; seed of the search for that of a unit.
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
    no_input(&args.output, args.logs.iter().chain(&read_files(&config, args.of_type)))?;
    if !args.of_type {
        return unit(args, config);
    }
    let Some(found) = config.actuator_type(&args.actuator) else {
        return Err(unknown_type(&args.actuator).into());
    };
    use_threads(args.threads.map(usize::from))?;
    let calibration = calibrate_type(&args.actuator, &found.params, args.monitor, args.seed);
    let q = &calibration.quality;
    warn(format_args!("mean squared error of i_q, A²   before      after"));
    warn(format_args!(
        "healthy                       {:.5}    {:.5}",
        q.healthy_before_a2, q.healthy_after_a2
    ));
    warn(format_args!(
        "faulty                        {:.5}    {:.5}",
        q.faulty_before_a2, q.faulty_after_a2
    ));
    std::fs::write(&args.output, calibration.emit()).with_context(|| args.output.display().to_string())?;
    Ok(Exit::Done)
}

/// The files of a configuration that this calibration reads; the one that it makes may be named there already.
fn read_files(config: &Config, of_type: bool) -> Vec<PathBuf> {
    let types = config.types().filter_map(|(_, found)| found.calibration.as_ref());
    let units = config.actuators().iter().filter_map(|unit| unit.calibration.as_ref());
    let made: Vec<&PathBuf> = if of_type { types.collect() } else { units.collect() };
    let made: Vec<PathBuf> = made.into_iter().map(|path| config.resolve(path)).collect();
    let files = config.files().into_iter();
    files.filter(|file| !made.contains(file)).collect()
}

/// Fits one motor to its healthy windows.
fn unit(args: &Args, config: Config) -> anyhow::Result<Exit> {
    use_threads(args.threads.map(usize::from))?;
    let config = Arc::new(config);
    let levels = config.health().levels().map(Levels::at_once);
    let mut found = windows_of(&args.logs, &config, args.name.as_deref(), &mut |message| warn(message))?;
    let jobs = &mut found.jobs;
    jobs.retain(|job| match conditions(job) {
        Ok(_) => true,
        Err(absurd) => {
            warn(format_args!(
                "{}: window {}: left out: {absurd}",
                job.actuator.name, job.window.number
            ));
            false
        }
    });
    if jobs.len() < WINDOWS_MIN {
        let logs: Vec<String> = args.logs.iter().map(|log| log.display().to_string()).collect();
        bail!(
            "{}: expected at least {WINDOWS_MIN} windows that can be judged, found {}",
            logs.join(", "),
            jobs.len()
        );
    }
    let mut judge = Judge::new(config, args.seed);
    let mut prepared = Vec::new();
    for job in &mut *jobs {
        // What an earlier calibration of the unit says is to be learnt anew.
        let identifier = judge.of_uncalibrated(job)?;
        let conditions = conditions(job).map_err(anyhow::Error::msg)?;
        let (window, estimate) = identify_without_outliers(&identifier, &mut job.window, conditions, args.seed)?;
        let verdict = Health::new(levels)?.update(0, Some(&judgement(&estimate)));
        if !verdict.faults.is_empty() {
            bail!(
                "window {}: expected a healthy unit, found {}",
                job.window.number,
                verdict.faults.join(", ")
            );
        }
        prepared.push((identifier, window, conditions));
    }
    let coefficients: Vec<_> = prepared
        .iter()
        .map(|(identifier, ..)| identifier.calibration.coefficients())
        .collect();
    let compared: Vec<_> = prepared
        .iter()
        .zip(&coefficients)
        .map(|((identifier, window, conditions), coefficients)| {
            identifier.comparison(window, coefficients, *conditions)
        })
        .collect();
    let Some(fit) = fit_motor(&compared) else {
        bail!("expected windows that tell of the motor, found none that do");
    };
    if is_unmodelled(fit.cost) {
        bail!(
            "expected windows of a healthy unit of type {}, found none of its motors explains them: cost {:.0}",
            jobs[0].actuator.type_name,
            fit.cost
        );
    }
    let calibration = UnitCalibration::new(&jobs[0].actuator.type_name, jobs.len() as u32, &fit.motor);
    warn(format_args!(
        "{}: resistance {:+.2} % ± {:.2} %, back-EMF {:+.3} % ± {:.3} % of type {}, from {} windows",
        jobs[0].actuator.name,
        100.0 * calibration.resistance,
        100.0 * calibration.resistance_sigma,
        100.0 * calibration.back_emf,
        100.0 * calibration.back_emf_sigma,
        calibration.actuator_type,
        calibration.windows
    ));
    std::fs::write(&args.output, calibration.emit()).with_context(|| args.output.display().to_string())?;
    Ok(if found.data_lost { Exit::DataLost } else { Exit::Done })
}

pub(super) fn named_monitor(text: &str) -> Result<MonitorForm, String> {
    let found = MONITOR_NAMES.into_iter().find(|(name, _)| *name == text);
    found
        .map(|(_, form)| form)
        .ok_or_else(|| "expected three-phase, one-axis or paper".to_owned())
}
