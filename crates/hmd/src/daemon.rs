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
mod health_tracker;
mod notices;
mod pipeline_thread;
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
use health_tracker::HealthTracker;
use hmd_core::assess::{AssessError, AssessedWindow, Assessor, WindowCounts};
use hmd_core::config::Config;
use hmd_core::deadline::{Clock, Turns};
use hmd_core::frame::{BusError, BusNames};
use hmd_core::learning::Learner;
use hmd_core::outbox::{Notice, WindowJob};
use hmd_core::pipeline::Pipeline;
use hmd_core::record::{LogLevel, Status};
use hmd_ingest::feed::{Feed, Input, QUEUE_INPUTS};
use hmd_ingest::live::LiveSource;
use hmd_storage::calibration_file::{load_learnt, load_models, save_learnt};
use hmd_storage::clock::now_ns;
use hmd_storage::event_file::load_events;
use hmd_storage::history_file;
use hmd_storage::recorder::{RecordError, Recorder};
use notices::Notices;
use pipeline_thread::{PipelineThread, publish, publish_last_summaries, publish_rate_limited};
pub use window_queue::QUEUE_WINDOWS;

type WindowQueue = window_queue::WindowQueue<WaitingWindow>;

/// A window that waits for identification.
struct WaitingWindow {
    job: WindowJob,
    /// When its last sample arrived.
    arrived: Duration,
}

/// The computer's own clock.
struct SteadyClock(Instant);

impl Clock for SteadyClock {
    fn now(&self) -> Duration {
        self.0.elapsed()
    }
}

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
    /// The windows cannot be assessed.
    #[error(transparent)]
    Assess(#[from] AssessError),
    /// The records cannot be written.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// Stdout cannot be written.
    #[error("stdout: {0}")]
    Stdout(io::Error),
}

/// Receives what happens while the daemon runs; called from several threads.
pub trait Observer: Sync {
    /// One window is assessed, and its records, if any are kept, are on the disk.
    ///
    /// # Errors
    /// When the records cannot be delivered any more; the daemon then ends.
    fn assessed(&self, assessed: &AssessedWindow) -> io::Result<()>;
    /// One window is assessed, but its records could not be stored; by default reported like any other.
    ///
    /// # Errors
    /// As [`Observer::assessed`].
    fn assessed_unstored(&self, assessed: &AssessedWindow) -> io::Result<()> {
        self.assessed(assessed)
    }
    /// A notice for an operator.
    fn notice(&self, message: &str);
    /// The same with its level; by default the level is left out.
    fn notice_with_level(&self, _: LogLevel, message: &str) {
        self.notice(message);
    }
    /// The counters as they are recorded, with those of the storage: every ten seconds, and at the end.
    fn status(&self, _: &Status) {}
    /// Every source has reported its state, and the output was written to; called once.
    fn ready(&self) {}
    /// Ingest, pipeline, writer and identification have all made progress; about every second, and not otherwise.
    fn heartbeat(&self) {}
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
    assessing: (Duration, Duration),
    /// When the newest health record was stored, or reported where nothing is stored.
    last_record: Option<Instant>,
    /// Health of the actuators by their assessments.
    health_tracker: HealthTracker,
    /// Notices published lately, by either thread.
    notices: Notices,
}

impl Daemon {
    /// Runs until `shutdown` resolves or every source has ended; then assesses the windows that wait and ends the file.
    ///
    /// # Errors
    /// [`DaemonError`]; the record file is then ended as far as it goes.
    pub fn run(self, shutdown: impl Future<Output = ()>, observer: &impl Observer) -> Result<Status, DaemonError> {
        self.run_by(&SteadyClock(Instant::now()), shutdown, observer)
    }

