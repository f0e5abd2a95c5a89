//! The thread between the sources and identification: records what comes, cuts windows, keeps the books.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use ema_wire::{DeframerStats, FrameError};
use tokio::sync::mpsc;

use super::freshness::Freshness;
use super::{DaemonError, Observer, Shared, WindowQueue, lock};
use hmd_core::config::Config;
use hmd_core::demux::{Notice, WindowJob};
use hmd_core::frame::BusNames;
use hmd_core::pipeline::Pipeline;
use hmd_core::record::{LogLevel, Status};
use hmd_ingest::feed::{Input, LinkState, LiveLoss};
use hmd_storage::clock::now_ns;
use hmd_storage::recorder::Recorder;

/// Inputs taken at once, during which identification cannot write records.
const BATCH: usize = 1024;

/// Longest that one window may be judged before identification counts as stuck: hundreds of times what it takes.
const JUDGING_MAX: Duration = Duration::from_secs(60);

/// Ticks between two status records.
const STATUS_TICKS: u64 = 10;

/// What the thread knows.
pub(super) struct Monitor {
    names: BusNames,
    pipeline: Pipeline,
    links: BTreeMap<u16, LinkState>,
    /// Frames lost since the last tick, by bus and kind.
    fresh_losses: BTreeMap<(u16, LiveLoss), u64>,
    /// What had come of the frames of each serial line at the last tick.
    told: BTreeMap<u16, DeframerStats>,
    /// Windows dropped since the last tick.
    fresh_drops: u64,
    ticks: u64,
    store_raw: bool,
    /// Buses whose source has not said yet how it stands; `None` once all have, and the observer knows.
    unheard: Option<BTreeSet<u16>>,
    /// Inputs and windows that waited when the newest inputs were taken.
    queued: (u64, u64),
    freshness: Freshness,
    /// Names of the actuators whose changes alarm nobody.
    passive: BTreeSet<String>,
}

impl Monitor {
    /// With the actuators of a configuration, or without one for a capture.
    pub(super) fn new(pipeline: Pipeline, names: BusNames, store_raw: bool, config: Option<Arc<Config>>) -> Self {
        let actuators = || config.iter().flat_map(|config| config.actuators());
        let passive = actuators().filter(|actuator| actuator.passive);
        Self {
            unheard: Some((0..names.len() as u16).collect()),
            names,
            pipeline,
            links: BTreeMap::new(),
            fresh_losses: BTreeMap::new(),
            told: BTreeMap::new(),
            fresh_drops: 0,
            ticks: 0,
            store_raw,
            queued: (0, 0),
            freshness: Freshness::new(actuators().map(|actuator| actuator.name.clone()), Instant::now()),
            passive: passive.map(|actuator| actuator.name.clone()).collect(),
        }
    }

    /// Takes all inputs until every source has ended, then ends the open windows. Ends early when nobody judges any more.
    pub(super) fn run(
        &mut self,
        mut inputs: mpsc::Receiver<Input>,
        windows: &WindowQueue,
        shared: &Mutex<Shared>,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        let mut batch = Vec::with_capacity(BATCH);
        let mut ended = Vec::new();
        while inputs.blocking_recv_many(&mut batch, BATCH) > 0 {
            if windows.is_closed() {
                return Ok(());
            }
            self.queued = (inputs.len() as u64, windows.len() as u64);
            let mut shared = lock(shared);
            for input in batch.drain(..) {
                let is_tick = matches!(input, Input::Tick { .. });
                self.hear(&input, observer);
                self.take(input, &mut ended, &mut shared, observer)?;
                // A tick came through the I/O thread and the queue, and the writer has synced or said that it cannot.
                if is_tick && windows.busy_for() < JUDGING_MAX {
                    observer.alive();
                }
            }
            self.tell_notices(&mut shared, observer)?;
            for job in ended.drain(..) {
                if let Some(dropped) = windows.push(job) {
                    self.count_dropped(&dropped, &mut shared)?;
                }
            }
        }
        self.pipeline.finish(&mut ended);
        let mut last = lock(shared);
        self.tell_losses(now_ns(), &mut last, observer)?;
        self.tell_notices(&mut last, observer)?;
        // Identification needs it to make room.
        drop(last);
        for job in ended.drain(..) {
            windows.push_waiting(job);
        }
        Ok(())
    }

