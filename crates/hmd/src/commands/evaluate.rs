//! `hmd evaluate`: the accuracy suites.

use std::path::PathBuf;

use super::{Exit, Misuse, load_config, progress, say, unknown_type, use_threads};
use ema_identify::Identifier;
use ema_identify::calibration::MonitorForm;
use ema_models::MotorKnowledge;
use hmd_core::assess::{AssessError, method};
use hmd_core::config::SearchMethod;
use hmd_core::config::{Config, IdentificationConfig};
use hmd_core::health::FAULTS;
use hmd_lab::evaluate::{
    CONDITION_ROWS, Case, DetectionReport, NOISE_RATES_HZ, NoiseReport, PROFILE_ROWS, PaperReport, ProfilesReport,
    RandomReport, RulReport, Scores, conditions, detection, noise, paper, profiles, random, rul,
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
    /// each row (`profiles`, `conditions`); 200 without it, 100 motors, 20 pairs. The suite `paper` has a fixed content.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    n: Option<u64>,
    /// Seed of the suite.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Type of the actuator: bench, servo28 or one of the configuration's.
    #[arg(long, default_value = "bench", value_name = "TYPE")]
    actuator: String,
    /// Monitor form, instead of the configuration's: three-phase, one-axis or paper.
    #[arg(long, value_parser = super::calibrate_type::named_monitor)]
    monitor: Option<MonitorForm>,
    /// Search method, instead of the configuration's: hybrid or ga.
    #[arg(long, value_parser = named_method)]
    method: Option<SearchMethod>,
    /// Configuration.
    #[arg(short, long)]
    config: Option<PathBuf>,
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
    /// Verdicts of single windows, healthy and faulty, of 100 motors.
    Detection,
    /// Every kind of command, without and with noise, at 2 kHz and 400 Hz.
    Profiles,
    /// Cold and hot motors, high and low supply, with noise, at 2 kHz and 400 Hz.
    Conditions,
    /// Remaining life foretold over whole histories of estimates, beside an oracle.
    Rul,
}

/// The identifier of the type that is asked for; `None` where no such type is known.
fn identifier(config: &Config, args: &Args) -> Result<Option<Identifier>, AssessError> {
    let Some(found) = config.actuator_type(&args.actuator) else {
        return Ok(None);
    };
    let form = args.monitor.unwrap_or(config.identification().monitor);
    let settings = args.method.map(IdentificationConfig::for_method);
    Ok(Some(Identifier {
        params: found.params,
        calibration: load_type_model(&args.actuator, found, form, config)?.calibration,
        method: method(settings.as_ref().unwrap_or(config.identification())),
        motor: MotorKnowledge::default(),
    }))
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
    if args.suite == Suite::Rul {
        for (option, is_set) in [
            ("--monitor", args.monitor.is_some()),
            ("--method", args.method.is_some()),
        ] {
            if is_set {
                let sentence = format!("{option}: expected none with the suite rul, which identifies nothing");
                return Err(Misuse(sentence).into());
            }
        }
    }
    let config = load_config(args.config.as_deref())?;
    use_threads(args.threads.map(usize::from))?;
    if args.suite == Suite::Rul {
        return run_rul(args);
    }
    let levels = *config.health().levels();
    let Some(identifier) = identifier(&config, args)? else {
        return Err(unknown_type(&args.actuator).into());
    };
    match args.suite {
        Suite::Paper => {
            let bar = progress::over_pieces(160);
            let report = paper(&identifier, &args.actuator, args.seed, &|| bar.inc(1))?;
            bar.finish_and_clear();
            say(&if args.json {
                serde_json::to_string(&report)?
            } else {
                paper_table(&report)
            })?;
        }
        Suite::Random => {
            let n = args.n.unwrap_or(200);
            let bar = progress::over_pieces(n);
            let report = random(&identifier, &args.actuator, n, args.seed, &|| bar.inc(1))?;
            bar.finish_and_clear();
            say(&if args.json {
                serde_json::to_string(&report)?
            } else {
                random_table(&report)
            })?;
        }
        Suite::Noise => {
            let n = args.n.unwrap_or(200);
            let bar = progress::over_pieces(n * NOISE_RATES_HZ.len() as u64);
            let report = noise(&identifier, &args.actuator, n, args.seed, &|| bar.inc(1))?;
            bar.finish_and_clear();
            say(&if args.json {
                serde_json::to_string(&report)?
            } else {
                noise_table(&report)
            })?;
        }
        Suite::Detection => {
            let n = args.n.unwrap_or(100);
            let bar = progress::over_pieces(n * 200);
            let report = detection(&identifier, levels, &args.actuator, n, args.seed, &|| bar.inc(1))?;
            bar.finish_and_clear();
            say(&if args.json {
                serde_json::to_string(&report)?
            } else {
                detection_table(&report)
            })?;
        }
        Suite::Profiles | Suite::Conditions => {
            let n = args.n.unwrap_or(20);
            let all = args.suite == Suite::Profiles;
            let bar = progress::over_pieces(n * if all { PROFILE_ROWS } else { CONDITION_ROWS });
            let (name, seed) = (args.actuator.as_str(), args.seed);
            let done = || bar.inc(1);
            let report = if all {
                profiles(&identifier, levels, name, n, seed, &done)?
            } else {
                conditions(&identifier, levels, name, n, seed, &done)?
            };
            bar.finish_and_clear();
            say(&if args.json {
                serde_json::to_string(&report)?
            } else {
                profiles_table(&report)
            })?;
        }
        // It needs no identifier, and has run.
        Suite::Rul => {}
    }
    Ok(Exit::Done)
}

