//! `hmd run`: the daemon. SIGHUP lets it go on with the configuration as it is then, unless that is a bad one.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::net::SocketAddr;
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anyhow::Context;

use super::journal::Journal;
use super::live::{STALLED, Signals, is_writable, report, tell};
use super::metrics_http::{self, Page, loopback};
use super::outputs::{Content, Outputs};
use super::requests::Request;
use super::serve::{Serve, Viewers};
use super::table::{HEALTH_HEAD, health_row};
use super::{Exit, Misuse, Settings, check_files_of_run, no_recording, sentence, service, to_stderr, use_threads};
use crate::daemon::{Daemon, DaemonError, Observer};
use hmd_core::assess::AssessedWindow;
use hmd_core::config::Config;
use hmd_core::config_warnings::bus_warnings;
use hmd_core::last_window::LastWindow;
use hmd_core::metrics::last_windows::LastWindows;
use hmd_core::metrics::{in_text_format, render};
use hmd_core::record::{HealthLine, LogLevel, Status};
use hmd_ingest::can::{CanSource, Wanted};
use hmd_ingest::live::LiveSource;
use hmd_ingest::serial::SerialSource;
use hmd_storage::calibration_file::{check_learn_folders, hash_of_models_of_run};
use hmd_storage::config_file;
use hmd_storage::history_file;
use hmd_storage::metrics_file::write_textfile;
use hmd_storage::printable;
use hmd_storage::recorder::{RecordError, Recorder, is_folder, metadata};
use hmd_storage::segment_store::is_segment_name;

/// Watch the actuators of a configuration until SIGINT or SIGTERM.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd run -c hmd.toml -o flight.mcap\n\
    \x20 hmd run -c /etc/hmd/hmd.toml -o /var/lib/hmd/ --metrics-listen 127.0.0.1:9464")]
pub struct Args {
    /// Configuration: the buses and what is on them.
    #[arg(short, long)]
    config: PathBuf,
    #[command(flatten)]
    settings: Settings,
    /// MCAP file for all records and frames, or a folder (it is one, or ends with "/") for segments that survive.
    #[arg(short, long, value_name = "OUT.mcap|FOLDER/")]
    output: Option<PathBuf>,
    /// Prometheus metrics as a text file, replaced every ten seconds.
    #[arg(long, value_name = "FILE.prom")]
    metrics: Option<PathBuf>,
    /// Serve the metrics at http://ADDRESS:PORT/metrics, for this computer alone.
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = loopback)]
    metrics_listen: Option<SocketAddr>,
    #[command(flatten)]
    serve: Serve,
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
/// A bad configuration at the start, or an output that cannot be written. A bad bus is no error: its source waits.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let mut config = load(&args.config, &args.settings.set)?;
    if let Some(output) = &args.output {
        no_recording(output)?;
    }
    check_outputs(args, &config)?;
    check_folders(&config, None)?;
    use_threads(args.threads.map(usize::from))?;
    let signals = Signals::listen().context("signals")?;
    let printer = Printer {
        json: args.json,
        alone: args.output.is_none(),
        headed: AtomicBool::new(false),
        read: AtomicBool::new(true),
        stopping: AtomicBool::new(false),
        metrics: args.metrics.clone(),
        metrics_failed: AtomicBool::new(false),
        page: args.metrics_listen.map(|_| Page::default()),
        journal: Journal::from_stderr(),
        last: Mutex::new(LastWindows::new(config.hash())),
    };
    if let (Some(address), Some(page)) = (args.metrics_listen, &printer.page) {
        let address =
            metrics_http::serve(address, page.clone()).with_context(|| format!("--metrics-listen {address}"))?;
        printer.notice(&format!("metrics: http://{address}/metrics"));
    }
    printer.warn_of_buses(&config);
    let viewers = args.serve.open(|message| printer.notice(message))?;
    let mut exit = Exit::Done;
    // Whatever lies at its place later.
    let is_file = args.output.as_deref().is_some_and(|path| !is_folder(path));
    let mut recorder = recorder(args, &config)?;
    loop {
        let mut next = None;
        let running = config.clone();
        let stop = async {
            next = new_config(args, &running, is_file, &signals, &printer).await;
        };
        match daemon(args, config, recorder, &viewers)?.run(stop, &printer) {
            Ok(status) if report(&status, true) == Exit::DataLost => exit = Exit::DataLost,
            Ok(_) => {}
            Err(DaemonError::Stdout(e)) if e.kind() == io::ErrorKind::BrokenPipe => return Ok(exit),
            Err(error) => return Err(error.into()),
        }
        match next {
            Some(new) => {
                config = new;
                printer.begin_again(&config);
                recorder = args.output.as_ref().map(|folder| {
                    Recorder::reopen_folder(folder, &run_metadata(args, &config), config.output().limits())
                });
                if recorder.as_ref().is_some_and(|recorder| !recorder.is_written()) {
                    // The watch goes on without its output, and the reload is over.
                    service::ready();
                }
            }
            None => {
                viewers.finish();
                return Ok(exit);
            }
        }
    }
}

