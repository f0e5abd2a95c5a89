//! File driver: the same chain as live, with time taken from the file.

mod live_decisions;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::recorded_use::RecordedUse;
use ema_identify::effort::{Effort, RecordedGrants};
use hmd_core::assess::{AssessError, AssessedWindow, Assessor, Estimator, Identification};
use hmd_core::config::{ActuatorConfig, Config};
use hmd_core::counted::counted;
use hmd_core::dbc::MessageUse;
use hmd_core::deadline::TimeLimit;
use hmd_core::demux::FrameCounts;
use hmd_core::frame::BusNames;
use hmd_core::learning::Learner;
use hmd_core::metadata_checksum::is_sealed;
use hmd_core::outbox::Notice;
use hmd_core::pipeline::Pipeline;
use hmd_core::record::{LogLevel, Status};
use hmd_ingest::Loss;
use hmd_ingest::file::{FrameSource, IngestError, open_mapped};
use hmd_storage::calibration_file::load_models;
use hmd_storage::event_file::{EventError, load_events};
use hmd_storage::mcap::McapMessages;
use hmd_storage::mcap_writer::METADATA_NAME;
use hmd_storage::recorder::{RecordError, RecordObserver, Recorder, metadata};
use hmd_storage::same_file::is_same_file;
use live_decisions::LiveDecisions;

/// Why a replay failed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// A log cannot be read at all.
    #[error(transparent)]
    Ingest(#[from] IngestError),
    /// The windows cannot be assessed.
    #[error(transparent)]
    Assess(#[from] AssessError),
    /// The maintenance events cannot be read.
    #[error("rul.events: {0}")]
    Events(#[from] EventError),
    /// The output is a log, the configuration or a file that it names.
    #[error("{path}: expected another output than a file that is read, found one")]
    OutputIsInput {
        /// The file.
        path: String,
    },
    /// The records cannot be written.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// Stdout cannot be written.
    #[error("stdout: {0}")]
    Stdout(io::Error),
    /// No frame of an actuator that is watched.
    #[error("{logs}: expected frames of {expected}, found none ({found})")]
    NoActuator {
        /// The logs.
        logs: String,
        /// What is watched.
        expected: String,
        /// What there was instead.
        found: String,
    },
    /// Frames, but no three that make a sample.
    #[error(
        "{logs}: expected currents, position and command of one sample, found {} with currents, {} with \
         position, {} with command, and no three that belong together",
        counted(found.currents, "frame", "frames"), found.position, found.command
    )]
    NoSample {
        /// The logs.
        logs: String,
        /// Frames by what they carry.
        found: FrameCounts,
    },
}

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

/// What became of the data.
#[derive(Clone, Debug, Default)]
pub struct Summary {
    /// Counters of the whole run.
    pub status: Status,
    /// Actuators seen.
    pub actuators: u64,
    /// Windows.
    pub windows: u64,
    /// Frames by what they carry.
    pub frames: FrameCounts,
    /// Places where a recorded file is damaged, whether or not the frames lost there can be counted.
    pub damaged_places: u64,
}

impl Summary {
    /// Whether anything was lost on the way.
    #[must_use]
    pub fn data_lost(&self) -> bool {
        self.loss().is_some()
    }

    /// Whether the logs had anything to assessor.
    ///
    /// # Errors
    /// No actuator, or no sample of one.
    pub fn check(&self, logs: &[PathBuf], config: &Config) -> Result<(), ReplayError> {
        let logs = || {
            let logs: Vec<String> = logs.iter().map(|log| log.display().to_string()).collect();
            logs.join(", ")
        };
        if self.actuators == 0 {
            return Err(ReplayError::NoActuator {
                logs: logs(),
                expected: watched(config),
                found: other_frames(&self.status),
            });
        }
        if self.status.samples == 0 {
            let found = self.frames;
            return Err(ReplayError::NoSample { logs: logs(), found });
        }
        Ok(())
    }

    /// What was lost, in one sentence.
    #[must_use]
    pub fn loss(&self) -> Option<String> {
        self.status.lost_in_logs(self.damaged_places)
    }
}

/// The frames of others than the actuators watched, in words.
pub(crate) fn other_frames(status: &Status) -> String {
    let found = match (status.frames_filtered, status.lost_malformed) {
        (other, 0) => counted(other, "other frame", "other frames"),
        (0, malformed) => counted(malformed, "malformed frame", "malformed frames"),
        (other, malformed) => format!(
            "{malformed} malformed and {}",
            counted(other, "other frame", "other frames")
        ),
    };
    let interfaces: Vec<&str> = status.interfaces.iter().map(|on| on.interface.as_str()).collect();
    format!("{found} on {}", interfaces.join(", "))
}

