//! File driver: the same chain as live, with time taken from the file.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::config::Config;
use crate::frame::BusNames;
use crate::front::{FrameCounts, Front, Notice, WindowJob};
use crate::ingest::{FrameSource, IngestError, Loss, open_with};
use crate::judge::{Judge, JudgeError, Judged};
use crate::record::{Log, LogLevel, Status};
use crate::sink::{Sink, SinkError, SyncedFile};

/// Why a replay failed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// A log cannot be read at all.
    #[error(transparent)]
    Ingest(#[from] IngestError),
    /// The windows cannot be judged.
    #[error(transparent)]
    Judge(#[from] JudgeError),
    /// The output is one of the logs.
    #[error("{path}: expected an output that is none of the logs, found a log")]
    OutputIsLog {
        /// The file.
        path: String,
    },
    /// The output cannot be written.
    #[error("{path}: {source}")]
    Create {
        /// The file.
        path: String,
        /// What the system said.
        source: io::Error,
    },
    /// The output cannot be written.
    #[error("{path}: {source}")]
    Sink {
        /// The file.
        path: String,
        /// What went wrong.
        source: SinkError,
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
        let s = &self.status;
        s.lost_unreadable + s.lost_damaged + s.lost_samples + s.lost_malformed + s.lost_late > 0
            || self.damaged_places > 0
    }
}

/// What a replay tells while it runs.
pub trait Observer {
    /// One window has been judged.
    fn judged(&mut self, judged: &Judged) -> io::Result<()>;
    /// Something an operator should read.
    fn notice(&mut self, message: &str);
    /// Bytes read of all.
    fn progress(&mut self, position: u64);
}

struct Run<'a, O> {
    front: Front,
    judge: Judge,
    sink: Option<(String, Sink<SyncedFile>)>,
    observer: &'a mut O,
    windows: u64,
    last_stamp_ns: u64,
    /// Newest stamp of each interface, ns: frames of a later log up to it have been seen or come out of order.
    newest_ns: BTreeMap<u16, u64>,
    overlapping: u64,
    lost_unreadable: u64,
    lost_damaged: u64,
    damaged_places: u64,
}

impl Replay<'_> {
    /// Runs the whole chain.
    ///
    /// # Errors
    /// [`ReplayError`] when a log cannot be read at all, the configuration cannot be used, or the output cannot be
    /// written. Damaged data are counted in the summary instead.
    pub fn run(&self, observer: &mut impl Observer) -> Result<Summary, ReplayError> {
        let mut names = BusNames::new();
        // An output is begun only once the first log has turned out to be one.
        let mut opened = None;
        if let Some(log) = self.logs.first() {
            opened = Some(open_with(log, std::mem::take(&mut names))?);
        }
        let sink = match self.output {
            Some(path) => Some(self.create(path)?),
            None => None,
        };
        let mut run = Run {
            front: Front::new(self.config.clone()),
            judge: Judge::new(self.config.clone(), self.seed),
            sink,
            observer,
            windows: 0,
            last_stamp_ns: 0,
            newest_ns: BTreeMap::new(),
            overlapping: 0,
            lost_unreadable: 0,
            lost_damaged: 0,
            damaged_places: 0,
        };
        let mut read_before = 0;
        for log in self.logs {
            let source = match opened.take() {
                Some(source) => source,
                None => open_with(log, names)?,
            };
            names = run.one_log(log, source, &mut read_before, self.config.output().raw_frames)?;
        }
        run.finish()
    }

    fn create(&self, path: &Path) -> Result<(String, Sink<SyncedFile>), ReplayError> {
        let name = path.display().to_string();
        if let Ok(place) = path.canonicalize()
            && self
                .logs
                .iter()
                .any(|log| log.canonicalize().is_ok_and(|log| log == place))
        {
            return Err(ReplayError::OutputIsLog { path: name });
        }
        let file = File::create(path).map_err(|source| ReplayError::Create {
            path: name.clone(),
            source,
        })?;
        let sink = Sink::new(SyncedFile::new(file), &metadata(&self.config, "log", self.seed)).map_err(|source| {
            ReplayError::Sink {
                path: name.clone(),
                source,
            }
        })?;
        Ok((name, sink))
    }
}

/// Metadata of a record file.
#[must_use]
pub fn metadata(config: &Config, clock_source: &str, seed: u64) -> BTreeMap<String, String> {
    let mut metadata: BTreeMap<String, String> = [
        ("build", concat!("hmd ", env!("CARGO_PKG_VERSION")).to_owned()),
        ("clock_source", clock_source.to_owned()),
        ("config_hash", config.hash()),
        ("model_hash", crate::judge::model_hash(config)),
        ("seed", seed.to_string()),
    ]
    .into_iter()
    .map(|(key, value)| (key.to_owned(), value))
    .collect();
    for actuator in config.actuators() {
        for (key, value) in [
            ("part_number", &actuator.part_number),
            ("serial_number", &actuator.serial_number),
        ] {
            if let Some(value) = value {
                metadata.insert(format!("{}.{key}", actuator.name), value.clone());
            }
        }
    }
    metadata
}

