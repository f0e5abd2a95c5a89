//! The MCAP file that `hmd` writes.
//!
//! Every channel is Protobuf with its descriptor as schema. Raw frames are kept back in rounds (see
//! [`record::RawBatch`](hmd_core::record::RawBatch)) and reach the file when a round is full or long enough, or with the
//! next record of another kind, so that a window never precedes its frames. The same input gives the same bytes:
//! nothing here reads a clock, and zstd runs on the calling thread (its default is one more thread per core).
//! Each schema and channel is defined in the chunk of its first message, and in metadata records before it and some
//! kilobytes on ([`mod@crate::schema_copy`]).
//!
//! A chunk is written in one piece when it is complete, so that a file that was cut holds whole chunks and one torn one.

use crate::schema_copy::{CHANNEL_NAME, ChannelCopy, LIBRARY_START, SCHEMA_NAME, SchemaCopy};
use hmd_core::frame::{BusError, BusNames, RawFrame};
use hmd_core::metadata_checksum::seal;
use hmd_core::record::{RawBatch, Record, SCHEMA_VERSION};
use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, WriteOptions, Writer};
use prost::Message;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::os::unix::fs::MetadataExt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use thiserror::Error;

/// Name of the metadata record with hashes, clock source, seed and part numbers.
pub const METADATA_NAME: &str = "hmd";

/// Most raw frames in one round, which bounds the memory and what a crash can lose.
pub const ROUND_FRAMES: usize = 2048;
/// Longest stretch of time in one round, ns.
pub const ROUND_SPAN_NS: u64 = 500_000_000;
/// Distance to the last copy of a definition, bytes: more than a block of any disk, which may go as a whole.
const COPIES_APART_BYTES: u64 = 8192;
/// Uncompressed size at which a chunk is closed, bytes.
const CHUNK_BYTES: u64 = 1 << 20;

/// Why a record was not written. After [`McapWriteError::Mcap`] the file takes no more records.
#[derive(Debug, Error)]
pub enum McapWriteError {
    /// The file could not be written.
    #[error("cannot write the MCAP file: {}", root_cause(.0))]
    Mcap(#[from] McapError),
    /// The last bytes could not be brought to the file.
    #[error("cannot write the MCAP file: {0}")]
    Io(#[from] io::Error),
    /// A frame on an interface that the table does not have.
    #[error("a frame is on interface number {got}, but only {known} are known")]
    UnknownBus {
        /// Index in the frame.
        got: u16,
        /// Names in the table.
        known: usize,
    },
    /// An interface that the file's own table cannot take.
    #[error("cannot record interface \"{interface}\": {cause}")]
    Bus {
        /// Its name.
        interface: String,
        /// Why it is refused.
        cause: BusError,
    },
    /// A name that would make another topic.
    #[error("\"{topic}\" is not a topic: a name in it is empty or has a '/', a blank or a control character")]
    Topic {
        /// The topic as built.
        topic: String,
    },
}

impl McapWriteError {
    /// The error of the system, if it is one: what fails in the middle of a record comes through the library.
    pub(crate) fn io(&self) -> Option<&io::Error> {
        match self {
            Self::Io(cause) | Self::Mcap(McapError::Io(cause)) => Some(cause),
            _ => None,
        }
    }
}

/// How every MCAP file of ours is written.
pub(crate) fn write_options() -> WriteOptions {
    WriteOptions::new()
        .library(format!("{LIBRARY_START}{}", env!("CARGO_PKG_VERSION")))
        .compression(Some(mcap::Compression::Zstd))
        .compression_threads(0)
        .chunk_size(Some(CHUNK_BYTES))
        .disable_seeking(true)
}

pub(crate) fn root_cause(error: &McapError) -> String {
    match error {
        McapError::Io(io) => io.to_string(),
        other => other.to_string(),
    }
}

/// What went into a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct McapCounts {
    /// Raw frames.
    pub frames: u64,
    /// Batches of raw frames.
    pub batches: u64,
    /// Records of all other kinds.
    pub records: u64,
}

/// Writes records into an MCAP file. Call [`McapWriter::finish`]: a writer that is only dropped loses its last round.
pub struct McapWriter<W: Write + Seek> {
    writer: Writer<Counting<W>>,
    bytes: Arc<AtomicU64>,
    /// Numbers of the schemas, by their names.
    schemas: BTreeMap<&'static str, u16>,
    /// By their topics.
    channels: BTreeMap<String, Channel>,
    interfaces: BusNames,
    round: Vec<RawFrame>,
    rounds: u64,
    counts: McapCounts,
    /// In the order of `at_byte`.
    copies: Vec<Copy>,
}

/// A definition that is to be written once more: at most one for each schema and channel.
struct Copy {
    /// Where the last copy ends.
    at_byte: u64,
    name: &'static str,
    content: BTreeMap<String, String>,
}

struct Channel {
    id: u16,
    sequence: u32,
    /// What its first chunk has to define.
    definition: Option<(SchemaCopy, ChannelCopy)>,
}

impl<W: Write + Seek> McapWriter<W> {
    /// Starts a file with `metadata` under the name `hmd`.
    ///
    /// # Errors
    /// When `out` cannot be written.
    pub fn new(out: W, metadata: &BTreeMap<String, String>) -> Result<Self, McapWriteError> {
        Self::with_profile(out, metadata, "")
    }