/// What is watched, in words: which frames on which bus.
pub(crate) fn watched(config: &Config) -> String {
    if config.is_auto() {
        return "an actuator with the identifiers of ema.dbc, or a configuration (-c) that maps the DBC file of this bus"
            .to_owned();
    }
    let one = |actuator: &ActuatorConfig| {
        let bus = actuator.bus.as_deref().unwrap_or("any bus");
        let ids: Vec<String> = actuator
            .map
            .iter()
            .flat_map(|map| &map.messages)
            .map(MessageUse::shown_id)
            .collect();
        match ids.as_slice() {
            [] => format!("{} on {bus}", actuator.name),
            ids => format!("{} on {bus} ({})", actuator.name, ids.join(", ")),
        }
    };
    let all: Vec<String> = config.actuators().iter().map(one).collect();
    all.join(", ")
}

/// Receives what happens while a replay runs.
pub trait Observer {
    /// One window has been assessed.
    fn assessed(&mut self, assessed: &AssessedWindow) -> io::Result<()>;
    /// Something an operator should read.
    fn notice(&mut self, message: &str);
    /// Bytes read of all.
    fn progress(&mut self, position: u64);
}

/// Losses of one log that are told one by one; of the others, their number. All are counted.
pub(crate) const LOSSES_TOLD: u64 = 20;

/// How a log follows the one before.
enum Succession {
    /// The next segment of the same run, and none lost between.
    Next,
    /// A run of its own, or another capture of the same run.
    AnotherRun,
    /// A log that does not say, or a segment behind a lost one: what is missing between them is counted.
    Unknown,
}

