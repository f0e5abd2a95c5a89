//! Where live and replay put what they find: the records of a run in one MCAP file, or in a folder of segments.
//!
//! A file that cannot be written ends the run; a folder survives it ([`Store`]), counts what it loses and says so.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::Path;
use std::time::Instant;

use prost_types::FileDescriptorSet;

use crate::calibration_file::hash_of_models;
use crate::mcap_writer::{Sink, SinkError, SyncedFile};
use crate::segment_store::{RealDisk, Store, StoreEnd, StoreError};
use hmd_core::assess::AssessedWindow;
use hmd_core::config::{Config, Limits};
use hmd_core::demux::{Notice, WindowJob};
use hmd_core::frame::{BusNames, RawFrame};
use hmd_core::record::{Dropped, Log, LogLevel, Record, Status, StoreStatus};

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
    /// There is no such folder for us.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The file cannot be written.
    #[error("{path}: {source}")]
    Sink {
        /// The file.
        path: String,
        /// What went wrong.
        source: SinkError,
    },
}

/// One record as it is written.
#[derive(Clone, Debug)]
pub struct Told {
    /// Its time, UTC, ns.
    pub at_ns: u64,
    /// Where it goes.
    pub topic: String,
    /// Name of its schema.
    pub schema: &'static str,
    /// Descriptor of its schema.
    pub descriptor: fn() -> FileDescriptorSet,
    /// The encoded message.
    pub data: Vec<u8>,
}

/// Who hears every record but raw frames, after it was handed to the output. It must not wait: those who write do.
pub trait Tap: Send {
    /// Takes one record.
    fn take(&self, told: Told);
}

/// Records in progress. Call [`Recorder::finish`].
pub struct Recorder {
    output: Output,
    tap: Option<Box<dyn Tap>>,
}