/// The one suite that identifies nothing: its estimates are drawn.
fn run_rul(args: &Args) -> anyhow::Result<Exit> {
    let n = args.n.unwrap_or(200);
    let bar = progress::over_pieces(n * FAULTS as u64);
    let report = rul(n, args.seed, &|| bar.inc(1))?;
    bar.finish_and_clear();
    say(&if args.json {
        serde_json::to_string(&report)?
    } else {
        rul_table(&report)
    })?;
    Ok(Exit::Done)
}

fn named_method(text: &str) -> Result<SearchMethod, String> {
    let found = SearchMethod::NAMES.into_iter().find(|(name, _)| *name == text);
    found
        .map(|(_, method)| method)
        .ok_or_else(|| "expected hybrid or ga".to_owned())
}

/// Mean and largest error of each group of cases, as a Markdown table.
fn paper_table(report: &PaperReport) -> String {
    let mut text = "| case | mean rss, % | max rss, % | mean eq. 15, % |\n|---|---|---|---|\n".to_owned();
    let mut row = |name: &str, mean: f64, max: f64, eq15: f64| {
        text += &format!("| {name} | {mean:.2} | {max:.2} | {eq15:.2} |\n");
    };
    for group in report.cases.chunk_by(|a, b| a.name == b.name) {
        let n = group.len() as f64;
        let mean = |f: fn(&Case) -> f64| group.iter().map(f).sum::<f64>() / n;
        let max = group.iter().map(|c| c.rss_pct).fold(0.0, f64::max);
        row(&group[0].name, mean(|c| c.rss_pct), max, mean(|c| c.eq15_pct));
    }
    row(
        "**all single faults**",
        report.single.mean_rss_pct,
        report.single.max_rss_pct,
        report.single.mean_eq15_pct,
    );
    row(
        "**multiple faults**",
        report.multi.mean_rss_pct,
        report.multi.max_rss_pct,
        report.multi.mean_eq15_pct,
    );
    text.truncate(text.trim_end().len());
    text
}

fn random_table(report: &RandomReport) -> String {
    format!(
        "| windows | median rss, % | p95 rss, % | median eq. 15, % |\n|---|---|---|---|\n| {} | {:.2} | {:.2} | {:.2} |",
        report.cases.len(),
        report.median_rss_pct,
        report.p95_rss_pct,
        report.median_eq15_pct
    )
}

