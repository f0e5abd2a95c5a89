//! `hmd calibrate`: one unit from healthy windows of it, or (feature `full`) the monitor against the reference.

use std::collections::BTreeSet;
use std::iter;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, bail};

use super::outputs::{Content, Outputs};
use super::progress::over_pieces;
use super::recordings::{Wanted, recordings};
use super::{Exit, Misuse, Settings, load_config_with, to_stderr, use_threads};
use crate::unit_windows::windows_of;
#[cfg(feature = "full")]
use ema_identify::calibration::TypeCalibration;
use hmd_core::assess::{Assessor, conditions};
use hmd_core::commissioning::{
    Commissioned, CommissioningError, SeenByType, calibrate_unit, health_by_type, in_words, windows_of_work,
};
use hmd_core::config::Config;
use hmd_core::outbox::WindowJob;
use hmd_core::record::WindowStatus;
#[cfg(feature = "full")]
use hmd_report::report::commissioning_page;
use hmd_storage::calibration_file::{load_type_models, save};
#[cfg(feature = "full")]
use hmd_storage::output_file;

/// Calibrate the monitor for one unit from logs in which it was healthy, or for a type of actuator.
#[derive(Debug, clap::Args)]
#[cfg_attr(
    feature = "full",
    command(after_help = "Examples:\n\
    \x20 hmd calibrate healthy.mcap -c hmd.toml -o unit.calibration.toml --report unit.html\n\
    \x20 hmd calibrate --type --actuator own -c hmd.toml -o own.calibration.toml\n\
    \x20 hmd calibrate --type --actuator own -c hmd.toml --units unit*.toml -o conf.d/own.toml")
)]
#[cfg_attr(
    not(feature = "full"),
    command(after_help = "Example:\n\
    \x20 hmd calibrate healthy.mcap -c hmd.toml -o unit.calibration.toml")
)]
pub struct Args {
    /// Logs of one unit in health, or folders of them, five windows or more; without them --type.
    #[cfg_attr(feature = "full", arg(required_unless_present = "of_type"))]
    #[cfg_attr(not(feature = "full"), arg(required = true))]
    logs: Vec<PathBuf>,
    #[cfg(feature = "full")]
    #[command(flatten)]
    of_type: super::calibrate_type::TypeArgs,
    /// Name of the unit, where the logs hold several.
    #[cfg_attr(feature = "full", arg(long, conflicts_with = "of_type"))]
    #[cfg_attr(not(feature = "full"), arg(long))]
    name: Option<String>,
    /// Calibration file to write.
    #[arg(short, long)]
    output: PathBuf,
    /// HTML page that shows what was learnt of the unit: parameters, residuals, smallest damage.
    #[cfg(feature = "full")]
    #[arg(long, value_name = "HTML", conflicts_with = "of_type")]
    report: Option<PathBuf>,
    /// Configuration that defines further types, and the actuators of the logs.
    #[arg(short, long)]
    config: Option<PathBuf>,
    #[command(flatten)]
    settings: Settings,
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
    use_threads(args.threads.map(usize::from))?;
    run_with(args, &mut to_stderr)
}

/// The same on the threads of the caller; `tell` gets what the command would write to standard error.
///
/// # Errors
/// As [`run`].
pub fn run_with(args: &Args, tell: &mut dyn FnMut(&str)) -> anyhow::Result<Exit> {
    let config = load_config_with(args.config.as_deref(), &args.settings)?;
    #[cfg(feature = "full")]
    if args.of_type.is_requested()? {
        check(
            &[(&args.output, Content::Calibration)],
            read_files(&config, true).iter().chain(args.of_type.units()),
        )?;
        if !args.of_type.units().is_empty() {
            save(&args.output, &args.of_type.of_units(&config, tell)?)
                .with_context(|| args.output.display().to_string())?;
            return Ok(Exit::Done);
        }
        let calibration = args.of_type.calibrate(&config, args.seed, tell)?;
        let (text, path) = (calibration.emit(), args.output.display().to_string());
        // What a replay would refuse is not written.
        TypeCalibration::parse(&text, &path)?;
        save(&args.output, &text).context(path)?;
        return Ok(Exit::Done);
    }
    #[cfg(feature = "full")]
    let report = args.report.as_deref();
    #[cfg(not(feature = "full"))]
    let report: Option<&Path> = None;
    let report = report.map(|path| (path, Content::Page));
    let outputs: Vec<(&Path, Content)> = iter::once((args.output.as_path(), Content::Calibration))
        .chain(report)
        .collect();
    let logs = recordings(&args.logs, Wanted::Logs)?;
    check(&outputs, logs.iter().chain(&read_files(&config, false)))?;
    unit(args, &logs, config, tell)
}

