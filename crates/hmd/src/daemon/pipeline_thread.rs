//! The pipeline thread, between the sources and identification.
//!
//! In: inputs of the sources. Out: raw frames to the recorder, windows to the queue of identification, notices and the
//! status record to the observer and the recorder.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use tokio::sync::mpsc;

use super::capture::Found;
use super::fresh_losses::FreshLosses;
use super::freshness::Freshness;
use super::host_clock::HostClock;
use super::keep_requests::KeepRequests;
use super::other_numbers::OtherNumbers;
use super::passive_names::PassiveNames;
use super::publishing::{publish, publish_rate_limited};
use super::wall_clock::WallClock;
use super::{DaemonError, ENDING_MAX, Observer, Shared, TICK, WaitingWindow, WindowQueue, lock};
use hmd_core::config::Config;
use hmd_core::counted::counted;
use hmd_core::frame::BusNames;
use hmd_core::history::RunEnd;
use hmd_core::outbox::{Notice, WindowJob};
use hmd_core::pipeline::Pipeline;
use hmd_core::record::{ActuatorStatus, DataState, LogLevel, Status};
use hmd_core::talker::Talker;
use hmd_ingest::feed::{Input, LinkState, LiveLoss};
use hmd_storage::recorder::Recorder;

/// Inputs taken at once, during which identification cannot write records.
const BATCH: usize = 1024;

/// Longest that identification may take without an assessed window before it counts as stuck: hundreds of times what one takes.
const ASSESSING_MAX: Duration = Duration::from_secs(60);

/// Ticks between two status records.
const STATUS_TICKS: u64 = 10;

/// State of the thread.
pub(super) struct PipelineThread<'a, C> {
    clock: &'a C,
    names: BusNames,
    pipeline: Pipeline,
    links: BTreeMap<u16, LinkState>,
    losses: FreshLosses,
    ticks: u64,
    store_raw: bool,
    /// Buses whose source has not reported its state; `None` once all have and the observer was called.
    not_reported: Option<BTreeSet<u16>>,
    /// Inputs and windows that waited when the newest inputs were taken.
    queued: (u64, u64),
    freshness: Freshness,
    /// See [`ASSESSING_MAX`].
    pub(super) assessing_max: Duration,
    passive: PassiveNames,
    keep_requests: KeepRequests,
    wall_clock: WallClock,
    other_numbers: OtherNumbers,
}

impl<'a, C: HostClock> PipelineThread<'a, C> {
    /// With the actuators of a configuration, or without one for a capture.
    pub(super) fn new(
        pipeline: Pipeline,
        names: BusNames,
        store_raw: bool,
        config: Option<Arc<Config>>,
        keep_requests: KeepRequests,
        clock: &'a C,
    ) -> Self {
        let actuators = || config.iter().flat_map(|config| config.actuators());
        Self {
            clock,
            other_numbers: OtherNumbers::new(config.as_deref(), &names),
            keep_requests,
            not_reported: Some((0..names.len() as u16).collect()),
            names,
            pipeline,
            links: BTreeMap::new(),
            losses: FreshLosses::default(),
            ticks: 0,
            store_raw,
            queued: (0, 0),
            assessing_max: ASSESSING_MAX,
            freshness: Freshness::new(actuators().map(|actuator| actuator.name.clone()), clock.instant()),
            passive: config.as_deref().map(PassiveNames::of).unwrap_or_default(),
            wall_clock: WallClock::default(),
        }
    }

    /// Takes all inputs until every source has ended, then ends the open windows and waits for their assessment. Ends early when the
    /// identification thread has ended.
    pub(super) fn run(
        &mut self,
        mut inputs: mpsc::Receiver<Input>,
        windows: &WindowQueue,
        shared: &Mutex<Shared>,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        let mut batch = Vec::with_capacity(BATCH);
        // When the queue of inputs was empty last.
        let mut emptied = self.clock.now();
        while inputs.blocking_recv_many(&mut batch, BATCH) > 0 {
            // Nothing in the batch has waited for longer.
            let waited_from = emptied;
            if batch.len() < BATCH {
                emptied = self.clock.now();
            }
            if windows.is_closed() {
                return Ok(());
            }
            self.queued.0 = inputs.len() as u64;
            self.take(&mut batch, waited_from, windows, shared, observer)?;
        }
        self.finish(ENDING_MAX, windows, shared, observer)?;
        let mut is_told = false;
        while !windows.wait_idle(TICK) {
            if !std::mem::replace(&mut is_told, true) {
                self.publish_ending(windows.unassessed(), &mut lock(shared), observer)?;
            }
            self.tick_ending(windows, shared, observer)?;
        }
        Ok(())
    }

