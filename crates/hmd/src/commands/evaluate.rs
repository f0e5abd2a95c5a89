//! `hmd evaluate`: the accuracy suites.

mod robust;
mod sensors;

use std::path::PathBuf;

use serde::Serialize;

use super::{Exit, Misuse, Settings, load_config_with, progress, say, unknown_type, use_threads};
use ema_identify::Identifier;
use ema_identify::calibration::MonitorForm;
use ema_models::{FaultId, MotorKnowledge, Tolerances};
use hmd_core::assess::{AssessError, method};
use hmd_core::config::{Config, IdentificationConfig, SearchMethod, SearchObjective};
use hmd_lab::evaluate::tables::{
    beside_the_paper, detection_table, noise_table, paper_table, profiles_table, random_table, rul_table,
};
use hmd_lab::evaluate::{
    CONDITION_ROWS, Estimator, NOISE_RATES_HZ, PROFILE_ROWS, conditions, detection, noise, paper, profiles, random, rul,
};
use hmd_storage::calibration_file::load_type_model;

/// Measure the accuracy of the identification.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd evaluate paper\n\
    \x20 hmd evaluate random --n 50 --seed 2 --json")]
pub struct Args {
    /// The suite.
    #[arg(value_enum)]
    suite: Suite,
    /// Number of random fault vectors, of motors (`detection`), of histories per fault (`rul`) or of pairs of windows for
    /// each row (`profiles`, `conditions`); 200 without it, 100 motors, 20 pairs. In `robust` the healthy windows of each unit, 12
    /// without it, beside twice as many faulty ones; in `sensors` the healthy units of each mistake, 4 without it, beside as many of worn
    /// actuators. The suite `paper` has a fixed content.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    n: Option<u64>,
    /// Seed of the suite.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Type of the actuator: bench (without it), servo28, servo270 or one of the configuration's. The suite `robust` takes the
    /// built-in ones, all without it; `sensors` too, bench and servo28 without it.
    #[arg(long, value_name = "TYPE")]
    actuator: Option<String>,
    /// Sample rate of the suite `robust`, Hz; 2000 without it.
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Entry of the suite `robust` or `sensors`, also several times; all without it.
    #[arg(long, value_name = "NAME")]
    entry: Vec<String>,
    /// File that keeps the finished units of the suite `robust`; a later run with the same arguments resumes there.
    #[arg(long, value_name = "FILE")]
    resume: Option<PathBuf>,
    /// Monitor form, instead of the configuration's: three-phase, one-axis or paper.
    #[arg(long, value_parser = super::calibrate_type::named_monitor)]
    monitor: Option<MonitorForm>,
    /// Search method with its defaults, instead of the configuration's: hybrid, ga, de, cmaes, least-squares; relations (suites
    /// `paper` and `random`) of a unit commissioned by twelve simulated windows.
    #[arg(long, value_parser = named_method)]
    method: Option<SearchMethod>,
    /// What ga, de or cmaes minimise, instead of the configuration's: residual or eq14.
    #[arg(long, value_parser = named_objective)]
    objective: Option<SearchObjective>,
    /// Configuration.
    #[arg(short, long)]
    config: Option<PathBuf>,
    #[command(flatten)]
    settings: Settings,
    /// Print everything as JSON.
    #[arg(long)]
    json: bool,
    /// Threads; all cores without it.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

/// The suites.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Suite {
    /// The paper's 15 single faults and its multiple one, ten seeds each.
    Paper,
    /// Random multiple faults.
    Random,
    /// The same with noise, an unknown load and motors off their type, at 2 kHz and 400 Hz.
    Noise,
    /// Assessments of single windows, healthy and faulty, of 100 motors.
    Detection,
    /// Every kind of command, without and with noise, at 2 kHz and 400 Hz.
    Profiles,
    /// Cold and hot motors, high and low supply, with noise, at 2 kHz and 400 Hz.
    Conditions,
    /// Remaining useful life predicted over whole histories of estimates, beside an oracle.
    Rul,
    /// Units with imperfections of drive, mechanics, motor and sensors, before and after their calibration.
    Robust,
    /// Wrong sensors, wires and configured numbers, on healthy and on worn actuators, before and after commissioning.
    Sensors,
}