/// Refuses to write over what the run reads, or metrics over anything else.
fn check_outputs(args: &Args, config: &Config) -> Result<(), Misuse> {
    let files = args.output.as_deref().filter(|path| !is_folder(path));
    let learnt = config
        .actuators()
        .iter()
        .filter_map(|actuator| config.learnt_file(actuator));
    let files = files.map(|path| (path, Content::Recording));
    let metrics = args.metrics.as_deref().map(|path| (path, Content::Metrics));
    let outputs: Vec<(&Path, Content)> = files.into_iter().chain(metrics).collect();
    Outputs(&outputs).check(config.files().into_iter().chain(learnt))?;
    let Some(metrics) = &args.metrics else { return Ok(()) };
    let name = metrics.file_name().and_then(|name| name.to_str());
    if name.is_some_and(is_segment_name) {
        return Err(Misuse(format!(
            "--metrics: expected a file of metrics, or none yet, found {}",
            metrics.display()
        )));
    }
    Ok(())
}

/// The configuration, if the daemon can run with it.
///
/// # Errors
/// It cannot be read, names files that cannot be used, or no interface.
pub fn load(path: &Path, settings: &[String]) -> anyhow::Result<Arc<Config>> {
    let config = config_file::load_config_with(Some(path), settings)?;
    check_files_of_run(&config, &mut to_stderr)?;
    config.interfaces(&path.display().to_string())?;
    Ok(Arc::new(config))
}

/// Whether what is learnt of units can be kept where the configuration says; `running` is that of the run that this process ends for it.
fn check_folders(config: &Config, running: Option<&Config>) -> Result<(), DaemonError> {
    let state = |config: &Config| config.rul().state.as_ref().map(|path| config.resolve(path));
    if let Some(folder) = state(config) {
        history_file::check(&folder, running.and_then(state).as_deref())
            .and_then(|()| history_file::check_readable(&folder, config))
            .map_err(DaemonError::State)?;
    }
    check_learn_folders(config).map_err(|(actuator, cause)| DaemonError::LearnFolder { actuator, cause })
}

/// Waits until the daemon shall stop (`None`), or go on with another configuration. A bad one changes nothing.
async fn new_config(
    args: &Args,
    running: &Config,
    is_file: bool,
    signals: &Signals,
    printer: &Printer,
) -> Option<Arc<Config>> {
    while signals.next().await == Request::Reload {
        service::reloading();
        if is_file {
            printer.notice_with_level(
                LogLevel::Error,
                "not reloaded: the output is one file, which belongs to one configuration",
            );
        } else {
            // What a start would refuse is refused before the run ends that would have to go on.
            let usable = load(&args.config, &args.settings.set).and_then(|config| {
                check_folders(&config, Some(running))?;
                Ok(config)
            });
            match usable {
                // Ready again once it runs.
                Ok(config) => return Some(config),
                Err(error) => printer.notice_with_level(
                    LogLevel::Error,
                    &format!("not reloaded, the configuration stays as it was: {}", sentence(&error)),
                ),
            }
        }
        service::ready();
    }
    printer.stopping.store(true, Ordering::Relaxed);
    service::stopping();
    None
}