fn check<'a>(outputs: &[(&Path, Content)], inputs: impl Iterator<Item = &'a PathBuf>) -> Result<(), Misuse> {
    Outputs(outputs).check(inputs)
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

/// Commissions one unit by its healthy windows.
fn unit(args: &Args, logs: &[PathBuf], config: Config, tell: &mut dyn FnMut(&str)) -> anyhow::Result<Exit> {
    let config = Arc::new(config);
    let mut found = windows_of(logs, &config, args.name.as_deref(), tell)?;
    let mut assessor = Assessor::new(config.clone(), load_type_models(&config)?, args.seed);
    for job in std::mem::take(&mut found.left_out) {
        let (name, number) = (job.actuator.name.clone(), job.window.number);
        let reason = assessor.assess(job)?.health.reason;
        tell(&format!("{name}: window {number}: left out: {reason}"));
    }
    let jobs = &mut found.jobs;
    jobs.retain(|job| match conditions(job) {
        Ok(_) => true,
        Err(absurd) => {
            tell(&format!(
                "{}: window {}: left out: {absurd}",
                job.actuator.name, job.window.number
            ));
            false
        }
    });
    let bar = over_pieces(windows_of_work(jobs.len()));
    let commissioned = calibrate_unit(&assessor, config.health().levels(), jobs, args.seed, &|n| bar.inc(n));
    bar.finish_and_clear();
    let commissioned = match commissioned {
        Ok(commissioned) => commissioned,
        // The exit code of a bad configuration belongs to this one.
        Err(CommissioningError::Assess(error)) => return Err(error.into()),
        Err(error @ CommissioningError::TooFew(_)) => {
            let logs: Vec<String> = logs.iter().map(|log| log.display().to_string()).collect();
            bail!("{}: {error}", logs.join(", "));
        }
        Err(error) => {
            // A parameter is a reason by itself.
            let says_why = matches!(error, CommissioningError::Parameter(_));
            let doubts = doubts(&mut assessor, jobs)?;
            for line in doubts
                .doubted
                .iter()
                .chain(doubts.not_assessed.iter().filter(|_| !says_why))
            {
                tell(line);
            }
            return Err(error.into());
        }
    };
    let levels = config.health().levels();
    let mut seen = Vec::new();
    for job in spread(jobs, SEEN_BY_TYPE) {
        seen.push(SeenByType::new(&assessor.assess(job.clone())?));
    }
    let name = &jobs[0].actuator.name;
    let warnings = health_by_type(&seen, &jobs[0].actuator, levels).with_context(|| name.clone())?;
    let Commissioned { calibration, notes, .. } = &commissioned;
    for line in warnings.iter().chain(notes).cloned().chain(in_words(calibration)) {
        tell(&format!("{name}: {line}"));
    }
    save(&args.output, &calibration.emit()).with_context(|| args.output.display().to_string())?;
    #[cfg(feature = "full")]
    if let Some(report) = &args.report {
        let page = commissioning_page(name, calibration, &commissioned.findings);
        output_file::write(report, page).with_context(|| report.display().to_string())?;
    }
    Ok(if found.data_lost { Exit::DataLost } else { Exit::Done })
}

/// Windows that are assessed by the type alone too: what a type is off is off in all windows alike, and each is a search with all
/// tolerances free.
const SEEN_BY_TYPE: usize = 5;

/// So many of all at most, evenly spread, with the first and the last.
fn spread<T>(all: &[T], most: usize) -> impl Iterator<Item = &T> {
    let count = most.min(all.len());
    let last = (all.len().saturating_sub(1), count.saturating_sub(1).max(1));
    (0..count).map(move |n| &all[n * last.0 / last.1])
}

/// What the first windows say, as a replay of them would.
#[derive(Default)]
struct Doubts {
    /// Sensors, wires and configured numbers that they doubt, with the reason of the first window that does: what a unit's own numbers would
    /// have to make up for.
    doubted: Vec<String>,
    /// Where they doubt none, why one of them is not assessed, if it is not.
    not_assessed: Option<String>,
}

fn doubts(assessor: &mut Assessor, jobs: &[WindowJob]) -> anyhow::Result<Doubts> {
    /// Windows that are asked.
    const ASKED: usize = 3;
    let (mut suspects, mut doubts) = (BTreeSet::new(), Doubts::default());
    for job in jobs.iter().take(ASKED) {
        let assessed = assessor.assess(job.clone())?;
        let (name, window) = (&job.actuator.name, job.window.number);
        let (status, reason) = (&assessed.health.status, &assessed.health.reason);
        let is_not_assessed = [WindowStatus::Invalid, WindowStatus::Unmodelled]
            .iter()
            .any(|not| not.name() == status);
        if is_not_assessed && doubts.not_assessed.is_none() {
            doubts.not_assessed = Some(format!("{name}: window {window}: {status} by the type alone: {reason}"));
        }
        let new: Vec<&str> = assessed
            .suspects
            .iter()
            .filter(|suspect| suspects.insert(**suspect))
            .map(|suspect| suspect.name())
            .collect();
        if !new.is_empty() {
            let line = format!("{name}: check {} first: window {window}: {reason}", new.join(" and "));
            doubts.doubted.push(line);
        }
    }
    doubts.not_assessed = doubts.not_assessed.filter(|_| doubts.doubted.is_empty());
    Ok(doubts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_are_spread_over_all() {
        let of = |count: usize| {
            spread(&(0..count).collect::<Vec<_>>(), 5)
                .copied()
                .collect::<Vec<usize>>()
        };
        assert_eq!(of(12), [0, 2, 5, 8, 11]);
        assert_eq!(of(5), [0, 1, 2, 3, 4]);
        assert_eq!((of(1), of(0)), (vec![0], vec![]));
    }
}