impl<O: Observer> Run<'_, O> {
    fn one_log(
        &mut self,
        log: &Path,
        mut source: FrameSource,
        read_before: &mut u64,
        store_raw: bool,
    ) -> Result<BusNames, ReplayError> {
        let mut ended = Vec::new();
        let mut frames = 0u64;
        let seen_ns = self.newest_ns.clone();
        let mut overlapping = 0u64;
        while let Some(item) = source.next() {
            match item {
                Ok(frame) if seen_ns.get(&frame.bus).is_some_and(|&seen| frame.stamp_ns <= seen) => overlapping += 1,
                Ok(frame) => {
                    let newest = self.newest_ns.entry(frame.bus).or_default();
                    *newest = frame.stamp_ns.max(*newest);
                    self.last_stamp_ns = self.last_stamp_ns.max(frame.stamp_ns);
                    if store_raw && let Some((path, sink)) = &mut self.sink {
                        sink.raw(&frame, source.bus_names())
                            .map_err(|source| ReplayError::Sink {
                                path: path.clone(),
                                source,
                            })?;
                    }
                    self.front.push(&frame, source.bus_names(), &mut ended);
                    self.judge_all(&mut ended)?;
                }
                Err(loss) => self.lost(&loss)?,
            }
            frames += 1;
            if frames.is_multiple_of(4096) {
                self.observer.progress(*read_before + source.position());
            }
        }
        *read_before += source.position();
        if overlapping > 0 {
            self.overlapping += overlapping;
            let message = format!(
                "{}: expected frames later than those of the logs before, found {overlapping} that are not (logs \
                 overlap or are out of order); they are not used",
                log.display()
            );
            let stamp_ns = self.last_stamp_ns;
            self.notice(&Notice { stamp_ns, message }, LogLevel::Error)?;
        }
        self.front.finish(&mut ended);
        self.judge_all(&mut ended)?;
        Ok(source.into_bus_names())
    }

    fn judge_all(&mut self, ended: &mut Vec<WindowJob>) -> Result<(), ReplayError> {
        for notice in self.front.take_notices() {
            self.notice(&notice, LogLevel::Warning)?;
        }
        for job in ended.drain(..) {
            let judged = self.judge.judge(&job)?;
            self.windows += 1;
            if let Some((path, sink)) = &mut self.sink {
                let at = judged.health.t_start_ns;
                sink.write(at, &judged.window)
                    .and_then(|()| sink.write(at, &judged.health))
                    .and_then(|()| sink.write(at, &judged.rul))
                    .and_then(|()| sink.flush_window())
                    .map_err(|source| ReplayError::Sink {
                        path: path.clone(),
                        source,
                    })?;
            }
            self.observer.judged(&judged).map_err(|source| ReplayError::Create {
                path: "stdout".to_owned(),
                source,
            })?;
        }
        Ok(())
    }

    fn lost(&mut self, loss: &Loss) -> Result<(), ReplayError> {
        match loss {
            Loss::Line(_) => self.lost_unreadable += 1,
            Loss::Mcap(_) => {
                self.lost_damaged += loss.frames();
                self.damaged_places += 1;
            }
        }
        self.notice(
            &Notice {
                stamp_ns: self.last_stamp_ns,
                message: loss.to_string(),
            },
            LogLevel::Error,
        )
    }

    fn notice(&mut self, notice: &Notice, level: LogLevel) -> Result<(), ReplayError> {
        self.observer.notice(&notice.message);
        if let Some((path, sink)) = &mut self.sink {
            sink.write(
                notice.stamp_ns,
                &Log::new(notice.stamp_ns, level, "hmd", &notice.message),
            )
            .map_err(|source| ReplayError::Sink {
                path: path.clone(),
                source,
            })?;
        }
        Ok(())
    }

    fn finish(self) -> Result<Summary, ReplayError> {
        let (frames, windows) = (self.front.counts(), self.judge.counts());
        let (mut actuators, mut samples, mut missing) = (0, 0, 0);
        for (_, delivered, lost) in self.front.actuators() {
            actuators += 1;
            samples += delivered;
            missing += lost;
        }
        let status = Status {
            frames_received: frames.received,
            frames_decoded: frames.decoded,
            frames_filtered: frames.filtered,
            frames_error: frames.error,
            samples,
            lost_unreadable: self.lost_unreadable,
            lost_damaged: self.lost_damaged,
            lost_samples: missing,
            lost_malformed: frames.malformed,
            lost_late: self.front.late() + self.overlapping,
            windows_ok: windows.ok,
            windows_degraded: windows.degraded,
            windows_invalid: windows.invalid,
            windows_unmodelled: windows.unmodelled,
            ..Status::default()
        };
        if let Some((path, mut sink)) = self.sink {
            sink.write(self.last_stamp_ns, &status)
                .and_then(|()| sink.finish().map(|_| ()))
                .map_err(|source| ReplayError::Sink { path, source })?;
        }
        Ok(Summary {
            status,
            actuators,
            windows: self.windows,
            frames,
            damaged_places: self.damaged_places,
        })
    }
}