    /// The counters as they stand.
    pub(super) fn status(&self, shared: &Shared) -> Status {
        let link = |bus: u16| self.links.get(&bus).map(ToString::to_string).unwrap_or_default();
        let (identification, longest) = shared.judging;
        let mut status = Status {
            link: (0..self.names.len()).map(|bus| link(bus as u16)).collect(),
            queued_inputs: self.queued.0,
            queued_windows: self.queued.1,
            identification_s: identification.as_secs_f64(),
            identification_max_s: longest.as_secs_f64(),
            record_age_s: shared.last_record.map(|at| at.elapsed().as_secs_f64()),
            ..self.pipeline.status(&self.names, shared.windows)
        };
        for (name, age_s, stale) in self.freshness.ages(Instant::now()) {
            let standing = shared.standings.of(name);
            let changed = standing.changed.unwrap_or_default();
            status.actuator.push(name.to_owned());
            status.data_age_s.push(age_s);
            status.data_state.push(if stale { "STALE" } else { "fresh" }.to_owned());
            status.health.push(standing.health);
            status.persistence.push(standing.persistence.into());
            status.changed_ns.push(changed.t_ns);
            status.changed_from.push(changed.from);
            status.changed_faults.push(changed.faults);
            status.changed_damage.push(changed.damage);
            status.passive.push(self.passive.contains(name));
        }
        if let Some(store) = shared.recorder.as_ref().and_then(Recorder::store_status) {
            status.set_storage(&store);
        }
        status
    }

    /// Whether every source has been heard of, which is told once.
    fn hear(&mut self, input: &Input, observer: &impl Observer) {
        let Some(unheard) = &mut self.unheard else { return };
        match input {
            Input::Frame(frame) => unheard.remove(&frame.bus),
            Input::Link { bus, .. } => unheard.remove(bus),
            Input::Lost { .. } | Input::Tick { .. } => false,
        };
        if unheard.is_empty() {
            self.unheard = None;
            observer.ready();
        }
    }