    /// A tick while the last windows are assessed. The sources are closed: that no samples come makes no actuator `STALE`.
    pub(super) fn tick_ending(
        &mut self,
        windows: &WindowQueue,
        shared: &Mutex<Shared>,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        self.queued = (0, windows.len() as u64);
        let stamp_ns = self.clock.utc_ns();
        let mut shared = lock(shared);
        self.tend_records(stamp_ns, &mut shared, observer)?;
        if windows.busy_for() < self.assessing_max {
            observer.heartbeat();
        }
        Ok(())
    }

    /// Tells what an end waits for.
    fn publish_ending(&self, windows: u64, shared: &mut Shared, observer: &impl Observer) -> Result<(), DaemonError> {
        let message = format!(
            "the run ends: {} to assess; those left after {} s are dropped, and those in progress are waited for",
            counted(windows, "window", "windows"),
            ENDING_MAX.as_secs()
        );
        let stamp_ns = self.clock.utc_ns();
        publish(&Notice { stamp_ns, message }, LogLevel::Info, shared, observer)
    }

    /// Takes inputs that have waited since then at most.
    pub(super) fn take(
        &mut self,
        batch: &mut Vec<Input>,
        waited_from: Duration,
        windows: &WindowQueue,
        shared: &Mutex<Shared>,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        self.queued.1 = windows.len() as u64;
        let mut shared = lock(shared);
        for input in batch.drain(..) {
            let is_tick = matches!(input, Input::Tick { .. });
            self.note_link_report(&input);
            self.process(input, &mut shared, observer)?;
            self.report_ready(&shared, observer);
            // A tick came through the I/O thread and the queue, and the writer has synced or reported a failure.
            if is_tick && windows.busy_for() < self.assessing_max {
                observer.heartbeat();
            }
        }
        self.publish_notices(&mut shared, observer)?;
        for job in self.pipeline.take_windows() {
            let arrived = arrival_of(&job, waited_from, self.clock);
            shared.begin_wait(job.window.t_start_ns);
            if let Some(dropped) = windows.push(WaitingWindow { job, arrived }) {
                self.count_dropped(&dropped.job, &mut shared)?;
            }
        }
        Ok(())
    }

    /// Ends the open windows; those that wait may be assessed for a time.
    pub(super) fn finish(
        &mut self,
        within: Duration,
        windows: &WindowQueue,
        shared: &Mutex<Shared>,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        self.pipeline.finish();
        let mut last = lock(shared);
        self.publish_losses(self.clock.utc_ns(), &mut last, observer)?;
        self.publish_notices(&mut last, observer)?;
        let arrived = self.clock.now();
        windows.end_by(arrived + within);
        for job in self.pipeline.take_windows() {
            last.begin_wait(job.window.t_start_ns);
            windows.push_last(WaitingWindow { job, arrived });
        }
        Ok(())
    }

    /// Counts the windows that wait as dropped, when nobody assesses them any more.
    pub(super) fn drop_waiting(
        &mut self,
        windows: &WindowQueue,
        shared: &mut Shared,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        for waiting in windows.take_all() {
            self.count_dropped(&waiting.job, shared)?;
        }
        self.queued = (0, 0);
        let dropped = self.losses.take_windows();
        if dropped > 0 {
            let windows = counted(dropped, "window", "windows");
            let message = format!("{windows} dropped: not assessed when the run ended");
            let stamp_ns = self.clock.utc_ns();
            publish(&Notice { stamp_ns, message }, LogLevel::Error, shared, observer)?;
        }
        Ok(())
    }

    /// Names of the actuators seen, with what they have shown.
    pub(super) fn run_ends(&self) -> Vec<(&str, RunEnd)> {
        self.pipeline.run_ends().collect()
    }

    /// The counters as they stand.
    pub(super) fn status(&self, shared: &Shared) -> Status {
        let (identification, longest) = shared.assessing;
        let mut status = Status {
            queued_inputs: self.queued.0,
            queued_windows: self.queued.1,
            identification_s: identification.as_secs_f64(),
            identification_max_s: longest.as_secs_f64(),
            lost_captures: shared.lost_captures,
            record_age_s: shared.last_record.map(|at| (self.clock.instant() - at).as_secs_f64()),
            ..self.pipeline.status(&self.names, shared.windows)
        };
        for (interface, bus) in status.interfaces.iter_mut().zip(0..) {
            interface.passive = self.passive.buses.contains(&interface.interface);
            interface.link = self.links.get(&bus).map(ToString::to_string).unwrap_or_default();
        }
        for (name, data_age_s, stale) in self.freshness.ages(self.clock.instant()) {
            let tracked = shared.health_tracker.health_of(name);
            let changed = tracked.changed.unwrap_or_default();
            let data_state = if stale { DataState::Stale } else { DataState::Fresh };
            status.actuators.push(ActuatorStatus {
                actuator: name.to_owned(),
                data_age_s,
                data_state: data_state.name().to_owned(),
                health: tracked.health,
                sensors: tracked.sensors,
                persistence: tracked.persistence.into(),
                changed_ns: changed.t_ns,
                changed_from: changed.from,
                changed_faults: changed.faults,
                changed_damage: changed.damage,
                passive: self.passive.actuators.contains(name),
            });
        }
        if let Some(store) = shared.recorder.as_ref().and_then(Recorder::storage_status) {
            status.set_storage(&store);
        }
        status
    }

