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

mod capture;
mod fresh_losses;
mod freshness;
mod health_tracker;
mod host_clock;
mod identification;
mod keep_requests;
mod notices;
mod other_numbers;
mod passive_names;
mod pipeline_thread;
mod publishing;
mod steps;
mod wall_clock;
#[cfg(test)]
mod watchdog_tests;
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

pub use capture::held_s;
use capture::{Capture, Put, Step};
pub use freshness::STALE_AFTER;
use health_tracker::HealthTracker;
use hmd_core::assess::{AssessError, AssessedWindow, WindowCounts};
use hmd_core::config::Config;
use hmd_core::frame::{BusError, BusNames};
use hmd_core::last_window::LastWindow;
use hmd_core::outbox::WindowJob;
use hmd_core::record::{LogLevel, Status};
use hmd_ingest::feed::{Feed, Input, QUEUE_INPUTS};
use hmd_ingest::live::LiveSource;
use hmd_storage::history_file::StateError;
use hmd_storage::recorder::{RecordError, Recorder};
pub use host_clock::HostClock;
use host_clock::SteadyClock;
pub use identification::windows_together;
use notices::Notices;
pub use steps::Steps;
pub use window_queue::QUEUE_WINDOWS;

type WindowQueue = window_queue::WindowQueue<WaitingWindow>;

/// A window that waits for identification.
struct WaitingWindow {
    job: WindowJob,
    /// When its last sample arrived.
    arrived: Duration,
}

/// Time within which waiting windows are assessed at the end of a run; those left are dropped. Nothing is received meanwhile, and a
/// service manager kills what stops too slowly.
pub const ENDING_MAX: Duration = Duration::from_secs(20);

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
    /// The histories of earlier runs cannot be kept.
    #[error("rul.state: {0}")]
    State(StateError),
    /// What is learnt of a unit cannot be kept.
    #[error("actuator.learn_folder of {actuator}: expected a folder that can be written to, found {cause}")]
    LearnFolder {
        /// The actuator.
        actuator: String,
        /// The folder, and why it cannot be used.
        cause: AssessError,
    },
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
    /// By the history of an earlier run, the last window of an actuator showed this; called before anything else.
    fn resumed(&self, _actuator: &str, _last: LastWindow) {}
    /// A notice for an operator.
    fn notice(&self, message: &str);
    /// The same with its level; by default the level is left out.
    fn notice_with_level(&self, _: LogLevel, message: &str) {
        self.notice(message);
    }
    /// The counters as they are recorded, with those of the storage: every ten seconds, and at the end.
    fn status(&self, _: &Status) {}
    /// The run ends with an error of its output; its counters until then.
    fn failed(&self, _: &Status) {}
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
    names: BusNames,
    /// Frames that may be stored later, where not all are.
    capture: Option<Capture>,
    /// Captures wanted whose frames were no longer there, or not all.
    lost_captures: u64,
    windows: WindowCounts,
    /// Time spent on identification, and the longest that one window took.
    assessing: (Duration, Duration),
    /// When the newest health record was stored, or reported where nothing is stored.
    last_record: Option<Instant>,
    /// A health changed since the last status record, so that the next is not waited for.
    health_changed: bool,
    /// Health of the actuators by their assessments.
    health_tracker: HealthTracker,
    /// Notices published lately, by either thread.
    notices: Notices,
}

