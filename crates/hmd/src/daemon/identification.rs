//! The identification thread: windows of the queue to records. CPU-bound.

use std::collections::{BTreeSet, VecDeque};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::capture::Found;
use super::health_tracker::{HealthTracker, is_worse};
use super::host_clock::HostClock;
use super::publishing::{publish, publish_rate_limited};
use super::{DaemonError, Observer, Shared, WaitingWindow, WindowQueue, lock};
use hmd_core::assess::{AssessError, AssessedWindow, Assessor, Estimator};
use hmd_core::config::{ActuatorConfig, Config};
use hmd_core::deadline::{TimeLimit, Turns};
use hmd_core::history::RunEnd;
use hmd_core::learning::Learner;
use hmd_core::outbox::{Notice, WindowJob};
use hmd_core::record::{LogLevel, WindowStatus};
use hmd_storage::calibration_file::{load_learnt, load_models, remove_learnt, save_learnt};
use hmd_storage::event_file::load_events;
use hmd_storage::held_lock::HeldLock;
use hmd_storage::history_file;

/// State of the thread.
pub(super) struct Identification<'a, C> {
    clock: &'a C,
    config: Arc<Config>,
    assessor: Assessor,
    learner: Learner,
    turns: Turns<'a, C>,
    /// Folder of the unit histories, if they are kept, and the lock that makes it this run's.
    histories: Option<(PathBuf, HeldLock)>,
}

impl<'a, C: HostClock> Identification<'a, C> {
    pub(super) fn new(
        config: Arc<Config>,
        seed: u64,
        estimator: Arc<dyn Estimator>,
        clock: &'a C,
    ) -> Result<Self, DaemonError> {
        let histories = match config.rul().state.as_ref().map(|path| config.resolve(path)) {
            Some(folder) => {
                let lock = history_file::hold(&folder).map_err(DaemonError::State)?;
                Some((folder, lock))
            }
            None => None,
        };
        let mut assessor = ready_assessor(config.clone(), seed, estimator)?;
        let mut learner = Learner::new(config.clone(), seed);
        for kept in load_learnt(&config)? {
            learner.take_unit(&mut assessor, &kept.actuator.name, kept.calibration, kept.sha256);
        }
        Ok(Self {
            clock,
            assessor,
            learner,
            turns: Turns::new(&config, clock),
            histories,
            config,
        })
    }

    /// Health of the actuators by the histories of earlier runs and the maintenance events since: it holds until their next windows, and the
    /// observer gets what their last ones showed. A file of events that cannot be read is told with the first window.
    pub(super) fn resumed_health(&mut self, observer: &impl Observer) -> HealthTracker {
        let mut tracker = HealthTracker::default();
        if let Ok(events) = load_events(&self.config) {
            self.assessor.histories().set_events(events);
        }
        let now_ns = self.clock.utc_ns();
        for (actuator, state) in self.assessor.histories().restored_states(now_ns) {
            tracker.resume(actuator, &state);
            observer.resumed(actuator, state.last_window);
        }
        tracker
    }

    /// Assesses the windows of the queue until it is closed, or the run is over.
    pub(super) fn run(
        &mut self,
        windows: &WindowQueue,
        shared: &Mutex<Shared>,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        self.rehearse()?;
        while !windows.is_over(self.clock.now()) && self.assess_next(windows_together(), windows, shared, observer)? {}
        Ok(())
    }

    /// Assesses the oldest windows that wait, of different actuators, at most so many: explained side by side, concluded and published in their
    /// order, with the records of one after another. Waits for one; `false` when the queue is closed and empty. With a deadline each window has a
    /// turn of its own.
    pub(super) fn assess_next(
        &mut self,
        at_most: usize,
        windows: &WindowQueue,
        shared: &Mutex<Shared>,
        observer: &impl Observer,
    ) -> Result<bool, DaemonError> {
        let at_most = if self.turns.are_limited() { 1 } else { at_most };
        let side_by_side = |waiting: &VecDeque<WaitingWindow>| {
            let mut names = BTreeSet::new();
            let different = waiting
                .iter()
                .take_while(|window| names.insert(&window.job.actuator.name));
            different.take(at_most).count()
        };
        let Some(taken) = windows.pop_some(side_by_side) else {
            return Ok(false);
        };
        match <[_; 1]>::try_from(taken) {
            Ok([alone]) => self.assess(alone, windows, shared, observer)?,
            Err(several) => self.assess_together(several, windows, shared, observer)?,
        }
        Ok(true)
    }

