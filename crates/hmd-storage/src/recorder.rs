//! Writes the records of a run, live or replayed, to one MCAP file or to a folder of segments.
//!
//! A file that cannot be written ends the run. A folder survives a failing disk ([`SegmentStore`]): losses are counted and
//! reported.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::time::Instant;

use prost_types::FileDescriptorSet;

use crate::calibration_file::hash_of_models;
use crate::mcap_writer::{McapWriteError, McapWriter, SyncedFile};
use crate::output_file::OutputFile;
use crate::segment_store::{RealDisk, SegmentStore, SegmentStoreEnd, SegmentStoreError};
use hmd_core::assess::AssessedWindow;
use hmd_core::config::{Config, Limits};
use hmd_core::frame::{BusNames, RawFrame};
use hmd_core::levels_text::levels_text;
use hmd_core::outbox::{Notice, WindowJob};
use hmd_core::record::{Assessed, Dropped, Ended, Log, LogLevel, Record, Status, StorageState, StoreStatus, UnitMark};

/// Why records cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The file cannot be created.
    #[error("{path}: {source}")]
    Create {
        /// The file.
        path: String,
        /// Error of the operating system.
        source: io::Error,
    },
    /// There is no such folder for us.
    #[error(transparent)]
    SegmentStore(#[from] SegmentStoreError),
    /// The file cannot be written.
    #[error("{path}: {source}")]
    Write {
        /// The file.
        path: String,
        /// What went wrong.
        source: McapWriteError,
    },
}

/// One record as it is written, for those who watch a run.
#[derive(Clone, Debug)]
pub struct PublishedRecord {
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

/// Receives every record but raw frames, after it was handed to the output. It must not block: the writing threads call it.
pub trait RecordObserver: Send {
    /// Takes one record.
    fn publish(&self, record: PublishedRecord);
}

/// Records in progress. Call [`Recorder::finish`].
pub struct Recorder {
    output: Output,
    observer: Option<Box<dyn RecordObserver>>,
}

enum Output {
    /// Nothing is written; only the observer gets the records.
    Nowhere,
    File {
        path: String,
        // Much larger than the other variant's own size.
        writer: Box<McapWriter<SyncedFile>>,
        output: OutputFile,
        unsynced: bool,
        /// The first error, which all later writes give again: the writer itself would only say that there was one.
        failed: Option<(io::ErrorKind, String)>,
    },
    Folder(Box<SegmentStore>),
}

impl Recorder {
    /// Begins a file with this metadata. A file that is there already is replaced at the end.
    ///
    /// # Errors
    /// When the file cannot be created or written.
    pub fn create(path: &Path, metadata: &BTreeMap<String, String>) -> Result<Self, RecordError> {
        let name = path.display().to_string();
        let begin = || {
            let output = OutputFile::create_recording(path)?;
            Ok((output.handle()?, output))
        };
        let (file, output) = begin().map_err(|source| RecordError::Create {
            path: name.clone(),
            source,
        })?;
        let writer = McapWriter::new(SyncedFile::new(file), metadata).map_err(|source| RecordError::Write {
            path: name.clone(),
            source,
        })?;
        Ok(Self::with_output(Output::File {
            path: name,
            writer: Box::new(writer),
            output,
            unsynced: false,
            failed: None,
        }))
    }

    /// Writes nothing; for an observer alone.
    #[must_use]
    pub fn nowhere() -> Self {
        Self::with_output(Output::Nowhere)
    }

    /// The same with an observer of all records.
    #[must_use]
    pub fn with_observer(self, observer: Box<dyn RecordObserver>) -> Self {
        Self {
            observer: Some(observer),
            ..self
        }
    }

    fn with_output(output: Output) -> Self {
        Self { output, observer: None }
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
        let store = SegmentStore::open(folder, metadata, limits, Box::new(RealDisk), Instant::now())?;
        Ok(Self::of_store(store))
    }

    /// Goes on in a folder of segments that was opened.
    #[must_use]
    pub fn of_store(store: SegmentStore) -> Self {
        Self::with_output(Output::Folder(Box::new(store)))
    }