struct Run<'a, O> {
    pipeline: Pipeline,
    assessor: Assessor,
    learner: Learner,
    recorder: Option<Recorder>,
    observer: &'a mut O,
    windows: u64,
    /// What became of windows for want of time when the logs were made.
    live: LiveDecisions,
    /// Newest stamp of each interface, ns: frames of a later log up to it have been seen or come out of order.
    newest_ns: BTreeMap<u16, u64>,
    damaged_places: u64,
    /// Losses of the log that is read; the first [`LOSSES_TOLD`] are told one by one.
    losses_of_log: u64,
    recorded: RecordedUse,
    /// Serial numbers by actuator, by the logs so far.
    serial_numbers: BTreeMap<String, String>,
    /// Run and number of the segment read last, if it was one.
    segment: Option<(String, u64)>,
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
        assessor.histories().set_events(load_events(&self.config)?);
        let mut run = Run {
            pipeline: Pipeline::new(self.config.clone()),
            assessor,
            learner: Learner::new(self.config.clone(), self.seed),
            recorder,
            observer,
            windows: 0,
            live: LiveDecisions::of(self.logs),
            newest_ns: BTreeMap::new(),
            damaged_places: 0,
            losses_of_log: 0,
            recorded: RecordedUse::default(),
            serial_numbers: BTreeMap::new(),
            segment: None,
        };
        let mut read_before = 0;
        for log in self.logs {
            let source = match opened.take() {
                Some(source) => source,
                None => open_mapped(log, names, &self.config)?,
            };
            let succession = run.succession(&source);
            let continued = matches!(succession, Succession::Next);
            if !continued {
                run.end_windows()?;
            }
            if matches!(succession, Succession::AnotherRun) {
                run.pipeline.begin_recording();
            }
            run.follow_units(log, &self.config)?;
            let store_raw = self.config.output().raw_frames;
            names = run.one_log(log, source, continued, &mut read_before, store_raw)?;
        }
        run.end_windows()?;
        let of_use: Vec<String> = run.recorded.notices().collect();
        for message in of_use {
            let stamp_ns = run.pipeline.last_stamp_ns();
            run.notice(&Notice { stamp_ns, message }, LogLevel::Warning)?;
        }
        run.finish(&names)
    }

    fn create(&self, path: &Path) -> Result<Recorder, ReplayError> {
        let files = self.config.files();
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
        continued: bool,
        read_before: &mut u64,
        store_raw: bool,
    ) -> Result<BusNames, ReplayError> {
        let mut frames = 0u64;
        // The clock may have stepped back between two segments of one run; no frame is in both.
        let seen_ns = if continued {
            BTreeMap::new()
        } else {
            self.newest_ns.clone()
        };
        let mut overlapping = 0u64;
        while let Some(item) = source.next() {
            match item {
                Ok(frame) if seen_ns.get(&frame.bus).is_some_and(|&seen| frame.stamp_ns <= seen) => overlapping += 1,
                Ok(frame) => {
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

    /// How a log follows the one before.
    fn succession(&mut self, source: &FrameSource) -> Succession {
        let metadata = source
            .metadata(METADATA_NAME)
            .filter(|found| is_sealed(METADATA_NAME, found));
        let segment = metadata.and_then(|found| {
            let number = found.get("segment")?.parse().ok()?;
            Some((found.get("run")?.clone(), number))
        });
        let succession = match (&self.segment, &segment) {
            (Some((before, last)), Some((run, number))) if before == run => {
                if *number == last + 1 {
                    Succession::Next
                } else {
                    Succession::Unknown
                }
            }
            (Some(_), Some(_)) => Succession::AnotherRun,
            _ => Succession::Unknown,
        };
        self.segment = segment;
        succession
    }

    fn end_windows(&mut self) -> Result<(), ReplayError> {
        self.pipeline.finish();
        self.assess_windows()
    }

    fn assess_windows(&mut self) -> Result<(), ReplayError> {
        for notice in self.pipeline.take_notices() {
            self.notice(&notice, LogLevel::Warning)?;
        }
        for job in self.pipeline.take_windows() {
            self.windows += 1;
            let key = (job.actuator.name.clone(), job.window.t_start_ns);
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
            let assessed = self.learner.assess(&mut self.assessor, job, &limit)?;
            self.learner.commission_complete(&mut self.assessor)?;
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

    fn finish(self, names: &BusNames) -> Result<Summary, ReplayError> {
        let status = self.pipeline.status(names, self.assessor.counts());
        if let Some(mut recorder) = self.recorder {
            recorder.write_status(self.pipeline.last_stamp_ns(), &status)?;
            recorder.finish()?;
        }
        Ok(Summary {
            status,
            actuators: self.pipeline.actuators(),
            windows: self.windows,
            frames: self.pipeline.frames(),
            damaged_places: self.damaged_places,
        })
    }
}

/// Serial numbers of the actuators in a log, from its writer's configuration; none in a text log.
#[must_use]
pub fn serial_numbers(log: &Path) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    // Nothing else than a regular file can be read twice.
    if !log.metadata().is_ok_and(|of| of.is_file()) {
        return found;
    }
    let Ok(file) = File::open(log) else { return found };
    let Ok(mut messages) = McapMessages::new(BufReader::new(file), &log.display().to_string()) else {
        return found;
    };
    // The metadata stand before the first message.
    let _ = messages.next();
    let metadata = messages
        .metadata(METADATA_NAME)
        .filter(|found| is_sealed(METADATA_NAME, found));
    for (key, value) in metadata.into_iter().flatten() {
        if let Some(actuator) = key.strip_suffix(".serial_number") {
            found.insert(actuator.to_owned(), value.clone());
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use hmd_core::assess::Models;

    #[test]
    fn a_log_contains_the_serial_numbers_of_its_units() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("unit.mcap");
        let text = "[[actuator]]\nid = 0\nserial_number = \"S7\"";
        let config = Config::from_toml_str(text, "test").unwrap();
        let mut recorder = Recorder::create(&path, &metadata(&config, "log", 1)).unwrap();
        recorder.write_status(1, &Status::default()).unwrap();
        recorder.finish().unwrap();
        let expected = BTreeMap::from([("ema0".to_owned(), "S7".to_owned())]);
        assert_eq!(serial_numbers(&path), expected);
        let mut bytes = std::fs::read(&path).unwrap();
        let at = bytes.windows(2).position(|two| two == b"S7").unwrap();
        bytes[at + 1] = b'8';
        std::fs::write(&path, bytes).unwrap();
        assert_eq!(serial_numbers(&path), BTreeMap::new(), "no checksum vouches for S8");
        std::fs::write(&path, "no log").unwrap();
        assert_eq!(serial_numbers(&path), BTreeMap::new());
    }

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
            newest_ns: BTreeMap::new(),
            damaged_places: 0,
            losses_of_log: 0,
            recorded: RecordedUse::default(),
            serial_numbers: BTreeMap::new(),
            segment: None,
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