impl Shared {
    /// Takes a step with the captures, whose frames go to the recorder.
    fn with_capture<T>(
        &mut self,
        act: impl FnOnce(&mut Capture, Put<'_>) -> Result<T, RecordError>,
    ) -> Result<Option<T>, RecordError> {
        let (Some(capture), Some(recorder)) = (&mut self.capture, &mut self.recorder) else {
            return Ok(None);
        };
        let done = act(capture, &mut |step| match step {
            Step::Begin(why) => {
                recorder.begin_capture(why);
                Ok(())
            }
            Step::Frame(frame) => recorder.write_frame(frame, &self.names),
            Step::End => {
                recorder.end_capture();
                Ok(())
            }
        });
        done.map(Some)
    }

    /// A window that begins then waits for its verdict.
    fn begin_wait(&mut self, t_start_ns: u64) {
        if let Some(capture) = &mut self.capture {
            capture.begin_wait(t_start_ns);
        }
    }

    /// It has its verdict, or gets none.
    fn end_wait(&mut self, t_start_ns: u64) {
        if let Some(capture) = &mut self.capture {
            capture.end_wait(t_start_ns);
        }
    }
}

impl Daemon {
    /// Runs until `shutdown` resolves or every source has ended; then assesses the windows that wait, for [`ENDING_MAX`] at most, and ends
    /// the file.
    ///
    /// # Errors
    /// [`DaemonError`]; the record file is then ended as far as it goes.
    pub fn run(self, shutdown: impl Future<Output = ()>, observer: &impl Observer) -> Result<Status, DaemonError> {
        self.run_by(&SteadyClock(Instant::now()), shutdown, observer)
    }

    /// The same by another clock.
    ///
    /// # Errors
    /// As [`Daemon::run`].
    pub fn run_by(
        self,
        clock: &impl HostClock,
        shutdown: impl Future<Output = ()>,
        observer: &impl Observer,
    ) -> Result<Status, DaemonError> {
        let (names, sources): (Vec<_>, Vec<_>) = self.sources.into_iter().unzip();
        let names = bus_names(&names)?;
        let sources = (0..).zip(sources).collect();
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(DaemonError::Start)?;
        let (queue, inputs) = mpsc::channel(QUEUE_INPUTS);
        let estimator = Arc::new(hmd_core::assess::Identification);
        let mut steps = Steps::new(names, self.recorder, self.watch, estimator, clock, observer)?;
        let (watched, assessed) = thread::scope(|scope| {
            let (windows, shared) = (&steps.windows, &steps.shared);
            let (pipeline, identification) = (&mut steps.pipeline, steps.identification.as_mut());
            let named = |name: &str| thread::Builder::new().name(name.to_owned());
            // The first to start: it ends with the sources if the other one cannot start.
            let watching = named("pipeline")
                .spawn_scoped(scope, || {
                    let _closed = CloseAtEnd(windows);
                    pipeline.run(inputs, windows, shared, observer)
                })
                .map_err(DaemonError::Start)?;
            let assessing = identification.map(|identification| {
                named("identification").spawn_scoped(scope, move || {
                    let _closed = CloseAtEnd(windows);
                    identification.run(windows, shared, observer)
                })
            });
            let assessing = assessing.transpose().map_err(DaemonError::Start)?;
            runtime.block_on(receive(sources, queue, shutdown, clock));
            Ok::<_, DaemonError>((join(watching), assessing.map_or(Ok(()), join)))
        })?;
        steps.end(watched, assessed)
    }
}

/// Numbers the buses in their order.
///
/// # Panics
/// When a name is there twice: the frames of the second source would be of another bus. Configuration and arguments are checked for it.
fn bus_names(wanted: &[String]) -> Result<BusNames, DaemonError> {
    let mut names = BusNames::new();
    for (n, name) in wanted.iter().enumerate() {
        let number = names.intern(name).map_err(|cause| DaemonError::Interface {
            name: name.clone(),
            cause,
        })?;
        assert_eq!(usize::from(number), n, "interface {name:?} is there twice");
    }
    Ok(names)
}

/// Runs the sources until the shutdown, or until all have ended.
async fn receive(
    sources: Vec<(u16, LiveSource)>,
    queue: mpsc::Sender<Input>,
    shutdown: impl Future<Output = ()>,
    clock: &impl HostClock,
) {
    let (close, closing) = watch::channel(false);
    let mut tasks = JoinSet::new();
    for (bus, source) in sources {
        tasks.spawn(source.run(Feed::new(bus, queue.clone(), closing.clone())));
    }
    let tick = async {
        let mut interval = tokio::time::interval(TICK);
        loop {
            interval.tick().await;
            let stamp_ns = clock.utc_ns();
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

/// A panic elsewhere leaves whole records behind; it is passed on when the threads are joined.
fn lock(shared: &Mutex<Shared>) -> MutexGuard<'_, Shared> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

fn join<T>(thread: thread::ScopedJoinHandle<'_, T>) -> T {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}
