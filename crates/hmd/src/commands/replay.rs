//! `hmd replay`: the pipeline over recorded logs.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use indicatif::ProgressBar;
use serde::Serialize;

use super::outputs::{Content, Outputs};
use super::recordings::{Wanted, recordings};
use super::serve::{Serve, Viewers};
use super::table::{HEALTH_HEAD, health_row};
use super::{Exit, Misuse, Settings, check_files, load_config_with, progress, to_stderr, use_threads, warn};
use crate::replay::{Observer, Replay};
use hmd_core::assess::AssessedWindow;
use hmd_core::config::Config;
use hmd_core::frame::BusNames;
use hmd_core::record::HealthLine;
use hmd_ingest::file::open_mapped;

/// Assess recorded logs.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd replay flight.log\n\
    \x20 hmd replay monday.mcap tuesday.mcap -c hmd.toml -o week.mcap\n\
    \x20 hmd replay flight.log --json > flight.jsonl")]
pub struct Args {
    /// Logs in the order of time, or folders of them: candump text, MCAP, ASC, BLF, MF4, CSV or Parquet.
    #[arg(required = true)]
    logs: Vec<PathBuf>,
    /// Configuration; without it every actuator seen is one of the bench.
    #[arg(short, long)]
    config: Option<PathBuf>,
    #[command(flatten)]
    settings: Settings,
    /// MCAP file for all records.
    #[arg(short, long, value_name = "OUT.mcap")]
    output: Option<PathBuf>,
    /// One JSON line per window instead of a table.
    #[arg(long)]
    json: bool,
    /// Add to each line the time since the line before: reading and identification.
    #[arg(long)]
    timings: bool,
    /// Threads; all cores without it. The records are the same for any number.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Seed of the search.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    serve: Serve,
}

/// Runs the verb.
///
/// # Errors
/// A bad configuration, a log that cannot be read at all or holds no actuator, an output that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let input = Input::checked(args)?;
    let viewers = args.serve.open(|message| warn(message))?;
    viewers.wait()?;
    let exit = replay(args, input, &viewers)?;
    viewers.stay(|message| warn(message))?;
    viewers.finish();
    Ok(exit)
}

/// What a replay reads.
struct Input {
    config: Arc<Config>,
    logs: Vec<PathBuf>,
}

impl Input {
    /// Configuration and logs, as far as they can be checked before the first viewer comes.
    fn checked(args: &Args) -> anyhow::Result<Self> {
        let config = Arc::new(load_config_with(args.config.as_deref(), &args.settings)?);
        let logs = recordings(&args.logs, Wanted::Logs)?;
        if let Some(output) = &args.output {
            check_output(output, &logs, &config)?;
        }
        check_files(&config, &mut to_stderr)?;
        if let Some(log) = logs.first().filter(|_| args.serve.is_asked_for()) {
            open_mapped(log, BusNames::new(), &config)?;
        }
        Ok(Self { config, logs })
    }
}

/// Names that ask for what other verbs make of a recording, or that logs have which it is not.
const OTHER_FORMS: [&str; 12] = [
    "csv", "parquet", "html", "json", "jsonl", "toml", "log", "asc", "blf", "mf4", "txt", "pdf",
];

/// Refuses a recording in the place of a file that the replay reads, or under the name of another kind of file.
///
/// # Errors
/// Such an output.
pub fn check_output(output: &Path, logs: &[PathBuf], config: &Config) -> anyhow::Result<()> {
    let extension = output.extension().and_then(|extension| extension.to_str());
    if extension.is_some_and(|of| OTHER_FORMS.iter().any(|form| of.eq_ignore_ascii_case(form))) {
        let found = output.display();
        return Err(Misuse(format!(
            "--output: expected a name that ends in .mcap, found {found}; hmd export and hmd report make other forms of it"
        ))
        .into());
    }
    let learnt = config.actuators().iter();
    let learnt = learnt.filter_map(|actuator| config.learnt_file(actuator));
    Outputs(&[(output, Content::Recording)]).check(logs.iter().cloned().chain(config.files()).chain(learnt))?;
    Ok(())
}

fn replay(args: &Args, input: Input, viewers: &Viewers) -> anyhow::Result<Exit> {
    let Input { config, logs } = input;
    use_threads(args.threads.map(usize::from))?;
    let total = logs.iter().filter_map(|log| log.metadata().ok()).map(|m| m.len()).sum();
    let mut printer = Printer {
        json: args.json,
        timings: args.timings,
        bar: progress::over_bytes(total),
        since: Instant::now(),
        headed: false,
        alone: args.output.is_none(),
        heard: true,
    };
    let replay = Replay {
        logs: &logs,
        output: args.output.as_deref(),
        config,
        seed: args.seed,
    };
    let summary = replay.run_observed(&mut printer, viewers.observer());
    printer.bar.finish_and_clear();
    let summary = summary?;

    summary.check(&logs, &replay.config)?;
    let logs: Vec<String> = logs.iter().map(|log| log.display().to_string()).collect();
    let logs = logs.join(", ");
    if summary.windows == 0 {
        let samples = summary.status.samples;
        warn(format_args!(
            "{logs}: expected an actuation, found none in {samples} samples: a setpoint that rests and then moves, in a \
             mode that is not idle"
        ));
    }
    if let Some(loss) = summary.loss() {
        warn(format_args!("{logs}: {loss}"));
        return Ok(Exit::DataLost);
    }
    Ok(Exit::Done)
}

struct Printer {
    json: bool,
    timings: bool,
    bar: ProgressBar,
    since: Instant,
    headed: bool,
    /// Nothing but stdout takes the records.
    alone: bool,
    /// Somebody reads stdout.
    heard: bool,
}

#[derive(Serialize)]
struct Timed<'a> {
    #[serde(flatten)]
    line: HealthLine<'a>,
    elapsed_ms: f64,
}

impl Observer for Printer {
    fn assessed(&mut self, assessed: &AssessedWindow) -> io::Result<()> {
        if !self.heard {
            return Ok(());
        }
        let elapsed_ms = self.since.elapsed().as_secs_f64() * 1e3;
        let line = HealthLine::from((&assessed.health, &assessed.rul));
        let text = match (self.json, self.timings) {
            (true, false) => line.to_json(),
            (true, true) => serde_json::to_string(&Timed { line, elapsed_ms })?,
            (false, false) => health_row(&assessed.health),
            (false, true) => format!("{} [{elapsed_ms:.0} ms]", health_row(&assessed.health)),
        };
        let (json, headed) = (self.json, std::mem::replace(&mut self.headed, true));
        let printed = self.bar.suspend(|| {
            let mut out = io::stdout().lock();
            if !json && !headed {
                writeln!(out, "{HEALTH_HEAD}")?;
            }
            writeln!(out, "{text}")
        });
        self.since = Instant::now();
        match printed {
            // The output file is still to be finished.
            Err(e) if e.kind() == io::ErrorKind::BrokenPipe && !self.alone => {
                self.heard = false;
                Ok(())
            }
            Err(e) if e.kind() == io::ErrorKind::BrokenPipe => std::process::exit(0),
            other => other,
        }
    }

    fn notice(&mut self, message: &str) {
        self.bar.suspend(|| warn(message));
    }

    fn progress(&mut self, position: u64) {
        self.bar.set_position(position);
    }
}
