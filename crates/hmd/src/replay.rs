//! File driver: the same chain as live, with time taken from the file.

mod error;
mod held_events;
mod learnt_units;
mod live_decisions;
mod recorded_units;
mod succession;
mod summary;

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::recorded_use::RecordedUse;
use ema_identify::effort::{Effort, RecordedGrants};
use hmd_core::assess::{AssessError, AssessedWindow, Assessor, Estimator, Identification};
use hmd_core::config::Config;
use hmd_core::counted::counted;
use hmd_core::deadline::TimeLimit;
use hmd_core::frame::BusNames;
use hmd_core::history::Events;
use hmd_core::learning::Learner;
use hmd_core::outbox::Notice;
use hmd_core::pipeline::Pipeline;
use hmd_core::record::LogLevel;
use hmd_ingest::Loss;
use hmd_ingest::file::{FrameSource, open_mapped};
use hmd_storage::calibration_file::load_models;
use hmd_storage::event_file::load_events;
use hmd_storage::recorder::{RecordObserver, Recorder, metadata};
use hmd_storage::same_file::is_same_file;
use hmd_storage::serial_numbers::serial_numbers;
use learnt_units::LearntUnits;
use live_decisions::LiveDecisions;
use succession::{LastSegment, Succession};

pub use error::ReplayError;
pub use summary::Summary;
pub(crate) use summary::{other_frames, watched};

/// What a replay is made of.
#[derive(Debug)]
pub struct Replay<'a> {
    /// Logs in the order of time.
    pub logs: &'a [PathBuf],
    /// Where records go, if anywhere.
    pub output: Option<&'a Path>,
    /// Configuration.
    pub config: Arc<Config>,
    /// Seed of every search.
    pub seed: u64,
}

/// Receives what happens while a replay runs.
pub trait Observer {
    /// The first frame that is used of a log, with its stamp, ns. A window that began before it, of a log that the one before goes on in,
    /// may still come.
    fn log_begins(&mut self, _log: &Path, _stamp_ns: u64) {}
    /// One window has been assessed.
    fn assessed(&mut self, assessed: &AssessedWindow) -> io::Result<()>;
    /// Something an operator should read.
    fn notice(&mut self, message: &str);
    /// Bytes read of all.
    fn progress(&mut self, position: u64);
}

/// Losses of one log that are told one by one; of the others, their number. All are counted.
pub(crate) const LOSSES_TOLD: u64 = 20;

struct Run<'a, O> {
    pipeline: Pipeline,
    assessor: Assessor,
    learner: Learner,
    recorder: Option<Recorder>,
    observer: &'a mut O,
    windows: u64,
    /// What became of windows when the logs were made.
    live: LiveDecisions,
    units: LearntUnits,
    events: Events,
    /// Windows of the log that its run did not come to.
    left_out: u64,
    /// Newest stamp of each interface, ns: frames of a later log up to it have been seen or come out of order.
    newest_ns: BTreeMap<u16, u64>,
    damaged_places: u64,
    /// Losses of the log that is read; the first [`LOSSES_TOLD`] are told one by one.
    losses_of_log: u64,
    recorded: RecordedUse,
    /// Serial numbers by actuator, by the logs so far.
    serial_numbers: BTreeMap<String, String>,
    segment: LastSegment,
}

