//! Live driver: sources on the I/O thread, the pipeline on a second, identification on a third.
//!
//! ```text
//! sources ──Input──▶ pipeline ──WindowJob──▶ identification
//!  (tokio)  waits     └─ raw frames ─▶ recorder ◀─ records ─┘
//! ```
//!
//! Frames are never dropped between socket and windower: a full queue makes the sources wait ([`QUEUE_INPUTS`]), and what
//! the kernel must then drop, it counts. Windows are dropped, the oldest first, when identification cannot keep up
//! ([`QUEUE_WINDOWS`]); that is recorded, and replay leaves them out as well. Nothing else depends on time, so the recorded
//! frames, replayed, give the same health records.

mod freshness;
mod monitor;
mod notices;
mod standing;
mod window_queue;
#[cfg(test)]
mod window_queue_tests;

/// What the queue of windows locks with.
mod sync {
    pub(super) use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
}

use std::future::Future;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;

pub use freshness::STALE_AFTER;
use hmd_core::assess::{AssessError, AssessedWindow, Assessor, WindowCounts};
use hmd_core::config::Config;
use hmd_core::demux::{Notice, WindowJob};
use hmd_core::frame::{BusError, BusNames};
use hmd_core::pipeline::Pipeline;
use hmd_core::record::{LogLevel, Status};
use hmd_ingest::feed::{Feed, Input, QUEUE_INPUTS};
use hmd_ingest::live::LiveSource;
use hmd_storage::calibration_file::load_models;
use hmd_storage::clock::now_ns;
use hmd_storage::event_file::events_of;
use hmd_storage::history_file;
use hmd_storage::recorder::{RecordError, Recorder};
use monitor::{Monitor, tell, tell_last_summaries, tell_unless_many};
use notices::Notices;
use standing::Standings;
pub use window_queue::QUEUE_WINDOWS;

type WindowQueue = window_queue::WindowQueue<WindowJob>;

/// Time between two ticks, each of which reports fresh losses.
const TICK: Duration = Duration::from_secs(1);

/// Why the daemon ended.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    /// The I/O runtime or a thread cannot be started.
    #[error("cannot start: {0}")]
    Start(io::Error),
    /// An interface has an impossible name, or there are too many.
    #[error("interface {name:?}: {cause}")]
    Interface {
        /// Its name.
        name: String,
        /// Why it is refused.
        cause: BusError,
    },
    /// The windows cannot be judged.
    #[error(transparent)]
    Assess(#[from] AssessError),
    /// The records cannot be written.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// Stdout cannot be written.
    #[error("stdout: {0}")]
    Stdout(io::Error),
}

/// What is told while the daemon runs; from several threads.
pub trait Observer: Sync {
    /// One window has been judged, and its records, if any are kept, are on the disk.
    ///
    /// # Errors
    /// When nobody takes the records any more; the daemon then ends.
    fn judged(&self, judged: &AssessedWindow) -> io::Result<()>;
    /// One window has been judged, but its records could not be stored; by default told like any other.
    ///
    /// # Errors
    /// As [`Observer::judged`].
    fn unstored(&self, judged: &AssessedWindow) -> io::Result<()> {
        self.judged(judged)
    }
    /// Something an operator should read.
    fn notice(&self, message: &str);
    /// The same with how grave it is; by default that is left out.
    fn notice_of(&self, _: LogLevel, message: &str) {
        self.notice(message);
    }
    /// The counters as they are recorded, with those of the storage: every ten seconds, and at the end.
    fn status(&self, _: &Status) {}
    /// Every source has said how it stands, and the output is open: once.
    fn ready(&self) {}
    /// Ingest, pipeline, writer and identification have all made progress; about every second, and not otherwise.
    fn alive(&self) {}
}

/// What a live run is made of.
pub struct Daemon {
    /// Sources with the names of their buses.
    pub sources: Vec<(String, LiveSource)>,
    /// Where records go, if anywhere.
    pub recorder: Option<Recorder>,
    /// What is watched, with the seed of every search; `None` captures alone.
    pub watch: Option<(Arc<Config>, u64)>,
}