/// The search that options and configuration ask for.
fn settings(config: &Config, args: &Args) -> Result<IdentificationConfig, Misuse> {
    let mut found = args
        .method
        .map_or(*config.identification(), IdentificationConfig::for_method);
    found.objective = args.objective.unwrap_or(found.objective);
    if found.objective == SearchObjective::Eq14 && !found.method.is_population() {
        let name = found.method.name();
        return Err(Misuse(format!(
            "--objective: expected residual with the method {name}, found eq14"
        )));
    }
    Ok(found)
}

/// The identifier of the type that is asked for; `None` where no such type is known.
fn identifier(
    config: &Config,
    settings: &IdentificationConfig,
    actuator: &str,
    args: &Args,
) -> Result<Option<Identifier>, AssessError> {
    let Some(found) = config.actuator_type(actuator) else {
        return Ok(None);
    };
    let form = args.monitor.unwrap_or(config.identification().monitor);
    Ok(Some(Identifier {
        params: found.params,
        calibration: load_type_model(actuator, found, form, config)?.calibration,
        method: method(settings),
        motor: MotorKnowledge::default(),
        tolerances: Tolerances::NONE,
    }))
}

/// What estimates the windows of the suites `paper` and `random`.
fn estimator(settings: &IdentificationConfig, identifier: Identifier, seed: u64) -> anyhow::Result<Estimator> {
    if settings.method == SearchMethod::Relations {
        return Ok(Estimator::commissioned(&identifier.params, seed)?);
    }
    Ok(Estimator::Search(Box::new(identifier)))
}

/// Runs the verb.
///
/// # Errors
/// A bad configuration.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    if args.suite == Suite::Paper
        && let Some(n) = args.n
    {
        let sentence = format!("--n: expected none with the suite paper, whose content is fixed, found {n}");
        return Err(Misuse(sentence).into());
    }
    refuse_options(args)?;
    let config = load_config_with(args.config.as_deref(), &args.settings)?;
    use_threads(args.threads.map(usize::from))?;
    match args.suite {
        Suite::Rul => return run_rul(args),
        Suite::Robust => return robust::run(args),
        Suite::Sensors => return sensors::run(args),
        _ => {}
    }
    let levels = *config.health().levels();
    let actuator = args.actuator.as_deref().unwrap_or("bench");
    let settings = settings(&config, args)?;
    if settings.method == SearchMethod::Relations && !matches!(args.suite, Suite::Paper | Suite::Random) {
        let sentence = "--method: expected relations with the suites paper and random alone: they commission a unit";
        return Err(Misuse(sentence.to_owned()).into());
    }
    let Some(identifier) = identifier(&config, &settings, actuator, args)? else {
        return Err(unknown_type(actuator).into());
    };
    match args.suite {
        Suite::Paper => {
            let estimator = estimator(&settings, identifier, args.seed)?;
            let bar = progress::over_pieces(160);
            let report = paper(&estimator, actuator, args.seed, &|| bar.inc(1))?;
            // That of the simulation, 0.1 s a window, included.
            let seconds = cpu_seconds();
            bar.finish_and_clear();
            print(args, &report, paper_table)?;
            if settings.objective == SearchObjective::Eq14 && !args.json {
                say("")?;
                say(&beside_the_paper(&report, seconds))?;
            }
        }
        Suite::Random => {
            let n = args.n.unwrap_or(200);
            let estimator = estimator(&settings, identifier, args.seed)?;
            let bar = progress::over_pieces(n);
            let report = random(&estimator, actuator, n, args.seed, &|| bar.inc(1))?;
            bar.finish_and_clear();
            print(args, &report, random_table)?;
        }
        Suite::Noise => {
            let n = args.n.unwrap_or(200);
            let bar = progress::over_pieces(n * NOISE_RATES_HZ.len() as u64);
            let report = noise(&identifier, actuator, n, args.seed, &|| bar.inc(1))?;
            bar.finish_and_clear();
            print(args, &report, noise_table)?;
        }
        Suite::Detection => {
            let n = args.n.unwrap_or(100);
            let bar = progress::over_pieces(n * 200);
            let report = detection(&identifier, levels, actuator, n, args.seed, &|| bar.inc(1))?;
            bar.finish_and_clear();
            print(args, &report, detection_table)?;
        }
        Suite::Profiles | Suite::Conditions => {
            let n = args.n.unwrap_or(20);
            let all = args.suite == Suite::Profiles;
            let bar = progress::over_pieces(n * if all { PROFILE_ROWS } else { CONDITION_ROWS });
            let (name, seed) = (actuator, args.seed);
            let done = || bar.inc(1);
            let report = if all {
                profiles(&identifier, levels, name, n, seed, &done)?
            } else {
                conditions(&identifier, levels, name, n, seed, &done)?
            };
            bar.finish_and_clear();
            print(args, &report, profiles_table)?;
        }
        // They need no identifier, and have run.
        Suite::Rul | Suite::Robust | Suite::Sensors => {}
    }
    Ok(Exit::Done)
}