enum Output {
    /// Only the tap hears.
    Nowhere,
    File {
        path: String,
        // Much larger than the other variant's own size.
        sink: Box<Sink<SyncedFile>>,
        unsynced: bool,
    },
    Folder(Box<Store>),
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
        let sink = Sink::new(SyncedFile::new(file), metadata).map_err(|source| RecordError::Sink {
            path: name.clone(),
            source,
        })?;
        Ok(Self::to(Output::File {
            path: name,
            sink: Box::new(sink),
            unsynced: false,
        }))
    }

    /// Writes nothing; for a tap alone.
    #[must_use]
    pub fn nowhere() -> Self {
        Self::to(Output::Nowhere)
    }

    /// The same with somebody who hears all records.
    #[must_use]
    pub fn with_tap(self, tap: Box<dyn Tap>) -> Self {
        Self { tap: Some(tap), ..self }
    }

    fn to(output: Output) -> Self {
        Self { output, tap: None }
    }

    /// Begins segments in a folder.
    ///
    /// # Errors
    /// When there is no such folder for us.
    pub fn open_folder(
        folder: &Path,
        metadata: &BTreeMap<String, String>,
        limits: Limits,
    ) -> Result<Self, RecordError> {
        let store = Store::open(folder, metadata, limits, Box::new(RealDisk), Instant::now())?;
        Ok(Self::to(Output::Folder(Box::new(store))))
    }

    /// A folder if the path is one or ends with a slash, else a file.
    ///
    /// # Errors
    /// Those of [`Recorder::create`] and [`Recorder::open_folder`].
    pub fn open(path: &Path, metadata: &BTreeMap<String, String>, limits: Limits) -> Result<Self, RecordError> {
        if is_folder(path) {
            Self::open_folder(path, metadata, limits)
        } else {
            Self::create(path, metadata)
        }
    }

    /// Takes one frame as received.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn raw(&mut self, frame: &RawFrame, names: &BusNames) -> Result<(), RecordError> {
        match &mut self.output {
            Output::Folder(store) => {
                store.raw(frame, names);
                Ok(())
            }
            Output::File { .. } => self.file(|sink| sink.raw(frame, names)),
            Output::Nowhere => Ok(()),
        }
    }

    /// Writes the records of a judged window, and brings all records so far to the disk. Whether they are there.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn judged(&mut self, judged: &AssessedWindow) -> Result<bool, RecordError> {
        let at = judged.health.t_start_ns;
        let stored = match &mut self.output {
            Output::Folder(store) => {
                store.write(at, &judged.window);
                store.write(at, &judged.health);
                store.write(at, &judged.rul);
                store.sync_records()
            }
            Output::File { .. } => {
                self.file(|sink| {
                    sink.write(at, &judged.window)?;
                    sink.write(at, &judged.health)?;
                    sink.write(at, &judged.rul)
                })?;
                self.sync_file()?;
                true
            }
            Output::Nowhere => true,
        };
        self.tell(at, &judged.window);
        self.tell(at, &judged.health);
        self.tell(at, &judged.rul);
        Ok(stored)
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
        match &mut self.output {
            Output::Folder(store) => {
                store.write_to_both(at, &record);
                self.tell(at, &record);
                Ok(())
            }
            Output::File { .. } | Output::Nowhere => self.write(at, &record),
        }
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

    /// To be called every second: brings what was taken to the disk. What an operator should read about the storage.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn tick(&mut self, now: Instant) -> Result<Vec<(LogLevel, String)>, RecordError> {
        match &mut self.output {
            Output::Folder(store) => Ok(store.tick(now)),
            Output::File { .. } => self.sync_file().map(|()| Vec::new()),
            Output::Nowhere => Ok(Vec::new()),
        }
    }

    /// What an operator should read about the storage, since the last time.
    pub fn take_messages(&mut self) -> Vec<(LogLevel, String)> {
        match &mut self.output {
            Output::Folder(store) => store.take_messages(),
            Output::File { .. } | Output::Nowhere => Vec::new(),
        }
    }

    /// How a folder stands; `None` for a file.
    #[must_use]
    pub fn store_status(&self) -> Option<StoreStatus> {
        match &self.output {
            Output::Folder(store) => Some(store.status()),
            Output::File { .. } | Output::Nowhere => None,
        }
    }

    /// Ends the file or the segments; how a folder ended.
    ///
    /// # Errors
    /// When the file cannot be written; it can then be read up to its last whole chunk.
    pub fn finish(self) -> Result<Option<StoreEnd>, RecordError> {
        match self.output {
            Output::Folder(store) => Ok(Some(store.finish())),
            Output::Nowhere => Ok(None),
            Output::File { path, sink, .. } => match sink.finish() {
                Ok(_) => Ok(None),
                Err(source) => Err(RecordError::Sink { path, source }),
            },
        }
    }

    fn write<R: Record>(&mut self, at_ns: u64, record: &R) -> Result<(), RecordError> {
        match &mut self.output {
            Output::Folder(store) => store.write(at_ns, record),
            Output::File { .. } => self.file(|sink| sink.write(at_ns, record))?,
            Output::Nowhere => {}
        }
        self.tell(at_ns, record);
        Ok(())
    }

    fn tell<R: Record>(&self, at_ns: u64, record: &R) {
        if let Some(tap) = &self.tap {
            tap.take(Told {
                at_ns,
                topic: record.topic(),
                schema: R::SCHEMA_NAME,
                descriptor: R::descriptor,
                data: record.encode_to_vec(),
            });
        }
    }

    fn file(&mut self, put: impl FnOnce(&mut Sink<SyncedFile>) -> Result<(), SinkError>) -> Result<(), RecordError> {
        let Output::File { path, sink, unsynced } = &mut self.output else {
            unreachable!("only called for a file")
        };
        *unsynced = true;
        put(sink).map_err(|source| RecordError::Sink {
            path: path.clone(),
            source,
        })
    }

    fn sync_file(&mut self) -> Result<(), RecordError> {
        if matches!(&self.output, Output::File { unsynced: true, .. }) {
            self.file(Sink::flush_window)?;
            if let Output::File { unsynced, .. } = &mut self.output {
                *unsynced = false;
            }
        }
        Ok(())
    }
}

/// Whether an output is meant as a folder: it is one, or its name ends with a slash.
#[must_use]
pub fn is_folder(path: &Path) -> bool {
    path.is_dir() || path.as_os_str().as_encoded_bytes().ends_with(b"/")
}

/// Metadata of a record file.
#[must_use]
pub fn metadata(config: &Config, clock_source: &str, seed: u64) -> BTreeMap<String, String> {
    let mut metadata: BTreeMap<String, String> = [
        ("build", concat!("hmd ", env!("CARGO_PKG_VERSION")).to_owned()),
        ("clock_source", clock_source.to_owned()),
        ("config_hash", config.hash()),
        ("model_hash", hash_of_models(config)),
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