/// What pipeline and identification share.
struct Shared {
    recorder: Option<Recorder>,
    windows: WindowCounts,
    /// Time spent on identification, and the longest that one window took.
    judging: (Duration, Duration),
    /// When the newest health record was stored, or told where nothing is stored.
    last_record: Option<Instant>,
    /// What the verdicts made of the actuators.
    standings: Standings,
    /// Which notices were told lately, by either thread.
    notices: Notices,
}

impl Daemon {
    /// Runs until `shutdown` resolves or every source has ended; then judges what is waiting and ends the file.
    ///
    /// # Errors
    /// [`DaemonError`]; the record file is then ended as far as it goes.
    pub fn run(self, shutdown: impl Future<Output = ()>, observer: &impl Observer) -> Result<Status, DaemonError> {
        let mut names = BusNames::new();
        let mut sources = Vec::new();
        for (name, source) in self.sources {
            let bus = names
                .intern(&name)
                .map_err(|cause| DaemonError::Interface { name, cause })?;
            sources.push((bus, source));
        }
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(DaemonError::Start)?;
        let shared = Mutex::new(Shared {
            recorder: self.recorder,
            windows: WindowCounts::default(),
            judging: (Duration::ZERO, Duration::ZERO),
            last_record: None,
            standings: Standings::default(),
            notices: Notices::default(),
        });
        let windows = WindowQueue::new();
        let (queue, inputs) = mpsc::channel(QUEUE_INPUTS);
        let pipeline = match &self.watch {
            Some((config, _)) => Pipeline::new(config.clone()),
            None => Pipeline::capture(),
        };
        let store_raw = self.watch.as_ref().is_none_or(|(config, _)| config.output().raw_frames);
        let config = self.watch.as_ref().map(|(config, _)| config.clone());
        let mut monitor = Monitor::new(pipeline, names, store_raw, config);
        let assessor = match self.watch {
            Some((config, seed)) => Some(ready_assessor(config, seed)?),
            None => None,
        };

        let (watched, judged) = thread::scope(|scope| {
            let (windows, shared) = (&windows, &shared);
            let judging = assessor.map(|(judge, config)| {
                scope.spawn(move || {
                    let _closed = CloseAtEnd(windows);
                    judge_all(judge, &config, windows, shared, observer)
                })
            });
            let watching = scope.spawn(|| {
                let _closed = CloseAtEnd(windows);
                monitor.run(inputs, windows, shared, observer)
            });
            runtime.block_on(receive(sources, queue, shutdown));
            (join(watching), judging.map_or(Ok(()), join))
        });
        let mut shared = shared.into_inner().unwrap_or_else(PoisonError::into_inner);
        let told = tell_last_summaries(&mut shared, observer);
        let mut status = monitor.status(&shared);
        let written = shared.recorder.map_or(Ok(None), |mut recorder| {
            recorder.status(now_ns(), &status)?;
            recorder.finish()
        });
        // The file is ended whatever went wrong before; the first error is the one to tell.
        judged?;
        watched?;
        told?;
        if let Some(store) = written? {
            status.set_storage(&store.status);
            for (level, message) in store.messages {
                observer.notice_of(level, &message);
            }
        }
        observer.status(&status);
        Ok(status)
    }
}

/// Runs the sources until the shutdown, or until all have ended.
async fn receive(sources: Vec<(u16, LiveSource)>, queue: mpsc::Sender<Input>, shutdown: impl Future<Output = ()>) {
    let (close, closing) = watch::channel(false);
    let mut tasks = JoinSet::new();
    for (bus, source) in sources {
        tasks.spawn(source.run(Feed::new(bus, queue.clone(), closing.clone())));
    }
    let tick = async {
        let mut interval = tokio::time::interval(TICK);
        loop {
            interval.tick().await;
            let stamp_ns = now_ns();
            if queue.send(Input::Tick { stamp_ns }).await.is_err() {
                return;
            }
        }
    };
    tokio::select! {
        () = shutdown => {}
        () = async { while tasks.join_next().await.is_some() {} } => {}
        () = tick => {}
    }
    // A source ends as soon as it notices; what it has received by then it still sends.
    let _ = close.send(true);
    while tasks.join_next().await.is_some() {}
}