/// Refuses options that the suite does not take.
fn refuse_options(args: &Args) -> Result<(), Misuse> {
    let of_identifier = [
        ("--monitor", args.monitor.is_some()),
        ("--method", args.method.is_some()),
        ("--objective", args.objective.is_some()),
    ];
    let of_config = [
        ("--config", args.config.is_some()),
        ("--set", !args.settings.set.is_empty()),
    ];
    let of_robust = [
        ("--rate", args.rate.is_some()),
        ("--resume", args.resume.is_some()),
        ("--entry", !args.entry.is_empty()),
    ];
    let refuse = |options: &[(&str, bool)], why: &str| match options.iter().find(|(_, is_set)| *is_set) {
        Some((option, _)) => Err(Misuse(format!("{option}: expected none with {why}"))),
        None => Ok(()),
    };
    match args.suite {
        Suite::Rul => refuse(&of_identifier, "the suite rul, which identifies nothing")?,
        Suite::Robust => {
            let why = "the suite robust, which measures the built-in types with their defaults";
            refuse(&of_identifier, why)?;
            return refuse(&of_config, why);
        }
        Suite::Sensors => {
            let why = "the suite sensors, which measures the built-in types with their defaults";
            refuse(&of_identifier, why)?;
            refuse(&of_config, why)?;
            return refuse(&of_robust[..2], "this suite; the suite robust takes it");
        }
        _ => {}
    }
    refuse(&of_robust, "this suite; the suite robust takes it")
}

/// The one suite that identifies nothing: its estimates are drawn.
fn run_rul(args: &Args) -> anyhow::Result<Exit> {
    let n = args.n.unwrap_or(200);
    let bar = progress::over_pieces(n * FaultId::COUNT as u64);
    let report = rul(n, args.seed, &|| bar.inc(1))?;
    bar.finish_and_clear();
    print(args, &report, rul_table)?;
    Ok(Exit::Done)
}

/// Prints a report as the arguments ask: as JSON or as a table.
fn print<R: Serialize>(args: &Args, report: &R, table: fn(&R) -> String) -> anyhow::Result<()> {
    say(&if args.json {
        serde_json::to_string(report)?
    } else {
        table(report)
    })
}

/// Processor time of this process, s.
fn cpu_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

fn named_method(text: &str) -> Result<SearchMethod, String> {
    let found = SearchMethod::NAMES.into_iter().find(|(name, _)| *name == text);
    found.map(|(_, method)| method).ok_or_else(|| {
        let names = SearchMethod::NAMES.map(|(name, _)| name);
        format!("expected one of {}", names.join(", "))
    })
}

fn named_objective(text: &str) -> Result<SearchObjective, String> {
    let found = SearchObjective::NAMES.into_iter().find(|(name, _)| *name == text);
    found
        .map(|(_, objective)| objective)
        .ok_or_else(|| "expected residual or eq14".to_owned())
}