    /// The same with deadlines by another clock.
    ///
    /// # Errors
    /// As [`Daemon::run`].
    pub fn run_by(
        self,
        clock: &(impl Clock + Sync),
        shutdown: impl Future<Output = ()>,
        observer: &impl Observer,
    ) -> Result<Status, DaemonError> {
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
            assessing: (Duration::ZERO, Duration::ZERO),
            last_record: None,
            health_tracker: HealthTracker::default(),
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
        let mut pipeline_thread = PipelineThread::new(pipeline, names, store_raw, config);
        let assessor = match self.watch {
            Some((config, seed)) => Some((
                ready_assessor(config.clone(), seed)?,
                Learner::new(config.clone(), seed),
                config,
            )),
            None => None,
        };

        let (watched, assessed) = thread::scope(|scope| {
            let (windows, shared) = (&windows, &shared);
            let named = |name: &str| thread::Builder::new().name(name.to_owned());
            // The first to start: it ends with the sources if the other one cannot start.
            let watching = named("pipeline")
                .spawn_scoped(scope, || {
                    let _closed = CloseAtEnd(windows);
                    pipeline_thread.run(inputs, windows, clock, shared, observer)
                })
                .map_err(DaemonError::Start)?;
            let assessing = assessor.map(|(assessor, learner, config)| {
                named("identification").spawn_scoped(scope, move || {
                    let _closed = CloseAtEnd(windows);
                    assess_windows(assessor, learner, &config, windows, clock, shared, observer)
                })
            });
            let assessing = assessing.transpose().map_err(DaemonError::Start)?;
            runtime.block_on(receive(sources, queue, shutdown));
            Ok::<_, DaemonError>((join(watching), assessing.map_or(Ok(()), join)))
        })?;
        let mut shared = shared.into_inner().unwrap_or_else(PoisonError::into_inner);
        let published = publish_last_summaries(&mut shared, observer);
        let mut status = pipeline_thread.status(&shared);
        let written = shared.recorder.map_or(Ok(None), |mut recorder| {
            recorder.write_status(now_ns(), &status)?;
            recorder.finish()
        });
        // The file is ended whatever went wrong before; the first error is returned.
        assessed?;
        watched?;
        published?;
        if let Some(store) = written? {
            status.set_storage(&store.status);
            for (level, message) in store.messages {
                observer.notice_with_level(level, &message);
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

/// An assessor with its models, and the units and histories of earlier runs; the notices of unusable histories come with the first
/// window.
fn ready_assessor(config: Arc<Config>, seed: u64) -> Result<Assessor, AssessError> {
    let mut assessor = Assessor::new(config.clone(), load_models(&config)?, seed);
    if let Some(directory) = config.rul().state.as_ref().map(|path| config.resolve(path)) {
        history_file::restore_all(&directory, &config, assessor.histories());
    }
    for (_, actuator, unit) in load_learnt(&config)? {
        assessor.set_unit(&actuator.name, unit);
    }
    Ok(assessor)
}

/// Assesses the windows of the queue until it is closed. CPU-bound; runs on the identification thread.
fn assess_windows(
    mut assessor: Assessor,
    mut learner: Learner,
    config: &Config,
    windows: &WindowQueue,
    clock: &impl Clock,
    shared: &Mutex<Shared>,
    observer: &impl Observer,
) -> Result<(), DaemonError> {
    let mut turns = Turns::new(config, clock);
    if let Some(actuator) = config.actuators().first() {
        turns
            .measure(|effort| assessor.rehearse(actuator, effort))
            .transpose()?;
    }
    let histories = config.rul().state.as_ref().map(|path| config.resolve(path));
    while let Some(WaitingWindow { job, arrived }) = windows.pop() {
        // Events may have come since the last window; the file is short. One that is damaged does not end the watch.
        let events = match load_events(config) {
            Ok(events) => {
                assessor.histories().set_events(events);
                None
            }
            Err(error) => Some(format!("rul.events: {error}")),
        };
        let since = Instant::now();
        let passive = job.actuator.passive;
        let assessed = turns.take(
            arrived,
            || windows.look(|waiting| waiting.iter().map(|waiting| waiting.arrived).collect()),
            |limit| learner.assess(&mut assessor, job, limit),
        )?;
        let commissioned = learner.commission_complete(&mut assessor)?;
        let took = since.elapsed();
        // Before the lock is taken: frames need not wait for this file.
        let saved = match (&histories, assessor.histories().get(&assessed.health.actuator)) {
            (Some(directory), Some(history)) => history_file::save(directory, &assessed.health.actuator, history),
            _ => Ok(()),
        };
        // A unit that cannot be kept is assessed by what was learnt all the same, until the run ends.
        let kept = learner.take_learnt();
        let unkept: Vec<String> = kept
            .iter()
            .filter_map(|learnt| save_learnt(config, learnt).err())
            .map(|error| error.to_string())
            .collect();
        let troubles = events
            .into_iter()
            .chain(saved.err().map(|error| error.to_string()))
            .chain(unkept);
        let pending = assessor.histories().pending(&assessed.health.actuator);
        let notices: Vec<String> = assessor
            .histories()
            .take_notices()
            .into_iter()
            .chain(troubles)
            .collect();
        let stored = {
            let mut shared = lock(shared);
            shared.windows = assessor.counts();
            let (total, longest) = shared.assessing;
            shared.assessing = (total + took, longest.max(took));
            // The same trouble may come with each window.
            for message in notices {
                let stamp_ns = assessed.health.t_start_ns;
                publish_rate_limited(&Notice { stamp_ns, message }, LogLevel::Warning, &mut shared, observer)?;
            }
            for message in learner.take_notices() {
                let stamp_ns = assessed.health.t_start_ns;
                publish_rate_limited(&Notice { stamp_ns, message }, LogLevel::Info, &mut shared, observer)?;
            }
            if let Some((level, message)) = shared.health_tracker.update(&assessed.health, pending, passive) {
                let stamp_ns = assessed.health.t_start_ns;
                publish(&Notice { stamp_ns, message }, level, &mut shared, observer)?;
            }
            if let Some((level, message)) = shared.health_tracker.update_sensors(&assessed.sensors, passive) {
                let stamp_ns = assessed.health.t_start_ns;
                publish(&Notice { stamp_ns, message }, level, &mut shared, observer)?;
            }
            let (mut stored, mut messages) = (true, Vec::new());
            if let Some(recorder) = &mut shared.recorder {
                // At the end there are no ticks any more, and the storage is tended here.
                if windows.is_closed() {
                    messages = recorder.tick(Instant::now())?;
                }
                stored = recorder.write_assessed(&assessed)?;
                messages.append(&mut recorder.take_messages());
            }
            // Reported before the line of a window that is not stored.
            for (level, message) in messages {
                let stamp_ns = now_ns();
                publish(&Notice { stamp_ns, message }, level, &mut shared, observer)?;
            }
            if stored {
                shared.last_record = Some(Instant::now());
            }
            stored
        };
        if windows.is_closed() {
            // There are no ticks any more.
            observer.heartbeat();
        }
        // Reported only now: what is reported as assessed is on the disk.
        let reported = if stored {
            observer.assessed(&assessed)
        } else {
            observer.assessed_unstored(&assessed)
        };
        reported.map_err(DaemonError::Stdout)?;
        if commissioned {
            turns.resume();
        }
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