/// Closes the queue however its thread ends, so that a panic does not leave the other one waiting for ever.
struct CloseAtEnd<'a>(&'a WindowQueue);

impl Drop for CloseAtEnd<'_> {
    fn drop(&mut self) {
        self.0.close();
    }
}

/// An assessor with its models and the histories of earlier runs; the notices of unusable histories come with the first window.
fn ready_assessor(config: Arc<Config>, seed: u64) -> Result<(Assessor, Arc<Config>), AssessError> {
    let mut assessor = Assessor::new(config.clone(), load_models(&config)?, seed);
    if let Some(directory) = config.rul().state.as_ref().map(|path| config.resolve(path)) {
        history_file::restore_all(&directory, &config, assessor.lives());
    }
    Ok((assessor, config))
}

/// The dear half, on a thread of its own.
fn judge_all(
    mut judge: Assessor,
    config: &Config,
    windows: &WindowQueue,
    shared: &Mutex<Shared>,
    observer: &impl Observer,
) -> Result<(), DaemonError> {
    let histories = config.rul().state.as_ref().map(|path| config.resolve(path));
    while let Some(job) = windows.pop() {
        // Events may have come since the last window; the file is short. One that is damaged does not end the watch.
        let events = match events_of(config) {
            Ok(events) => {
                judge.lives().follow(events);
                None
            }
            Err(error) => Some(format!("rul.events: {error}")),
        };
        let since = Instant::now();
        let passive = job.actuator.passive;
        let judged = judge.assess(job)?;
        let took = since.elapsed();
        // Before the lock is taken: frames need not wait for this file.
        let saved = match (&histories, judge.lives().get(&judged.health.actuator)) {
            (Some(directory), Some(history)) => history_file::save(directory, &judged.health.actuator, history),
            _ => Ok(()),
        };
        let troubles = events.into_iter().chain(saved.err().map(|error| error.to_string()));
        let pending = judge.lives().pending(&judged.health.actuator);
        let of_life: Vec<String> = judge.lives().take_notices().into_iter().chain(troubles).collect();
        let stored = {
            let mut shared = lock(shared);
            shared.windows = judge.counts();
            let (total, longest) = shared.judging;
            shared.judging = (total + took, longest.max(took));
            // The same trouble may come with every window.
            for message in of_life {
                let stamp_ns = judged.health.t_start_ns;
                tell_unless_many(&Notice { stamp_ns, message }, LogLevel::Warning, &mut shared, observer)?;
            }
            if let Some((level, message)) = shared.standings.take(&judged.health, pending, passive) {
                let stamp_ns = judged.health.t_start_ns;
                tell(&Notice { stamp_ns, message }, level, &mut shared, observer)?;
            }
            let (mut stored, mut messages) = (true, Vec::new());
            if let Some(recorder) = &mut shared.recorder {
                // At the end there are no ticks any more, and the storage is tended here.
                if windows.is_closed() {
                    messages = recorder.tick(Instant::now())?;
                }
                stored = recorder.judged(&judged)?;
                messages.append(&mut recorder.take_messages());
            }
            // Said before the line of a window that is not stored.
            for (level, message) in messages {
                let stamp_ns = now_ns();
                tell(&Notice { stamp_ns, message }, level, &mut shared, observer)?;
            }
            if stored {
                shared.last_record = Some(Instant::now());
            }
            stored
        };
        if windows.is_closed() {
            // There are no ticks any more.
            observer.alive();
        }
        // Told only now: what was told as judged is on the disk.
        let told = if stored {
            observer.judged(&judged)
        } else {
            observer.unstored(&judged)
        };
        told.map_err(DaemonError::Stdout)?;
    }
    Ok(())
}

/// A panic elsewhere leaves whole records behind; it is passed on when the threads are joined.
fn lock(shared: &Mutex<Shared>) -> MutexGuard<'_, Shared> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

fn join<T>(thread: thread::ScopedJoinHandle<'_, T>) -> T {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}