    /// The same with a profile in the header, which identifies a kind of file.
    ///
    /// # Errors
    /// When `out` cannot be written.
    pub fn with_profile(out: W, metadata: &BTreeMap<String, String>, profile: &str) -> Result<Self, McapWriteError> {
        let options = write_options().profile(profile);
        let bytes = Arc::new(AtomicU64::new(0));
        let mut writer = Self {
            writer: options.create(Counting {
                out,
                bytes: bytes.clone(),
            })?,
            bytes,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            interfaces: BusNames::new(),
            round: Vec::with_capacity(ROUND_FRAMES),
            rounds: 0,
            counts: McapCounts::default(),
            copies: Vec::new(),
        };
        writer.write_metadata(METADATA_NAME, metadata)?;
        Ok(writer)
    }

    /// Adds a further metadata record, for what is known only later; it gets a checksum ([`mod@hmd_core::metadata_checksum`]).
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_metadata(&mut self, name: &str, metadata: &BTreeMap<String, String>) -> Result<(), McapWriteError> {
        let mut metadata = metadata.clone();
        seal(name, &mut metadata);
        Ok(self.writer.write_metadata(&Metadata {
            name: name.to_owned(),
            metadata,
        })?)
    }

    /// Takes one frame as received; `names` is the table of the source that it comes from.
    ///
    /// # Errors
    /// [`McapWriteError::UnknownBus`], or when a full round cannot be written.
    pub fn write_frame(&mut self, frame: &RawFrame, names: &BusNames) -> Result<(), McapWriteError> {
        let known = names.len();
        let interface = names
            .name(frame.bus)
            .ok_or(McapWriteError::UnknownBus { got: frame.bus, known })?;
        // By name, not by index: the next source may come with another table.
        let bus = self.interfaces.intern(interface);
        let bus = bus.map_err(|cause| McapWriteError::Bus {
            interface: interface.to_owned(),
            cause,
        })?;
        let span = self
            .round
            .first()
            .map_or(0, |first| first.stamp_ns.abs_diff(frame.stamp_ns));
        if self.round.len() >= ROUND_FRAMES || span >= ROUND_SPAN_NS {
            self.end_round()?;
        }
        self.round.push(frame.with_bus(bus));
        self.counts.frames += 1;
        Ok(())
    }

    /// Writes one record after all frames taken so far; `log_time_ns` is its UTC time.
    ///
    /// # Errors
    /// [`McapWriteError::Topic`] for a bad actuator name, or when the file cannot be written.
    pub fn write<R: Record>(&mut self, log_time_ns: u64, record: &R) -> Result<(), McapWriteError> {
        self.end_round()?;
        self.write_message(log_time_ns, record)?;
        self.counts.records += 1;
        Ok(())
    }