    /// Calls the observer once when every source has reported and the output takes records.
    fn report_ready(&mut self, shared: &Shared, observer: &impl Observer) {
        let reported = self.not_reported.as_ref().is_some_and(BTreeSet::is_empty);
        if reported && shared.recorder.as_ref().is_none_or(Recorder::is_written) {
            self.not_reported = None;
            observer.ready();
        }
    }

    /// Notes that a source has reported.
    fn note_link_report(&mut self, input: &Input) {
        let Some(not_reported) = &mut self.not_reported else {
            return;
        };
        match input {
            Input::Frame(frame) => not_reported.remove(&frame.bus),
            Input::Link { bus, .. } => not_reported.remove(bus),
            Input::Lost { .. } | Input::Unwatched { .. } | Input::Tick { .. } => false,
        };
    }

    fn process(&mut self, input: Input, shared: &mut Shared, observer: &impl Observer) -> Result<(), DaemonError> {
        match input {
            Input::Frame(frame) => {
                if self.store_raw
                    && let Some(recorder) = &mut shared.recorder
                {
                    recorder.write_frame(&frame, &self.names)?;
                } else {
                    shared.with_capture(|capture, put| capture.push(&frame, put))?;
                }
                self.pipeline.push(&frame, &self.names);
            }
            Input::Link {
                bus,
                stamp_ns,
                state,
                cause,
            } => {
                self.links.insert(bus, state);
                let name = self.names.name(bus).unwrap_or_default();
                let message = match cause {
                    Some(cause) if state != LinkState::Up => format!("{name}: {state} ({cause}); waiting"),
                    Some(cause) => format!("{name}: {state} ({cause})"),
                    None => format!("{name}: {state}"),
                };
                let level = match state {
                    LinkState::Up => LogLevel::Info,
                    LinkState::Down | LinkState::Missing => LogLevel::Warning,
                };
                publish_rate_limited(&Notice { stamp_ns, message }, level, shared, observer)?;
                self.write_status(stamp_ns, shared, observer)?;
            }
            Input::Lost { bus, loss, frames } => {
                match loss {
                    LiveLoss::SocketQueue => self.pipeline.losses.socket_queue += frames,
                    LiveLoss::Unreadable => self.pipeline.losses.unreadable += frames,
                }
                self.losses.add_frames(bus, loss, frames);
            }
            Input::Unwatched { bus, number } => self.other_numbers.hear(bus, Talker::Actuator(number)),
            Input::Tick { stamp_ns } => {
                if self.ticks == 0 {
                    for (level, message) in shared.health_tracker.resumed(&self.passive.actuators) {
                        publish(&Notice { stamp_ns, message }, level, shared, observer)?;
                    }
                }
                if let Some(message) = self.wall_clock.jump(self.clock) {
                    publish_rate_limited(&Notice { stamp_ns, message }, LogLevel::Warning, shared, observer)?;
                }
                self.publish_losses(stamp_ns, shared, observer)?;
                for (notice, level) in shared.notices.summaries(stamp_ns) {
                    publish(&notice, level, shared, observer)?;
                }
                self.publish_stale(stamp_ns, shared, observer)?;
                self.take_requests(stamp_ns, shared, observer)?;
                self.tend_records(stamp_ns, shared, observer)?;
            }
        }
        Ok(())
    }

    /// What a tick does for captures and storage, with a status record where it is time for one.
    fn tend_records(
        &mut self,
        stamp_ns: u64,
        shared: &mut Shared,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        shared.with_capture(|capture, put| capture.tick(stamp_ns, put))?;
        self.tend_storage(stamp_ns, shared, observer)?;
        if self.ticks.is_multiple_of(STATUS_TICKS) || shared.health_changed {
            shared.health_changed = false;
            self.write_status(stamp_ns, shared, observer)?;
        }
        self.ticks += 1;
        Ok(())
    }

    fn write_status(&self, stamp_ns: u64, shared: &mut Shared, observer: &impl Observer) -> Result<(), DaemonError> {
        let status = self.status(shared);
        observer.status(&status);
        if let Some(recorder) = &mut shared.recorder {
            recorder.write_status(stamp_ns, &status)?;
        }
        Ok(())
    }