    /// The same for a process that wrote to the folder before ([`SegmentStore::reopen`]): it fails never, and counts what it cannot store.
    #[must_use]
    pub fn reopen_folder(folder: &Path, metadata: &BTreeMap<String, String>, limits: Limits) -> Self {
        let store = SegmentStore::reopen(folder, metadata, limits, Box::new(RealDisk), Instant::now());
        Self::of_store(store)
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
    pub fn write_frame(&mut self, frame: &RawFrame, names: &BusNames) -> Result<(), RecordError> {
        match &mut self.output {
            Output::Folder(store) => {
                store.write_frame(frame, names);
                Ok(())
            }
            Output::File { .. } => self.file(|writer| writer.write_frame(frame, names)),
            Output::Nowhere => Ok(()),
        }
    }

    /// The next frame does not follow the last one: it begins a capture, made for this reason. A file has no captures.
    pub fn begin_capture(&mut self, why: &str) {
        if let Output::Folder(store) = &mut self.output {
            store.begin_capture(why);
        }
    }

    /// Ends the capture in progress, so that its segment can be read.
    pub fn end_capture(&mut self) {
        if let Output::Folder(store) = &mut self.output {
            store.end_capture();
        }
    }

    /// Writes the records of an assessed window, and syncs all frames and records so far. Returns whether the records are on the disk.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_assessed(&mut self, assessed: &AssessedWindow) -> Result<bool, RecordError> {
        let at = assessed.health.t_start_ns;
        let stored = match &mut self.output {
            Output::Folder(store) => {
                store.write(at, &assessed.window);
                store.write(at, &assessed.health);
                store.write(at, &assessed.rul);
                store.write(at, &assessed.sensors);
                if let Some(shortened) = &assessed.shortened {
                    store.write_to_both(at, shortened);
                }
                store.write_to_raw(at, &mark_of(assessed));
                store.sync_window()
            }
            Output::File { .. } => {
                self.file(|writer| {
                    writer.write(at, &assessed.window)?;
                    writer.write(at, &assessed.health)?;
                    writer.write(at, &assessed.rul)?;
                    writer.write(at, &assessed.sensors)?;
                    // That a window was assessed is told by its health.
                    if assessed.unit != UnitMark::Untold || !assessed.events_ns.is_empty() {
                        writer.write(at, &mark_of(assessed))?;
                    }
                    match &assessed.shortened {
                        Some(shortened) => writer.write(at, shortened),
                        None => Ok(()),
                    }
                })?;
                self.sync_file()?;
                true
            }
            Output::Nowhere => true,
        };
        self.publish(at, &assessed.window);
        self.publish(at, &assessed.health);
        self.publish(at, &assessed.rul);
        self.publish(at, &assessed.sensors);
        if let Some(shortened) = &assessed.shortened {
            self.publish(at, shortened);
        }
        Ok(stored)
    }

    /// Records that a window was dropped.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_dropped(&mut self, job: &WindowJob) -> Result<(), RecordError> {
        let at = job.window.t_start_ns;
        let record = Dropped {
            actuator: job.actuator.name.clone(),
            window: job.window.number,
            t_start_ns: at,
        };
        match &mut self.output {
            Output::Folder(store) => {
                store.write_to_both(at, &record);
                self.publish(at, &record);
                Ok(())
            }
            Output::File { .. } | Output::Nowhere => self.write(at, &record),
        }
    }

    /// Writes a line for an operator.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_notice(&mut self, notice: &Notice, level: LogLevel) -> Result<(), RecordError> {
        let at = notice.stamp_ns;
        self.write(at, &Log::new(at, level, "hmd", &notice.message))
    }

    /// Notes among the frames that the run ends by itself now, and its unit histories are counted up to here. A file needs no such note.
    pub fn note_end(&mut self, stamp_ns: u64) {
        if let Output::Folder(store) = &mut self.output {
            store.write_to_raw(stamp_ns, &Ended { t_ns: stamp_ns });
        }
    }

    /// Writes the counters as they stand at `stamp_ns`.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_status(&mut self, stamp_ns: u64, status: &Status) -> Result<(), RecordError> {
        self.write(stamp_ns, status)
    }

    /// To be called every second: syncs what was taken. Returns the notices about the storage for an operator.
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

    /// Notices about the storage for an operator, since the last call.
    pub fn take_messages(&mut self) -> Vec<(LogLevel, String)> {
        match &mut self.output {
            Output::Folder(store) => store.take_messages(),
            Output::File { .. } | Output::Nowhere => Vec::new(),
        }
    }

    /// The folder of segments; `None` for a file.
    #[must_use]
    pub fn folder(&self) -> Option<&Path> {
        match &self.output {
            Output::Folder(store) => Some(store.folder()),
            Output::File { .. } | Output::Nowhere => None,
        }
    }

    /// State of a folder; `None` for a file.
    #[must_use]
    pub fn storage_status(&self) -> Option<StoreStatus> {
        match &self.output {
            Output::Folder(store) => Some(store.status()),
            Output::File { .. } | Output::Nowhere => None,
        }
    }

    /// Whether the output takes records: that of a file at its beginning was written, or the run would have ended.
    #[must_use]
    pub fn is_written(&self) -> bool {
        self.storage_status()
            .is_none_or(|status| status.state != StorageState::Failing)
    }

    /// Ends the file or the segments; returns the final state of a folder.
    ///
    /// # Errors
    /// When the file cannot be written; one at its place can then be read up to its last whole chunk, and one that was to replace another
    /// leaves the old file.
    pub fn finish(self) -> Result<Option<SegmentStoreEnd>, RecordError> {
        match self.output {
            Output::Folder(store) => Ok(Some(store.finish())),
            Output::Nowhere => Ok(None),
            Output::File {
                path,
                failed: Some(first),
                ..
            } => Err(write_error(path, &first)),
            Output::File {
                path, writer, output, ..
            } => match writer.finish().and_then(|_| Ok(output.put_in_place()?)) {
                Ok(()) => Ok(None),
                Err(source) => Err(RecordError::Write { path, source }),
            },
        }
    }

    /// Takes a file back, for a run that had nothing to record: what was at its place stays. A folder keeps its segments.
    ///
    /// # Errors
    /// When the file cannot be removed.
    pub fn discard(self) -> Result<(), RecordError> {
        match self.output {
            Output::Folder(store) => {
                store.finish();
                Ok(())
            }
            Output::Nowhere => Ok(()),
            Output::File { path, output, .. } => {
                output.discard().map_err(|source| RecordError::Create { path, source })
            }
        }
    }

    fn write<R: Record>(&mut self, at_ns: u64, record: &R) -> Result<(), RecordError> {
        match &mut self.output {
            Output::Folder(store) => store.write(at_ns, record),
            Output::File { .. } => self.file(|writer| writer.write(at_ns, record))?,
            Output::Nowhere => {}
        }
        self.publish(at_ns, record);
        Ok(())
    }

    fn publish<R: Record>(&self, at_ns: u64, record: &R) {
        if let Some(observer) = &self.observer {
            observer.publish(PublishedRecord {
                at_ns,
                topic: record.topic(),
                schema: R::SCHEMA_NAME,
                descriptor: R::descriptor,
                data: record.encode_to_vec(),
            });
        }
    }

    fn file(
        &mut self,
        put: impl FnOnce(&mut McapWriter<SyncedFile>) -> Result<(), McapWriteError>,
    ) -> Result<(), RecordError> {
        let Output::File {
            path,
            writer,
            unsynced,
            failed,
            ..
        } = &mut self.output
        else {
            unreachable!("only called for a file")
        };
        if let Some(first) = failed {
            return Err(write_error(path.clone(), first));
        }
        *unsynced = true;
        put(writer).map_err(|source| {
            *failed = source.io().map(|cause| (cause.kind(), cause.to_string()));
            RecordError::Write {
                path: path.clone(),
                source,
            }
        })
    }

    fn sync_file(&mut self) -> Result<(), RecordError> {
        if matches!(&self.output, Output::File { unsynced: true, .. }) {
            self.file(McapWriter::flush_window)?;
            if let Output::File { unsynced, .. } = &mut self.output {
                *unsynced = false;
            }
        }
        Ok(())
    }
}