    /// Brings everything taken so far to the output, in whole chunks, and flushes the output.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn flush_window(&mut self) -> Result<(), McapWriteError> {
        self.end_round()?;
        self.writer.flush()?;
        let far_enough = self.bytes().saturating_sub(COPIES_APART_BYTES);
        let due = self.copies.partition_point(|copy| copy.at_byte <= far_enough);
        if due > 0 {
            for copy in self.copies.drain(..due).collect::<Vec<_>>() {
                self.write_metadata(copy.name, &copy.content)?;
            }
            self.writer.flush()?;
        }
        Ok(())
    }

    /// Ends the file with its summary and returns the flushed output, for the caller to sync, and what went in.
    ///
    /// # Errors
    /// When the file cannot be written; it can then be read up to its last whole chunk.
    pub fn finish(mut self) -> Result<(W, McapCounts), McapWriteError> {
        self.end_round()?;
        self.writer.finish()?;
        let mut out = self.writer.into_inner().out;
        out.flush()?;
        Ok((out, self.counts))
    }

    /// What was taken so far.
    pub fn counts(&self) -> McapCounts {
        self.counts
    }

    /// Bytes in the file so far. The index in memory grows with the file until `finish`, so rotate by this number.
    pub fn bytes(&self) -> u64 {
        self.bytes.load(Ordering::Relaxed)
    }

    /// Writes one batch per bus, in the order of the table.
    fn end_round(&mut self) -> Result<(), McapWriteError> {
        if self.round.is_empty() {
            return Ok(());
        }
        let round = std::mem::take(&mut self.round);
        let first_index = self.counts.frames - round.len() as u64;
        let mut batches = Vec::new();
        for bus in 0..self.interfaces.len() as u16 {
            let placed: Vec<_> = (first_index..)
                .zip(&round)
                .filter(|(_, frame)| frame.bus == bus)
                .collect();
            let (Some((_, first)), Some(interface)) = (placed.first(), self.interfaces.name(bus)) else {
                continue;
            };
            batches.push((first.stamp_ns, RawBatch::pack(interface, self.rounds, &placed)));
        }
        // All definitions first: they end a chunk, and a round shall not lie in several.
        for (_, batch) in &batches {
            self.define(batch)?;
        }
        for (stamp_ns, batch) in batches {
            self.write_message(stamp_ns, &batch)?;
            self.counts.batches += 1;
        }
        self.rounds += 1;
        self.round = round;
        self.round.clear();
        Ok(())
    }

    /// Writes the first copy of the definition of a record's channel, and of its schema, if they are new. It ends the chunk
    /// in progress, so that it comes before the chunk with the second copy.
    fn define<R: Record>(&mut self, record: &R) -> Result<(), McapWriteError> {
        let topic = record.topic();
        if self.channels.contains_key(&topic) {
            return Ok(());
        }
        check_topic(&topic)?;
        let known = self.schemas.get(R::SCHEMA_NAME).copied();
        // Numbers from 1 on: a schema 0 means none.
        let next = |known: usize| u16::try_from(known + 1).ok();
        let schema = SchemaCopy {
            id: known.or(next(self.schemas.len())).ok_or(McapError::TooManySchemas)?,
            name: R::SCHEMA_NAME.to_owned(),
            encoding: "protobuf".to_owned(),
            data: R::descriptor().encode_to_vec(),
        };
        let channel = ChannelCopy {
            id: next(self.channels.len()).ok_or(McapError::TooManyChannels)?,
            schema_id: schema.id,
            topic: topic.clone(),
            encoding: "protobuf".to_owned(),
            metadata: BTreeMap::from([("schema_version".to_owned(), SCHEMA_VERSION.to_owned())]),
        };
        if known.is_none() {
            self.copy(SCHEMA_NAME, schema.emit())?;
            self.schemas.insert(R::SCHEMA_NAME, schema.id);
        }
        self.copy(CHANNEL_NAME, channel.emit())?;
        let channel = Channel {
            id: channel.id,
            sequence: 0,
            definition: Some((schema, channel)),
        };
        self.channels.insert(topic, channel);
        Ok(())
    }