    /// Takes the requests of an operator for the frames of a time.
    fn take_requests(
        &mut self,
        stamp_ns: u64,
        shared: &mut Shared,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        if shared.capture.is_none() {
            return Ok(());
        }
        let requests = self.keep_requests.take_new();
        for request in &requests {
            let event = &request.event;
            let asked = format!("{}: asked for by hmd event --keep", event.actuator);
            let why = event
                .note
                .as_ref()
                .map_or(asked.clone(), |note| format!("{asked}: {note}"));
            let has_later = shared
                .capture
                .as_ref()
                .is_some_and(|capture| capture.has_later(event.t_ns));
            let message = format!("frames wanted: {why}");
            let found = shared.with_capture(|capture, put| capture.want((event.t_ns, event.t_ns), why, put))?;
            let (level, rest) = match found {
                Some(Found::NotAll) if has_later && request.is_continued => {
                    (LogLevel::Info, "; those since the restart are kept as well")
                }
                Some(Found::NotAll) if has_later => (
                    LogLevel::Warning,
                    "; those of the time itself are no longer there, later ones are kept",
                ),
                Some(Found::NotAll) => (LogLevel::Warning, "; they are no longer there"),
                _ => (LogLevel::Info, ""),
            };
            let message = format!("{message}{rest}");
            publish(&Notice { stamp_ns, message }, level, shared, observer)?;
        }
        self.keep_requests.note_answered(&requests);
        Ok(())
    }

    /// Syncs what was taken to the disk, and publishes notices of the storage.
    fn tend_storage(
        &mut self,
        stamp_ns: u64,
        shared: &mut Shared,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        let Some(recorder) = &mut shared.recorder else {
            return Ok(());
        };
        for (level, message) in recorder.tick(self.clock.instant())? {
            publish(&Notice { stamp_ns, message }, level, shared, observer)?;
        }
        Ok(())
    }

    /// Publishes which actuators' data became stale or fresh again, with a status record out of turn.
    fn publish_stale(
        &mut self,
        stamp_ns: u64,
        shared: &mut Shared,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        let changes = self.freshness.update(self.clock.instant(), self.pipeline.samples());
        for (stale, message) in &changes {
            let level = if *stale { LogLevel::Warning } else { LogLevel::Info };
            let message = message.clone();
            publish_rate_limited(&Notice { stamp_ns, message }, level, shared, observer)?;
        }
        if !changes.is_empty() {
            self.write_status(stamp_ns, shared, observer)?;
        }
        self.publish_other_numbers(stamp_ns, shared, observer)
    }

    /// Publishes which numbers talk on the buses of actuators of which nothing ever came.
    fn publish_other_numbers(
        &mut self,
        stamp_ns: u64,
        shared: &mut Shared,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        for (bus, talker) in self.pipeline.talkers() {
            self.other_numbers.hear(bus, talker);
        }
        let is_seen = |name: &str| self.pipeline.samples().any(|(seen, _)| seen == name);
        let is_silent = |name: &str| self.freshness.is_stale(name) && !is_seen(name);
        for message in self.other_numbers.hints(is_silent) {
            publish(&Notice { stamp_ns, message }, LogLevel::Warning, shared, observer)?;
        }
        Ok(())
    }

    fn count_dropped(&mut self, job: &WindowJob, shared: &mut Shared) -> Result<(), DaemonError> {
        self.pipeline.losses.windows += 1;
        self.losses.add_window();
        shared.end_wait(job.window.t_start_ns);
        if let Some(recorder) = &mut shared.recorder {
            recorder.write_dropped(job)?;
        }
        Ok(())
    }

    fn publish_notices(&mut self, shared: &mut Shared, observer: &impl Observer) -> Result<(), DaemonError> {
        for notice in self.pipeline.take_notices() {
            publish_rate_limited(&notice, LogLevel::Warning, shared, observer)?;
        }
        Ok(())
    }

    /// Reports what was lost since the last time.
    fn publish_losses(
        &mut self,
        stamp_ns: u64,
        shared: &mut Shared,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        for message in self.losses.take_messages(&self.pipeline, &self.names) {
            publish_rate_limited(&Notice { stamp_ns, message }, LogLevel::Error, shared, observer)?;
        }
        Ok(())
    }
}

/// When the last sample of a window arrived: by its stamp, which stamps of another clock may not put before the time since when
/// inputs have waited.
fn arrival_of(job: &WindowJob, waited_from: Duration, clock: &impl HostClock) -> Duration {
    let window = &job.window;
    let last_ns = window.t_start_ns.saturating_add((1e9 * job.length_s()) as u64);
    let age = Duration::from_nanos(clock.utc_ns().saturating_sub(last_ns));
    let now = clock.now();
    now.saturating_sub(age).max(waited_from.min(now))
}