    /// Measures how long identification takes on this computer, where windows have a deadline.
    pub(super) fn rehearse(&mut self) -> Result<(), DaemonError> {
        if let Some(actuator) = self.config.actuators().first() {
            let measured = self.turns.measure(|effort| self.assessor.rehearse(actuator, effort));
            measured.transpose()?;
        }
        Ok(())
    }

    /// Assesses one window, stores its records and reports it.
    fn assess(
        &mut self,
        WaitingWindow { job, arrived }: WaitingWindow,
        windows: &WindowQueue,
        shared: &Mutex<Shared>,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        let context = WindowContext {
            trouble: self.load_events(),
            ..WindowContext::of(&job, arrived)
        };
        let since = self.clock.instant();
        let assessed = self.turns.take(
            arrived,
            || windows.look(|waiting| waiting.iter().map(|waiting| waiting.arrived).collect()),
            |limit| self.learner.assess(&mut self.assessor, job, limit),
        )?;
        self.publish_assessed(&assessed, context, since, shared, observer)
    }

    /// The same of windows of different actuators. Those behind one that ends the run are given back.
    fn assess_together(
        &mut self,
        taken: Vec<WaitingWindow>,
        windows: &WindowQueue,
        shared: &Mutex<Shared>,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        let mut trouble = self.load_events();
        let begin = |WaitingWindow { job, arrived }| {
            let context = WindowContext::of(&job, arrived);
            let begun = self.learner.begin(&mut self.assessor, job, None);
            let untold = self.take_untold();
            let trouble = trouble.take();
            (
                begun,
                WindowContext {
                    untold,
                    trouble,
                    ..context
                },
            )
        };
        let begun: Vec<_> = taken.into_iter().map(begin).collect();
        let (assessor, clock) = (&self.assessor, self.clock);
        let explained: Vec<_> = begun
            .into_par_iter()
            .map(|(begun, context)| {
                let since = clock.instant();
                let explained = begun.and_then(|begun| begun.explain(assessor, &TimeLimit::none()));
                let took = clock.instant() - since;
                (explained, WindowContext { took, ..context })
            })
            .collect();
        let mut explained = explained.into_iter();
        while let Some((window, context)) = explained.next() {
            let since = self.clock.instant();
            let concluded =
                window.and_then(|window| self.learner.conclude(&mut self.assessor, window, &TimeLimit::none()));
            let published = concluded
                .map_err(DaemonError::from)
                .and_then(|assessed| self.publish_assessed(&assessed, context, since, shared, observer));
            if let Err(error) = published {
                let behind = explained.filter_map(|(window, WindowContext { arrived, .. })| {
                    let job = window.ok()?.into_job();
                    Some(WaitingWindow { job, arrived })
                });
                windows.give_back(behind);
                return Err(error);
            }
            windows.one_done();
        }
        Ok(())
    }

    /// What histories and learner have to tell since they were asked last.
    fn take_untold(&mut self) -> Untold {
        Untold {
            by_histories: self.assessor.histories().take_notices(),
            by_learner: self.learner.take_notices(),
            replaced: self.learner.take_replaced(),
        }
    }

    /// Takes the maintenance events that have come since the windows before; the file is short. One that is damaged does not end the watch.
    fn load_events(&mut self) -> Option<String> {
        match load_events(&self.config) {
            Ok(events) => {
                self.assessor.histories().set_events(events);
                None
            }
            Err(error) => Some(format!("rul.events: {error}")),
        }
    }