fn noise_table(report: &NoiseReport) -> String {
    let mut text =
        "| rate, Hz | windows | median rss, % | p95 rss, % | 95 % interval covers, % | error over Cramér–Rao bound, \
                    matched data |\n|---|---|---|---|---|---|"
            .to_owned();
    for rate in &report.rates {
        text += &format!(
            "\n| {:.0} | {} | {:.2} | {:.2} | {:.1} | {:.2} |",
            rate.sample_rate_hz,
            rate.cases.len(),
            rate.median_rss_pct,
            rate.p95_rss_pct,
            100.0 * rate.coverage_95,
            rate.crlb_ratio
        );
    }
    text
}

fn detection_table(report: &DetectionReport) -> String {
    let mut text = "| windows | detected, % | exactly named, % |\n|---|---|---|".to_owned();
    for fault in &report.detection_rate_by_fault {
        text += &format!(
            "\n| {} ({}) | {:.2} | {:.2} |",
            fault.fault,
            fault.windows,
            100.0 * fault.detection_rate,
            100.0 * fault.isolation_rate
        );
    }
    text += &format!(
        "\n| **all faulty ones** | {:.2} | {:.2} |\n\nFalse alarms in healthy windows: {:.3} %.",
        100.0 * report.detection_rate,
        100.0 * report.isolation_rate,
        100.0 * report.false_alarm_rate
    );
    text
}

fn profiles_table(report: &ProfilesReport) -> String {
    let mut text = "| windows | noise | rate, Hz | median rss, % | p95 rss, % | covers, % | covers healthy, % | shows k1 | k2 | \
                    k3…k5 | k6 | k8, % | false faults | unmodelled | ambiguous | max cost |\n|---|---|---|---|---|---|---|---|---|---|---|---\
                    |---|---|---|---|"
        .to_owned();
    for row in &report.rows {
        let shown = row.observable.map(|share| 100.0 * share);
        text += &format!(
            "\n| {} | {} | {:.0} | {:.2} | {:.2} | {:.1} | {:.1} | {:.0} | {:.0} | {:.0} | {:.0} | {:.0} | {} | {} | {} | {:.1} |",
            row.name,
            if row.noise { "yes" } else { "no" },
            row.sample_rate_hz,
            row.median_rss_pct,
            row.p95_rss_pct,
            100.0 * row.coverage_95,
            100.0 * row.healthy_coverage_95,
            shown[0],
            shown[1],
            (shown[2] + shown[3] + shown[4]) / 3.0,
            shown[5],
            shown[7],
            row.false_faults,
            row.unmodelled,
            row.ambiguous,
            row.max_cost
        );
    }
    text
}

/// Our scores and the oracle's, `ours / oracle`.
fn rul_table(report: &RulReport) -> String {
    let mut text =
        "| histories | α-λ passed, % | horizon, % of life | cumulative relative accuracy | 80 % interval covers, % \
                    | convergence |\n|---|---|---|---|---|---|"
            .to_owned();
    let mut row = |name: &str, histories: usize, ours: &Scores, oracle: &Scores| {
        let percent = |of: fn(&Scores) -> f64| format!("{:.1} / {:.1}", 100.0 * of(ours), 100.0 * of(oracle));
        let share = |of: fn(&Scores) -> f64| format!("{:.3} / {:.3}", of(ours), of(oracle));
        text += &format!(
            "\n| {name} ({histories}) | {} | {} | {} | {} | {} |",
            percent(|s| s.alpha_lambda_pass_rate),
            percent(|s| s.prognostic_horizon_fraction),
            share(|s| s.cra),
            percent(|s| s.coverage_80),
            share(|s| s.convergence),
        );
    };
    for group in &report.groups {
        row(&group.name, group.histories, &group.scores, &group.oracle);
    }
    let all = report.histories_per_fault as usize * FAULTS;
    row("**all**", all, &report.scores, &report.oracle);
    text + "\n\nEach cell: this monitor / an oracle that knows the true law and how its parameters are distributed."
}
