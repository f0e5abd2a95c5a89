//! `hmd run`: the daemon.

use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::live::{report, stop_signal};
use super::table::{HEALTH_HEAD, health_row};
use super::{Exit, check_calibrations, load_config, use_threads};
use crate::daemon::{Daemon, DaemonError, Observer};
use crate::ingest::can::{CanSource, Wanted};
use crate::ingest::live::LiveSource;
use crate::ingest::serial::SerialSource;
use crate::judge::Judged;
use crate::record::HealthLine;
use crate::recorder::{Recorder, metadata};

/// Watch the actuators of a configuration until SIGINT or SIGTERM.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Configuration: the buses and what is on them.
    #[arg(short, long)]
    config: PathBuf,
    /// MCAP file for all records and frames.
    #[arg(short, long, value_name = "OUT.mcap")]
    output: Option<PathBuf>,
    /// One JSON line per window instead of a table.
    #[arg(long)]
    json: bool,
    /// Threads of the identification; all cores without it. The records are the same for any number.
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Seed of the search.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Runs the verb.
///
/// # Errors
/// A bad configuration, or an output that cannot be written. A bad bus is no error: it is waited for.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let config = Arc::new(load_config(Some(&args.config))?);
    check_calibrations(&config)?;
    use_threads(args.threads.map(usize::from))?;
    let interfaces = config.interfaces(&args.config.display().to_string())?;
    let sources = interfaces.iter().map(|name| {
        if let Some(line) = config.serial(name) {
            let source = SerialSource::new(&config.resolve(&line.device), line.bitrate_bit_s);
            return (name.to_owned(), LiveSource::Serial(source));
        }
        let on_it = config
            .actuators()
            .iter()
            .filter(|actuator| actuator.is_at(name, actuator.id));
        let wanted = Wanted::Actuators(on_it.map(|actuator| actuator.id).collect());
        (name.to_owned(), LiveSource::Can(CanSource::new(name, wanted)))
    });
    let sources = sources.collect();
    let recorder = match &args.output {
        Some(path) => Some(Recorder::create(path, &metadata(&config, "host", args.seed))?),
        None => None,
    };
    let printer = Printer {
        json: args.json,
        alone: recorder.is_none(),
        headed: AtomicBool::new(false),
        heard: AtomicBool::new(true),
    };
    let daemon = Daemon {
        sources,
        recorder,
        watch: Some((config, args.seed)),
    };
    match daemon.run(stop_signal(), &printer) {
        Ok(status) => Ok(report(&status)),
        Err(DaemonError::Stdout(e)) if e.kind() == io::ErrorKind::BrokenPipe => Ok(Exit::Done),
        Err(error) => Err(error.into()),
    }
}

struct Printer {
    json: bool,
    /// Nothing but stdout takes the records.
    alone: bool,
    headed: AtomicBool,
    /// Somebody reads stdout.
    heard: AtomicBool,
}

impl Observer for Printer {
    fn judged(&self, judged: &Judged) -> io::Result<()> {
        if !self.heard.load(Ordering::Relaxed) {
            return Ok(());
        }
        let mut out = io::stdout().lock();
        let printed = if self.json {
            writeln!(out, "{}", HealthLine::from((&judged.health, &judged.rul)).to_json())
        } else {
            let headed = self.headed.swap(true, Ordering::Relaxed);
            let head = if headed { Ok(()) } else { writeln!(out, "{HEALTH_HEAD}") };
            head.and_then(|()| writeln!(out, "{}", health_row(&judged.health)))
        };
        match printed.and_then(|()| out.flush()) {
            // The file still takes the records.
            Err(e) if e.kind() == io::ErrorKind::BrokenPipe && !self.alone => {
                self.heard.store(false, Ordering::Relaxed);
                Ok(())
            }
            other => other,
        }
    }

    fn notice(&self, message: &str) {
        eprintln!("{message}");
    }
}