    fn take(
        &mut self,
        input: Input,
        ended: &mut Vec<WindowJob>,
        shared: &mut Shared,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        match input {
            Input::Frame(frame) => {
                if self.store_raw
                    && let Some(recorder) = &mut shared.recorder
                {
                    recorder.raw(&frame, &self.names)?;
                }
                self.pipeline.push(&frame, &self.names, ended);
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
                    Some(cause) if state != LinkState::Up => format!("{name}: {state} ({cause}); it is waited for"),
                    Some(cause) => format!("{name}: {state} ({cause})"),
                    None => format!("{name}: {state}"),
                };
                let level = match state {
                    LinkState::Up => LogLevel::Info,
                    LinkState::Down | LinkState::Missing => LogLevel::Warning,
                };
                tell_unless_many(&Notice { stamp_ns, message }, level, shared, observer)?;
                self.write_status(stamp_ns, shared, observer)?;
            }
            Input::Lost { bus, loss, frames } => {
                match loss {
                    LiveLoss::SocketQueue => self.pipeline.losses.socket_queue += frames,
                    LiveLoss::Unreadable => self.pipeline.losses.unreadable += frames,
                }
                *self.fresh_losses.entry((bus, loss)).or_default() += frames;
            }
            Input::Tick { stamp_ns } => {
                self.tell_losses(stamp_ns, shared, observer)?;
                for (notice, level) in shared.notices.summaries(stamp_ns) {
                    tell(&notice, level, shared, observer)?;
                }
                self.tell_stale(stamp_ns, shared, observer)?;
                self.tend_storage(stamp_ns, shared, observer)?;
                if self.ticks.is_multiple_of(STATUS_TICKS) {
                    self.write_status(stamp_ns, shared, observer)?;
                }
                self.ticks += 1;
            }
        }
        Ok(())
    }

    fn write_status(&self, stamp_ns: u64, shared: &mut Shared, observer: &impl Observer) -> Result<(), DaemonError> {
        let status = self.status(shared);
        observer.status(&status);
        if let Some(recorder) = &mut shared.recorder {
            recorder.status(stamp_ns, &status)?;
        }
        Ok(())
    }

    /// Brings what was taken to the disk, and says how the storage fares.
    fn tend_storage(
        &mut self,
        stamp_ns: u64,
        shared: &mut Shared,
        observer: &impl Observer,
    ) -> Result<(), DaemonError> {
        let Some(recorder) = &mut shared.recorder else {
            return Ok(());
        };
        for (level, message) in recorder.tick(Instant::now())? {
            tell(&Notice { stamp_ns, message }, level, shared, observer)?;
        }
        Ok(())
    }

    /// Says whose data have become stale, or fresh again; the next status record does not wait for its turn.
    fn tell_stale(&mut self, stamp_ns: u64, shared: &mut Shared, observer: &impl Observer) -> Result<(), DaemonError> {
        let changes = self.freshness.look(Instant::now(), self.pipeline.samples());
        for (stale, message) in &changes {
            let level = if *stale { LogLevel::Warning } else { LogLevel::Info };
            let message = message.clone();
            tell_unless_many(&Notice { stamp_ns, message }, level, shared, observer)?;
        }
        if !changes.is_empty() {
            self.write_status(stamp_ns, shared, observer)?;
        }
        Ok(())
    }

    fn count_dropped(&mut self, job: &WindowJob, shared: &mut Shared) -> Result<(), DaemonError> {
        self.pipeline.losses.windows += 1;
        self.fresh_drops += 1;
        if let Some(recorder) = &mut shared.recorder {
            recorder.dropped(job)?;
        }
        Ok(())
    }

    fn tell_notices(&mut self, shared: &mut Shared, observer: &impl Observer) -> Result<(), DaemonError> {
        for notice in self.pipeline.take_notices() {
            tell_unless_many(&notice, LogLevel::Warning, shared, observer)?;
        }
        Ok(())
    }

    /// Reports what was lost since the last time, in one line for each bus and kind.
    fn tell_losses(&mut self, stamp_ns: u64, shared: &mut Shared, observer: &impl Observer) -> Result<(), DaemonError> {
        for ((bus, loss), frames) in std::mem::take(&mut self.fresh_losses) {
            let name = self.names.name(bus).unwrap_or_default();
            let message = format!("{name}: {frames} frames lost: {loss}");
            tell_unless_many(&Notice { stamp_ns, message }, LogLevel::Error, shared, observer)?;
        }
        for (bus, stats) in self.pipeline.serial().collect::<Vec<_>>() {
            let told = self.told.insert(bus, stats).unwrap_or_default();
            if let Some(unreadable) = unreadable_since(told, stats) {
                let name = self.names.name(bus).unwrap_or_default();
                let message = format!("{name}: {unreadable}");
                tell_unless_many(&Notice { stamp_ns, message }, LogLevel::Error, shared, observer)?;
            }
        }
        let windows = std::mem::take(&mut self.fresh_drops);
        if windows > 0 {
            let message = format!("{windows} windows dropped: identification does not keep up");
            tell_unless_many(&Notice { stamp_ns, message }, LogLevel::Error, shared, observer)?;
        }
        Ok(())
    }
}

/// The frames of a serial line that could not be read since then, by cause; `None` if there are none.
fn unreadable_since(then: DeframerStats, now: DeframerStats) -> Option<String> {
    let fresh = FrameError::ALL.map(|fault| (now.dropped_for(fault) - then.dropped_for(fault), fault));
    let said: Vec<String> = fresh
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, fault)| format!("{count} {fault}"))
        .collect();
    let frames: u64 = fresh.iter().map(|(count, _)| count).sum();
    (frames > 0).then(|| format!("{frames} frames lost: {}", said.join(", ")))
}

/// Tells it, unless there were many of its kind lately.
pub(super) fn tell_unless_many(
    notice: &Notice,
    level: LogLevel,
    shared: &mut Shared,
    observer: &impl Observer,
) -> Result<(), DaemonError> {
    if shared.notices.pass(notice, level) {
        tell(notice, level, shared, observer)?;
    }
    Ok(())
}

/// Tells how many of each kind were held back, at the end.
pub(super) fn tell_last_summaries(shared: &mut Shared, observer: &impl Observer) -> Result<(), DaemonError> {
    for (notice, level) in shared.notices.last_summaries(now_ns()) {
        tell(&notice, level, shared, observer)?;
    }
    Ok(())
}

/// Says something to the operator and into the records.
pub(super) fn tell(
    notice: &Notice,
    level: LogLevel,
    shared: &mut Shared,
    observer: &impl Observer,
) -> Result<(), DaemonError> {
    observer.notice_of(level, &notice.message);
    if let Some(recorder) = &mut shared.recorder {
        recorder.notice(notice, level)?;
    }
    Ok(())
}