fn run_metadata(args: &Args, config: &Config) -> BTreeMap<String, String> {
    let mut metadata = metadata(config, "host", args.seed);
    metadata.insert("model_hash".to_owned(), hash_of_models_of_run(config));
    metadata
}

/// The output of the first configuration, if there is one.
fn recorder(args: &Args, config: &Config) -> Result<Option<Recorder>, RecordError> {
    let Some(path) = &args.output else { return Ok(None) };
    Recorder::open(path, &run_metadata(args, config), config.output().limits()).map(Some)
}

fn daemon(args: &Args, config: Arc<Config>, recorder: Option<Recorder>, viewers: &Viewers) -> anyhow::Result<Daemon> {
    let interfaces = config.interfaces(&args.config.display().to_string())?;
    let sources = interfaces.iter().map(|name| {
        if let Some(line) = config.serial(name) {
            let source = SerialSource::new(&config.resolve(&line.device), line.bitrate_bit_s);
            return (name.to_owned(), LiveSource::Serial(source));
        }
        let wanted = Wanted::for_interface(&config, name);
        (name.to_owned(), LiveSource::Can(CanSource::new(name, wanted)))
    });
    let sources = sources.collect();
    let recorder = match viewers.observer() {
        Some(observer) => Some(recorder.unwrap_or_else(Recorder::nowhere).with_observer(observer)),
        None => recorder,
    };
    Ok(Daemon {
        sources,
        recorder,
        watch: Some((config, args.seed)),
    })
}

/// Time between two looks whether a stop was asked for, while nobody reads stdout.
const LOOK_EVERY: Duration = Duration::from_millis(100);

struct Printer {
    json: bool,
    /// Nothing but stdout takes the records.
    alone: bool,
    headed: AtomicBool,
    /// Stdout is read.
    read: AtomicBool,
    /// A stop was asked for: nothing waits for ever any more.
    stopping: AtomicBool,
    metrics: Option<PathBuf>,
    /// The last metrics could not be written; reported once.
    metrics_failed: AtomicBool,
    /// What is served over HTTP, if anything.
    page: Option<Page>,
    /// Where stderr is the journal.
    journal: Option<Journal>,
    /// For the metrics.
    last: Mutex<LastWindows>,
}

impl Printer {
    /// With another configuration.
    fn begin_again(&self, config: &Config) {
        let hash = config.hash();
        self.notice(&format!("reloaded, configuration {hash}"));
        self.warn_of_buses(config);
        *self.last_windows() = LastWindows::new(hash);
    }

    fn warn_of_buses(&self, config: &Config) {
        for warning in bus_warnings(config) {
            self.notice_with_level(LogLevel::Warning, &warning);
        }
    }

    /// Waits until a stream can be written to: no longer than `stalled` where the records go to an output as well, or once a stop was asked for. The
    /// assessment waits for it. Whether it can.
    fn waits_for_reader(&self, stream: impl AsFd, stalled: Duration) -> bool {
        let mut since = Instant::now();
        let mut was_stopping = false;
        while !is_writable(&stream, LOOK_EVERY) {
            let is_stopping = self.stopping.load(Ordering::Relaxed);
            if is_stopping && !was_stopping && self.alone {
                since = Instant::now();
            }
            was_stopping = is_stopping;
            if (!self.alone || is_stopping) && since.elapsed() >= stalled {
                return false;
            }
        }
        true
    }