impl Replay<'_> {
    /// Runs the whole chain.
    ///
    /// # Errors
    /// [`ReplayError`] when a log cannot be read at all, the configuration cannot be used, or the output cannot be
    /// written. Damaged data are counted in the summary instead.
    pub fn run(&self, observer: &mut impl Observer) -> Result<Summary, ReplayError> {
        self.run_observed(observer, None)
    }

    /// The same; `records` observes every record.
    ///
    /// # Errors
    /// As [`Replay::run`].
    pub fn run_observed(
        &self,
        observer: &mut impl Observer,
        records: Option<Box<dyn RecordObserver>>,
    ) -> Result<Summary, ReplayError> {
        self.run_with(observer, records, Arc::new(Identification))
    }

    /// The same with another estimator.
    ///
    /// # Errors
    /// As [`Replay::run`].
    pub fn run_with(
        &self,
        observer: &mut impl Observer,
        records: Option<Box<dyn RecordObserver>>,
        estimator: Arc<dyn Estimator>,
    ) -> Result<Summary, ReplayError> {
        let mut names = BusNames::new();
        // An output is begun only once the first log has turned out to be one.
        let mut opened = None;
        if let Some(log) = self.logs.first() {
            opened = Some(open_mapped(log, std::mem::take(&mut names), &self.config)?);
        }
        let recorder = match self.output {
            Some(path) => Some(self.create(path)?),
            None => records.as_ref().map(|_| Recorder::nowhere()),
        };
        let recorder = match records {
            Some(records) => recorder.map(|recorder| recorder.with_observer(records)),
            None => recorder,
        };
        let mut assessor =
            Assessor::new(self.config.clone(), load_models(&self.config)?, self.seed).with_estimator(estimator);
        let events = load_events(&self.config)?;
        let mut live = LiveDecisions::of(self.logs, &self.config.hash());
        assessor.histories().set_events(live.held_events.without(&events));
        let units = LearntUnits::new(self.config.clone(), std::mem::take(&mut live.units));
        let mut run = Run {
            pipeline: Pipeline::new(self.config.clone()),
            assessor,
            learner: Learner::new(self.config.clone(), self.seed),
            recorder,
            observer,
            windows: 0,
            live,
            units,
            events,
            left_out: 0,
            newest_ns: BTreeMap::new(),
            damaged_places: 0,
            losses_of_log: 0,
            recorded: RecordedUse::default(),
            serial_numbers: BTreeMap::new(),
            segment: LastSegment::default(),
        };
        let mut read_before = 0;
        for (number, log) in self.logs.iter().enumerate() {
            let source = match opened.take() {
                Some(source) => source,
                None => open_mapped(log, names, &self.config)?,
            };
            let (succession, is_after) = run.segment.succession(log, &source);
            if succession != Succession::Next {
                run.end_windows()?;
            }
            if succession == Succession::AnotherRun {
                if !run.live.did_not_end() {
                    let ends = run.pipeline.run_ends();
                    let counted = run.assessor.histories().end_run(ends);
                    counted.map_err(AssessError::from)?;
                }
                run.pipeline.begin_recording();
                run.assessor.histories().begin_run();
                run.learner.begin_run();
            }
            if succession == Succession::Unknown {
                run.pipeline.begin_log();
            }
            run.live.begin_log(number);
            run.units.begin_log(number);
            if run.live.held_events.release_before(number) {
                run.set_events();
            }
            run.follow_units(log, &self.config)?;
            let store_raw = self.config.output().raw_frames;
            names = run.one_log(log, source, is_after, &mut read_before, store_raw)?;
        }
        run.end_windows()?;
        let of_use: Vec<String> = run.recorded.notices().collect();
        for message in of_use {
            let stamp_ns = run.pipeline.last_stamp_ns();
            run.notice(&Notice { stamp_ns, message }, LogLevel::Warning)?;
        }
        run.finish(&names, self)
    }

    fn create(&self, path: &Path) -> Result<Recorder, ReplayError> {
        let mut files = self.config.files();
        let actuators = self.config.actuators().iter();
        files.extend(actuators.filter_map(|actuator| self.config.learnt_file(actuator)));
        if self.logs.iter().chain(&files).any(|input| is_same_file(input, path)) {
            let path = path.display().to_string();
            return Err(ReplayError::OutputIsInput { path });
        }
        Ok(Recorder::create(path, &metadata(&self.config, "log", self.seed))?)
    }
}