    /// Commissions the unit of an assessed window where that was the last one that it took, stores the records and reports them. `since` is when
    /// the work began that does not count yet.
    fn publish_assessed(
        &mut self,
        assessed: &AssessedWindow,
        context: WindowContext,
        since: Instant,
        shared: &Mutex<Shared>,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        let commissioned = self.learner.commission_complete(&mut self.assessor)?;
        let took = context.took + (self.clock.instant() - since);
        let (untold, untold_now) = (context.untold, self.take_untold());
        // Before the lock is taken: frames need not wait for files. What was learnt goes before the history says that the event was followed: the
        // power may fail between.
        let replaced = untold.replaced.iter().chain(&untold_now.replaced);
        let unremoved: Vec<String> = replaced
            .filter_map(|actuator| {
                let error = remove_learnt(&self.config, actuator).err()?;
                let name = &actuator.name;
                Some(format!(
                    "what was learnt of {name} before is not removed: it is taken again after a restart: {error}"
                ))
            })
            .collect();
        let saved = match (
            &self.histories,
            self.assessor.histories().get(&assessed.health.actuator),
        ) {
            (Some((directory, _)), Some(history)) => history_file::save(directory, &assessed.health.actuator, history),
            _ => Ok(()),
        };
        // A unit that cannot be kept is assessed by what was learnt all the same, until the run ends.
        let kept = self.learner.take_learnt();
        let unkept: Vec<String> = kept
            .iter()
            .filter_map(|learnt| {
                let error = save_learnt(&self.config, learnt).err()?;
                let name = &learnt.actuator.name;
                Some(format!(
                    "the commissioning of {name} is not kept: it is learnt again after a restart: {error}"
                ))
            })
            .collect();
        let troubles = context
            .trouble
            .into_iter()
            .chain(saved.err().map(|error| error.to_string()))
            .chain(unremoved)
            .chain(unkept);
        let pending = self.assessor.histories().pending(&assessed.health.actuator);
        let by_histories = untold.by_histories.into_iter().chain(untold_now.by_histories);
        let notices: Vec<String> = by_histories.chain(troubles).collect();
        let stored = {
            let mut shared = lock(shared);
            shared.windows = self.assessor.counts();
            let (total, longest) = shared.assessing;
            shared.assessing = (total + took, longest.max(took));
            // The same trouble may come with each window.
            for message in notices {
                let stamp_ns = assessed.health.t_start_ns;
                publish_rate_limited(&Notice { stamp_ns, message }, LogLevel::Warning, &mut shared, observer)?;
            }
            for message in untold.by_learner.into_iter().chain(untold_now.by_learner) {
                let stamp_ns = assessed.health.t_start_ns;
                publish_rate_limited(&Notice { stamp_ns, message }, LogLevel::Info, &mut shared, observer)?;
            }
            Self::keep_frames(assessed, context.length_ns, &mut shared, observer)?;
            shared.health_changed |=
                shared.health_tracker.health_of(&assessed.health.actuator).health != assessed.health.health;
            let notices = shared.health_tracker.update(
                &assessed.health,
                assessed.rul.rul_p10_h,
                &assessed.news,
                pending,
                context.passive,
            );
            for (level, message) in notices {
                let stamp_ns = assessed.health.t_start_ns;
                publish(&Notice { stamp_ns, message }, level, &mut shared, observer)?;
            }
            if let Some((level, message)) = shared.health_tracker.update_sensors(&assessed.sensors, context.passive) {
                let stamp_ns = assessed.health.t_start_ns;
                publish(&Notice { stamp_ns, message }, level, &mut shared, observer)?;
            }
            let (mut stored, mut messages) = (true, Vec::new());
            if let Some(recorder) = &mut shared.recorder {
                stored = recorder.write_assessed(assessed)?;
                messages = recorder.take_messages();
            }
            // Reported before the line of a window that is not stored.
            for (level, message) in messages {
                let stamp_ns = self.clock.utc_ns();
                publish(&Notice { stamp_ns, message }, level, &mut shared, observer)?;
            }
            if stored {
                shared.last_record = Some(self.clock.instant());
            }
            stored
        };
        // Reported only now: what is reported as assessed is on the disk.
        let reported = if stored {
            observer.assessed(assessed)
        } else {
            observer.assessed_unstored(assessed)
        };
        reported.map_err(DaemonError::Stdout)?;
        if commissioned {
            self.turns.resume();
        }
        Ok(())
    }