    fn last_windows(&self) -> MutexGuard<'_, LastWindows> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Observer for Printer {
    fn assessed(&self, assessed: &AssessedWindow) -> io::Result<()> {
        self.last_windows()
            .update(&assessed.health, &assessed.rul, &assessed.in_a_row);
        if !self.read.load(Ordering::Relaxed) {
            return Ok(());
        }
        if !self.waits_for_reader(io::stdout(), STALLED) {
            self.read.store(false, Ordering::Relaxed);
            let left = if self.alone {
                "the last records are not written"
            } else {
                "the records go to the output alone"
            };
            self.notice_with_level(LogLevel::Error, &format!("stdout: not read for {STALLED:?}; {left}"));
            return Ok(());
        }
        let mut out = io::stdout().lock();
        let printed = if self.json {
            writeln!(out, "{}", HealthLine::from((&assessed.health, &assessed.rul)).to_json())
        } else {
            let headed = self.headed.swap(true, Ordering::Relaxed);
            let head = if headed { Ok(()) } else { writeln!(out, "{HEALTH_HEAD}") };
            head.and_then(|()| writeln!(out, "{}", health_row(&assessed.health)))
        };
        match printed.and_then(|()| out.flush()) {
            // The output still takes the records.
            Err(e) if !self.alone => {
                self.read.store(false, Ordering::Relaxed);
                if e.kind() != io::ErrorKind::BrokenPipe {
                    self.notice_with_level(
                        LogLevel::Error,
                        &format!("stdout: {e}; the records go to the output alone"),
                    );
                }
                Ok(())
            }
            other => other,
        }
    }

    fn resumed(&self, actuator: &str, last: LastWindow) {
        self.last_windows().resume(actuator, last);
    }

    fn notice(&self, message: &str) {
        self.notice_with_level(LogLevel::Info, message);
    }

    fn notice_with_level(&self, level: LogLevel, message: &str) {
        let message = &printable(message);
        if !self
            .journal
            .as_ref()
            .is_some_and(|journal| journal.write(level, message))
        {
            tell(message);
        }
    }

    fn status(&self, status: &Status) {
        if self.metrics.is_none() && self.page.is_none() {
            return;
        }
        let metrics = render(status, &self.last_windows());
        if let Some(page) = &self.page {
            page.set(metrics.clone());
        }
        let Some(path) = &self.metrics else { return };
        let written = write_textfile(path, &in_text_format(&metrics));
        let failed_before = self.metrics_failed.swap(written.is_err(), Ordering::Relaxed);
        if let Err(cause) = written
            && !failed_before
        {
            self.notice_with_level(
                LogLevel::Error,
                &format!("{}: metrics cannot be written: {cause}", path.display()),
            );
        }
    }

    fn failed(&self, status: &Status) {
        report(status, true);
    }

    fn ready(&self) {
        service::ready();
    }

    fn heartbeat(&self) {
        service::heartbeat();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_does_not_wait_for_a_reader_for_ever() {
        let stalled = Duration::from_millis(500);
        let (reader, mut writer) = io::pipe().unwrap();
        while is_writable(&writer, Duration::from_millis(10)) {
            writer.write_all(&[b'x'; 4096]).unwrap();
        }
        let printer = Printer {
            json: true,
            alone: true,
            headed: AtomicBool::new(false),
            read: AtomicBool::new(true),
            stopping: AtomicBool::new(false),
            metrics: None,
            metrics_failed: AtomicBool::new(false),
            page: None,
            journal: None,
            last: Mutex::new(LastWindows::default()),
        };
        std::thread::scope(|scope| {
            let waiting = scope.spawn(|| (printer.waits_for_reader(&writer, stalled), Instant::now()));
            // Without a stop it waits for whoever reads, however long.
            std::thread::sleep(stalled + Duration::from_secs(1));
            assert!(!waiting.is_finished());
            let stopped = Instant::now();
            printer.stopping.store(true, Ordering::Relaxed);
            let (is_read, ended) = waiting.join().unwrap();
            assert!(!is_read && ended - stopped >= stalled);
        });
        drop(reader);
        assert!(printer.waits_for_reader(&writer, stalled));
    }
}