impl<O: Observer> Run<'_, O> {
    fn one_log(
        &mut self,
        log: &Path,
        mut source: FrameSource,
        is_after: bool,
        read_before: &mut u64,
        store_raw: bool,
    ) -> Result<BusNames, ReplayError> {
        let mut frames = 0u64;
        // The clock may have stepped back between two segments; no frame is in both.
        let seen_ns = if is_after {
            BTreeMap::new()
        } else {
            self.newest_ns.clone()
        };
        let mut overlapping = 0u64;
        let mut has_begun = false;
        while let Some(item) = source.next() {
            match item {
                Ok(frame) if seen_ns.get(&frame.bus).is_some_and(|&seen| frame.stamp_ns <= seen) => overlapping += 1,
                Ok(frame) => {
                    if !std::mem::replace(&mut has_begun, true) {
                        self.observer.log_begins(log, frame.stamp_ns);
                    }
                    let newest = self.newest_ns.entry(frame.bus).or_default();
                    *newest = frame.stamp_ns.max(*newest);
                    if store_raw && let Some(recorder) = &mut self.recorder {
                        recorder.write_frame(&frame, source.bus_names())?;
                    }
                    self.pipeline.push(&frame, source.bus_names());
                    self.assess_windows()?;
                }
                Err(loss) => self.lost(&loss)?,
            }
            frames += 1;
            if frames.is_multiple_of(4096) {
                self.observer.progress(*read_before + source.position());
            }
        }
        *read_before += source.position();
        for message in source.remarks() {
            let stamp_ns = self.pipeline.last_stamp_ns();
            self.notice(&Notice { stamp_ns, message }, LogLevel::Warning)?;
        }
        let untold = std::mem::take(&mut self.losses_of_log).saturating_sub(LOSSES_TOLD);
        if untold > 0 {
            let message = format!(
                "{}: data lost at {}",
                log.display(),
                counted(untold, "more place", "more places")
            );
            let stamp_ns = self.pipeline.last_stamp_ns();
            self.notice(&Notice { stamp_ns, message }, LogLevel::Error)?;
        }
        if overlapping > 0 {
            self.pipeline.losses.overlapping += overlapping;
            let message = format!(
                "{}: expected frames later than those of the logs before, found {overlapping} that are not (logs \
                 overlap or are out of order); they are not used",
                log.display()
            );
            let stamp_ns = self.pipeline.last_stamp_ns();
            self.notice(&Notice { stamp_ns, message }, LogLevel::Error)?;
        }
        Ok(source.into_bus_names())
    }

    /// A unit whose serial number is another than in the logs before begins a history of its own.
    fn follow_units(&mut self, log: &Path, config: &Config) -> Result<(), ReplayError> {
        for (actuator, serial) in serial_numbers(log) {
            let configured = config
                .actuator_named(&actuator)
                .and_then(|of| of.serial_number.as_ref());
            if let Some(configured) = configured.filter(|configured| **configured != serial) {
                let log = log.display();
                let message = format!("{log}: {actuator}: recorded of unit {serial}, assessed as unit {configured}");
                let stamp_ns = self.pipeline.last_stamp_ns();
                self.notice(&Notice { stamp_ns, message }, LogLevel::Error)?;
            }
            let before = self.serial_numbers.insert(actuator.clone(), serial.clone());
            let Some(before) = before.filter(|before| *before != serial) else {
                continue;
            };
            self.learner.forget(&mut self.assessor, &actuator);
            if self.assessor.histories().remove(&actuator) {
                let message = format!("{actuator}: history reset, unit {serial} after {before}");
                let stamp_ns = self.pipeline.last_stamp_ns();
                self.notice(&Notice { stamp_ns, message }, LogLevel::Info)?;
            }
        }
        Ok(())
    }

    fn end_windows(&mut self) -> Result<(), ReplayError> {
        self.pipeline.finish();
        self.assess_windows()?;
        let left_out = std::mem::take(&mut self.left_out);
        if left_out > 0 {
            let windows = counted(left_out, "window is", "windows are");
            let message = format!("{windows} left out: not assessed when the run was killed, or not yet");
            let stamp_ns = self.pipeline.last_stamp_ns();
            self.notice(&Notice { stamp_ns, message }, LogLevel::Info)?;
        }
        Ok(())
    }

    fn assess_windows(&mut self) -> Result<(), ReplayError> {
        for notice in self.pipeline.take_notices() {
            self.notice(&notice, LogLevel::Warning)?;
        }
        for job in self.pipeline.take_windows() {
            self.windows += 1;
            let key = (job.actuator.name.clone(), job.window.t_start_ns);
            if !self.live.was_decided(&key) {
                self.left_out += 1;
                continue;
            }
            if self.live.dropped.contains(&key) {
                self.pipeline.losses.windows += 1;
                if let Some(recorder) = &mut self.recorder {
                    recorder.write_dropped(&job)?;
                }
                continue;
            }
            let shortened = self.live.shortened.get(&key);
            let mut grants = shortened.map(|shortened| RecordedGrants::new(shortened.short_grants()));
            let limit = TimeLimit {
                deadline_ms: shortened.map_or(0, |shortened| shortened.deadline_ms),
                effort: grants
                    .as_mut()
                    .map_or_else(Effort::unlimited, |grants| Effort::within(grants)),
            };
            if self
                .live
                .held_events
                .release_at(&job.actuator.name, job.window.t_start_ns)
            {
                self.set_events();
            }
            let not_learnt = self.units.prepare(&mut self.learner, &mut self.assessor, &job)?;
            let assessed = self
                .learner
                .assess_unless(&mut self.assessor, job, &limit, not_learnt)?;
            self.learner.commission_complete(&mut self.assessor)?;
            for (level, message) in self.units.take_notices() {
                let stamp_ns = assessed.health.t_start_ns;
                self.notice(&Notice { stamp_ns, message }, level)?;
            }
            let of_histories = self.assessor.histories().take_notices();
            for message in of_histories.into_iter().chain(self.learner.take_notices()) {
                let stamp_ns = assessed.health.t_start_ns;
                self.notice(&Notice { stamp_ns, message }, LogLevel::Info)?;
            }
            if let Some(recorder) = &mut self.recorder {
                recorder.write_assessed(&assessed)?;
            }
            self.recorded.add(&assessed.rul);
            self.observer.assessed(&assessed).map_err(ReplayError::Stdout)?;
        }
        Ok(())
    }

    /// The maintenance events but those that are held.
    fn set_events(&mut self) {
        let events = self.live.held_events.without(&self.events);
        self.assessor.histories().set_events(events);
    }

    fn lost(&mut self, loss: &Loss) -> Result<(), ReplayError> {
        self.damaged_places += loss.count_into(&mut self.pipeline.losses);
        self.losses_of_log += 1;
        if self.losses_of_log > LOSSES_TOLD {
            return Ok(());
        }
        self.notice(
            &Notice {
                stamp_ns: self.pipeline.last_stamp_ns(),
                message: loss.to_string(),
            },
            LogLevel::Error,
        )
    }

    fn notice(&mut self, notice: &Notice, level: LogLevel) -> Result<(), ReplayError> {
        self.observer.notice(&notice.message);
        if let Some(recorder) = &mut self.recorder {
            recorder.write_notice(notice, level)?;
        }
        Ok(())
    }

    /// Ends the output, unless the logs held nothing to assess: it then leaves what is at its place.
    fn finish(self, names: &BusNames, replay: &Replay<'_>) -> Result<Summary, ReplayError> {
        let status = self.pipeline.status(names, self.assessor.counts());
        let last_stamp_ns = self.pipeline.last_stamp_ns();
        let summary = Summary {
            status,
            actuators: self.pipeline.actuators(),
            windows: self.windows,
            frames: self.pipeline.frames(),
            damaged_places: self.damaged_places,
            windows_without_unit: self.units.windows_without,
            talkers: self.pipeline.talkers().map(|(_, talker)| talker).collect(),
        };
        if let Some(mut recorder) = self.recorder {
            recorder.write_status(last_stamp_ns, &summary.status)?;
            if summary.check(replay.logs, &replay.config).is_ok() {
                recorder.finish()?;
            } else {
                recorder.discard()?;
            }
        }
        Ok(summary)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hmd_core::assess::Models;
    use hmd_core::record::Status;

    #[test]
    fn a_new_serial_number_resets_the_history() {
        struct Nobody;
        impl Observer for Nobody {
            fn assessed(&mut self, _: &AssessedWindow) -> io::Result<()> {
                Ok(())
            }
            fn notice(&mut self, _: &str) {}
            fn progress(&mut self, _: u64) {}
        }
        let folder = tempfile::tempdir().unwrap();
        let config = Arc::new(Config::default());
        let mut run = Run {
            pipeline: Pipeline::new(config.clone()),
            assessor: Assessor::new(config.clone(), Models::without_files(&config).unwrap(), 1),
            learner: Learner::new(config.clone(), 1),
            recorder: None,
            observer: &mut Nobody,
            windows: 0,
            live: LiveDecisions::default(),
            units: LearntUnits::new(config.clone(), Default::default()),
            events: Events::default(),
            left_out: 0,
            newest_ns: BTreeMap::new(),
            damaged_places: 0,
            losses_of_log: 0,
            recorded: RecordedUse::default(),
            serial_numbers: BTreeMap::new(),
            segment: LastSegment::default(),
        };
        let log = |serial: &str| {
            let path = folder.path().join(format!("{serial}.mcap"));
            let text = format!("[[actuator]]\nid = 0\nserial_number = \"{serial}\"");
            let of = Config::from_toml_str(&text, "test").unwrap();
            let mut recorder = Recorder::create(&path, &metadata(&of, "log", 1)).unwrap();
            recorder.write_status(1, &Status::default()).unwrap();
            recorder.finish().unwrap();
            path
        };
        let actuator = config.actuator_named("ema0").unwrap();
        let (first, second) = (log("S1"), log("S2"));
        run.follow_units(&first, &config).unwrap();
        run.assessor.histories().history_at(actuator, 1).unwrap();
        run.follow_units(&first, &config).unwrap();
        assert!(run.assessor.histories().remove("ema0"), "the same unit goes on");
        run.assessor.histories().history_at(actuator, 2).unwrap();
        run.follow_units(&second, &config).unwrap();
        assert!(!run.assessor.histories().remove("ema0"), "another one does not");
    }
}