    /// Counts operation and dropped windows since the last windows, by actuator, and stores the histories. Returns what an operator should read.
    pub(super) fn end_run(&mut self, ends: &[(&str, RunEnd)]) -> Result<Vec<String>, DaemonError> {
        let histories = self.assessor.histories();
        histories.end_run(ends.iter().copied()).map_err(AssessError::from)?;
        let mut notices = Vec::new();
        if let Some((directory, _)) = &self.histories {
            for (name, _) in ends {
                let saved = histories
                    .get(name)
                    .map(|history| history_file::save(directory, name, history));
                notices.extend(saved.and_then(Result::err).map(|error| error.to_string()));
            }
        }
        notices.splice(0..0, histories.take_notices());
        Ok(notices)
    }

    /// Stores the frames around a window that somebody will want to look at.
    fn keep_frames(
        assessed: &AssessedWindow,
        length_ns: u64,
        shared: &mut Shared,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        let from_ns = assessed.health.t_start_ns;
        if let Some(why) = reason_to_keep(assessed, &shared.health_tracker) {
            let times = (from_ns, from_ns.saturating_add(length_ns));
            let message = format!("{why}: its frames are no longer there, or not all");
            let found = shared.with_capture(|capture, put| capture.want(times, why, put))?;
            if found == Some(Found::NotAll) {
                shared.lost_captures += 1;
                let stamp_ns = from_ns;
                publish_rate_limited(&Notice { stamp_ns, message }, LogLevel::Error, shared, observer)?;
            }
        }
        shared.end_wait(from_ns);
        Ok(())
    }
}

/// Windows that are assessed together, at most: two for each thread, so that a short one leaves its thread to another.
#[must_use]
pub fn windows_together() -> usize {
    2 * rayon::current_num_threads()
}

/// What belongs to a window beside its assessment.
struct WindowContext {
    /// When its last sample arrived.
    arrived: Duration,
    length_ns: u64,
    /// Whether its actuator is passive.
    passive: bool,
    /// What was to tell when its assessment began.
    untold: Untold,
    /// What else an operator should read.
    trouble: Option<String>,
    /// Time that its explanation took, where that was apart.
    took: Duration,
}

/// What histories and learner have to tell.
#[derive(Default)]
struct Untold {
    by_histories: Vec<String>,
    by_learner: Vec<String>,
    /// Actuators whose unit was replaced.
    replaced: Vec<Arc<ActuatorConfig>>,
}

impl WindowContext {
    fn of(job: &WindowJob, arrived: Duration) -> Self {
        Self {
            arrived,
            length_ns: (1e9 * job.length_s()) as u64,
            passive: job.actuator.passive,
            untold: Untold::default(),
            trouble: None,
            took: Duration::ZERO,
        }
    }
}

/// Why the frames of a window are kept; `None` where they need not be.
fn reason_to_keep(assessed: &AssessedWindow, tracker: &HealthTracker) -> Option<String> {
    let (health, sensors) = (&assessed.health, &assessed.sensors);
    let before = tracker.health_of(&health.actuator);
    let why = if health.status == WindowStatus::Unmodelled.name() {
        "unmodelled".to_owned()
    } else if is_worse(&before.health, &health.health) {
        format!("{} to {}", before.health, health.health)
    } else if is_worse(&before.sensors, &sensors.level) {
        format!("sensors {} to {}", before.sensors, sensors.level)
    } else {
        return None;
    };
    Some(format!("{}: window {}: {why}", health.actuator, health.window))
}

/// An assessor with its models, and the histories of earlier runs; the notices of unusable histories come with the first
/// window.
fn ready_assessor(config: Arc<Config>, seed: u64, estimator: Arc<dyn Estimator>) -> Result<Assessor, DaemonError> {
    let mut assessor = Assessor::new(config.clone(), load_models(&config)?, seed).with_estimator(estimator);
    if let Some(directory) = config.rul().state.as_ref().map(|path| config.resolve(path)) {
        history_file::restore_all(&directory, &config, assessor.histories()).map_err(DaemonError::State)?;
    }
    Ok(assessor)
}