    /// Writes the copy of a definition now, and notes it to be written again.
    fn copy(&mut self, name: &'static str, content: BTreeMap<String, String>) -> Result<(), McapWriteError> {
        self.write_metadata(name, &content)?;
        let at_byte = self.bytes();
        self.copies.push(Copy { at_byte, name, content });
        Ok(())
    }

    fn write_message<R: Record>(&mut self, log_time_ns: u64, record: &R) -> Result<(), McapWriteError> {
        self.define(record)?;
        let Some(channel) = self.channels.get_mut(&record.topic()) else {
            unreachable!("defined above")
        };
        if let Some((schema, channel)) = channel.definition.take() {
            // One that the file has already is not written again.
            self.writer
                .add_schema_with_id(schema.id, &schema.name, &schema.encoding, &schema.data)?;
            let ChannelCopy {
                topic,
                encoding,
                metadata,
                ..
            } = &channel;
            self.writer
                .add_channel_with_id(channel.id, schema.id, topic, encoding, metadata)?;
        }
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: channel.sequence,
            log_time: log_time_ns,
            publish_time: log_time_ns,
        };
        channel.sequence = channel.sequence.wrapping_add(1);
        Ok(self.writer.write_to_known_channel(&header, &record.encode_to_vec())?)
    }
}

/// Counts the bytes written, because the MCAP writer does not report them.
struct Counting<W> {
    out: W,
    bytes: Arc<AtomicU64>,
}

impl<W: Write> Write for Counting<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.out.write(bytes)?;
        self.bytes.fetch_add(written as u64, Ordering::Relaxed);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

impl<W: Seek> Seek for Counting<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.out.seek(to)
    }
}

/// A file whose `flush` brings the data to the disk, so that a power cut costs at most the window in progress.
///
/// If the file was removed, its data are lost and `flush` fails.
#[derive(Debug)]
pub struct SyncedFile {
    file: BufWriter<File>,
    /// The file system counts the names of its files.
    counts_names: bool,
}

impl SyncedFile {
    /// Wraps a file that is open for writing.
    pub fn new(file: File) -> Self {
        Self {
            counts_names: names_of(&file).is_ok_and(|names| names > 0),
            file: BufWriter::new(file),
        }
    }
}

fn names_of(file: &File) -> io::Result<u64> {
    Ok(file.metadata()?.nlink())
}

impl Write for SyncedFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()?;
        let file = self.file.get_ref();
        file.sync_data()?;
        if self.counts_names && names_of(file)? == 0 {
            return Err(io::Error::new(
                io::ErrorKind::NotFound,
                "somebody has removed it while it was written",
            ));
        }
        Ok(())
    }
}

impl Seek for SyncedFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