/// What a replay of its frames needs to know of a window that was assessed.
fn mark_of(assessed: &AssessedWindow) -> Assessed {
    Assessed {
        actuator: assessed.health.actuator.clone(),
        window: assessed.health.window,
        t_start_ns: assessed.health.t_start_ns,
        unit: assessed.unit.to_text().to_owned(),
        events_ns: assessed.events_ns.clone(),
    }
}

/// The error of a file whose writing failed before.
fn write_error(path: String, (kind, text): &(io::ErrorKind, String)) -> RecordError {
    RecordError::Write {
        path,
        source: McapWriteError::Io(io::Error::new(*kind, text.clone())),
    }
}

/// Whether an output is meant as a folder: it is one, or its name ends with a slash.
#[must_use]
pub fn is_folder(path: &Path) -> bool {
    path.is_dir() || path.as_os_str().as_encoded_bytes().ends_with(b"/")
}

/// Entry of the metadata of a recording that marks each window which was assessed: frames of a folder by [`Assessed`], a file by its
/// health records.
pub const ASSESSED_KEY: &str = "assessed";

/// Its value.
pub const ASSESSED_MARKED: &str = "marked";

/// Metadata of a record file.
#[must_use]
pub fn metadata(config: &Config, clock_source: &str, seed: u64) -> BTreeMap<String, String> {
    let mut metadata: BTreeMap<String, String> = [
        ("build", concat!("hmd ", env!("CARGO_PKG_VERSION")).to_owned()),
        ("clock_source", clock_source.to_owned()),
        ("config_hash", config.hash()),
        ("critical_h", config.rul().critical_h.to_string()),
        ("levels", levels_text(config.health().levels())),
        ("model_hash", hash_of_models(config)),
        ("seed", seed.to_string()),
        (ASSESSED_KEY, ASSESSED_MARKED.to_owned()),
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

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

    use super::*;

    #[test]
    fn the_first_error_of_a_file_is_that_of_every_later_write_too() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("one.mcap");
        let mut recorder = Recorder::create(&path, &BTreeMap::new()).unwrap();
        recorder.write_status(1, &Status::default()).unwrap();
        std::fs::remove_file(&path).unwrap();
        let first = recorder.tick(Instant::now()).unwrap_err().to_string();
        assert!(
            first.ends_with("somebody has removed it while it was written"),
            "{first}"
        );
        for _ in 0..2 {
            let failed = recorder.write_status(1, &Status::default());
            assert_eq!(failed.unwrap_err().to_string(), first);
            let failed = recorder.tick(Instant::now());
            assert_eq!(failed.unwrap_err().to_string(), first);
        }
        assert_eq!(recorder.finish().map(|_| ()).unwrap_err().to_string(), first);
    }
}
