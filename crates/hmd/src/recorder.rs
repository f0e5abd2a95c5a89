//! Where live and replay put what they find: the records of a run in one MCAP file.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::Path;

use crate::config::Config;
use crate::frame::{BusNames, RawFrame};
use crate::front::{Notice, WindowJob};
use crate::judge::Judged;
use crate::record::{Dropped, Log, LogLevel, Record, Status};
use crate::sink::{Sink, SinkError, SyncedFile};

/// Why records cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file cannot be created.
    #[error("{path}: {source}")]
    Create {
        /// The file.
        path: String,
        /// What the system said.
        source: io::Error,
    },
    /// The file cannot be written.
    #[error("{path}: {source}")]
    Sink {
        /// The file.
        path: String,
        /// What went wrong.
        source: SinkError,
    },
}

/// A record file in progress. Call [`Recorder::finish`].
pub struct Recorder {
    path: String,
    sink: Sink<SyncedFile>,
}

impl Recorder {
    /// Begins a file with this metadata.
    ///
    /// # Errors
    /// When the file cannot be created or written.
    pub fn create(path: &Path, metadata: &BTreeMap<String, String>) -> Result<Self, RecordError> {
        let name = path.display().to_string();
        let file = File::create(path).map_err(|source| RecordError::Create {
            path: name.clone(),
            source,
        })?;
        match Sink::new(SyncedFile::new(file), metadata) {
            Ok(sink) => Ok(Self { path: name, sink }),
            Err(source) => Err(RecordError::Sink { path: name, source }),
        }
    }

    /// Takes one frame as received.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn raw(&mut self, frame: &RawFrame, names: &BusNames) -> Result<(), RecordError> {
        let written = self.sink.raw(frame, names);
        self.named(written)
    }

    /// Writes the records of a judged window, and brings all so far to the disk.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn judged(&mut self, judged: &Judged) -> Result<(), RecordError> {
        let at = judged.health.t_start_ns;
        let written = self
            .sink
            .write(at, &judged.window)
            .and_then(|()| self.sink.write(at, &judged.health))
            .and_then(|()| self.sink.write(at, &judged.rul))
            .and_then(|()| self.sink.flush_window());
        self.named(written)
    }

    /// Says that a window was dropped.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn dropped(&mut self, job: &WindowJob) -> Result<(), RecordError> {
        let at = job.window.t_start_ns;
        let record = Dropped {
            actuator: job.actuator.name.clone(),
            window: job.window.number,
            t_start_ns: at,
        };
        self.write(at, &record)
    }

    /// Writes a line for an operator.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn notice(&mut self, notice: &Notice, level: LogLevel) -> Result<(), RecordError> {
        let at = notice.stamp_ns;
        self.write(at, &Log::new(at, level, "hmd", &notice.message))
    }

    /// Writes the counters as they stand at `stamp_ns`.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn status(&mut self, stamp_ns: u64, status: &Status) -> Result<(), RecordError> {
        self.write(stamp_ns, status)
    }

    /// Ends the file.
    ///
    /// # Errors
    /// When the file cannot be written; it can then be read up to its last whole chunk.
    pub fn finish(self) -> Result<(), RecordError> {
        match self.sink.finish() {
            Ok(_) => Ok(()),
            Err(source) => Err(RecordError::Sink {
                path: self.path,
                source,
            }),
        }
    }

    fn write<R: Record>(&mut self, at_ns: u64, record: &R) -> Result<(), RecordError> {
        let written = self.sink.write(at_ns, record);
        self.named(written)
    }

    fn named(&self, written: Result<(), SinkError>) -> Result<(), RecordError> {
        written.map_err(|source| RecordError::Sink {
            path: self.path.clone(),
            source,
        })
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