/// Topics are `/bus/<interface>/raw`, `/<actuator>/<kind>` or `/log`; a name with a slash or a blank would read as another.
fn check_topic(topic: &str) -> Result<(), McapWriteError> {
    let interface = topic.strip_prefix("/bus/").and_then(|rest| rest.strip_suffix("/raw"));
    let rest = interface.or(topic.strip_prefix('/')).unwrap_or_default();
    let good = |name: &str| !name.is_empty() && !name.contains(|c: char| c.is_whitespace() || c.is_control());
    if rest.split('/').all(good) && rest.split('/').count() <= 2 {
        Ok(())
    } else {
        Err(McapWriteError::Topic {
            topic: topic.to_owned(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hmd_core::frame::FrameFlags;
    use hmd_core::record::Health;
    use io::Cursor;

    fn writer() -> McapWriter<Cursor<Vec<u8>>> {
        McapWriter::new(Cursor::new(Vec::new()), &BTreeMap::new()).unwrap()
    }

    fn frame(stamp_ns: u64, bus: u16) -> RawFrame {
        RawFrame::new(stamp_ns, bus, 1, FrameFlags::NONE, &[]).unwrap()
    }

    #[test]
    fn a_round_is_bounded_by_count_and_by_time() {
        let mut names = BusNames::new();
        names.intern("vcan0").unwrap();
        let mut writer = writer();
        for _ in 0..=ROUND_FRAMES {
            writer.write_frame(&frame(5, 0), &names).unwrap();
        }
        assert_eq!(writer.counts().batches, 1);
        writer.write_frame(&frame(5 + ROUND_SPAN_NS, 0), &names).unwrap();
        assert_eq!(writer.counts().batches, 2);
        writer.write_frame(&frame(0, 0), &names).unwrap();
        assert_eq!(
            writer.counts().batches,
            3,
            "a clock that steps back far ends a round too"
        );
        let (_, counts) = writer.finish().unwrap();
        assert_eq!(
            counts,
            McapCounts {
                frames: ROUND_FRAMES as u64 + 3,
                batches: 4,
                records: 0
            }
        );
    }

    #[test]
    fn a_frame_of_an_unknown_interface_is_refused() {
        let error = writer().write_frame(&frame(0, 2), &BusNames::new()).unwrap_err();
        assert_eq!(
            error.to_string(),
            "a frame is on interface number 2, but only 0 are known"
        );
    }

    #[test]
    fn an_interface_keeps_its_name_when_the_table_changes() {
        let (mut first, mut second) = (BusNames::new(), BusNames::new());
        first.intern("vcan0").unwrap();
        second.intern("vcan1").unwrap();
        let mut writer = writer();
        writer.write_frame(&frame(0, 0), &first).unwrap();
        writer.write_frame(&frame(1, 0), &second).unwrap();
        let (out, _) = writer.finish().unwrap();
        let frames = crate::mcap::McapFrames::new(out, "a.mcap", BusNames::new()).unwrap();
        assert_eq!(
            frames.collect::<Result<Vec<_>, _>>(),
            Ok(vec![frame(0, 0), frame(1, 1)])
        );
    }

    #[test]
    fn a_synced_file_holds_every_flushed_window() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let mut writer = McapWriter::new(SyncedFile::new(File::create(&path).unwrap()), &BTreeMap::new()).unwrap();
        writer.write(0, &hmd_core::record::Status::default()).unwrap();
        writer.flush_window().unwrap();
        assert_eq!(std::fs::metadata(&path).unwrap().len(), writer.bytes());
        let (_, counts) = writer.finish().unwrap();
        assert_eq!(counts.records, 1);
    }

    #[test]
    fn a_name_cannot_leave_its_topic() {
        for actuator in ["", "a/b", "a b", "bus/x"] {
            let health = Health {
                actuator: actuator.to_owned(),
                ..Health::default()
            };
            assert!(
                matches!(writer().write(0, &health), Err(McapWriteError::Topic { .. })),
                "{actuator:?}"
            );
        }
    }

    #[test]
    fn a_full_disk_is_an_error_of_the_call_and_of_finish() {
        struct Full(usize);
        impl Write for Full {
            fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
                self.0 = self.0.checked_sub(bytes.len()).ok_or(io::ErrorKind::StorageFull)?;
                Ok(bytes.len())
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        impl Seek for Full {
            fn seek(&mut self, _: io::SeekFrom) -> io::Result<u64> {
                Ok(0)
            }
        }
        let health = Health {
            actuator: "ema0".to_owned(),
            ..Health::default()
        };
        let mut writer = McapWriter::new(Full(usize::MAX), &BTreeMap::new()).unwrap();
        let before = writer.bytes();
        writer.write(0, &health).unwrap();
        let definitions = writer.bytes();
        assert!(definitions > before, "written before the chunk");
        let mut writer = McapWriter::new(Full(definitions as usize - 1), &BTreeMap::new()).unwrap();
        writer.write(0, &health).unwrap_err();
        let mut writer = McapWriter::new(Full(definitions as usize), &BTreeMap::new()).unwrap();
        writer.write(0, &health).unwrap();
        let error = writer.flush_window().unwrap_err();
        assert_eq!(error.to_string(), "cannot write the MCAP file: no storage space");
        assert!(writer.finish().is_err());
    }
}
