//! What can be wrong in an MCAP file.

use super::limits::{
    DEFINITION_BYTES_MAX, DEFINITIONS_MAX, EXPANSION_MAX, METADATA_BYTES_MAX, METADATA_MAX, RECORD_BYTES_MAX,
};
use hmd_core::counted::counted;
use std::io;
use std::sync::Arc;
use thiserror::Error;

/// A part of an MCAP file that could not be read.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{file}: at byte {at_byte}: {fault}")]
pub struct McapLoss {
    /// The file.
    pub file: Arc<str>,
    /// Place of the record that is concerned.
    pub at_byte: u64,
    /// What is wrong.
    pub fault: McapFault,
}

impl McapLoss {
    /// How many raw frames are known to be lost; 0 when that is unknown.
    pub fn frames(&self) -> u64 {
        match self.fault {
            McapFault::MissingFrames { count, .. } => count,
            _ => 0,
        }
    }
}

/// What is wrong in an MCAP file.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum McapFault {
    /// The file has no bytes.
    #[error("expected an MCAP file, found an empty file")]
    Empty,
    /// The file does not begin as an MCAP file does: another kind of file, or its start is damaged.
    #[error("expected the start of an MCAP file, found \"{0}\"")]
    Start(String),
    /// The file ends too early: it was cut, or its writer was killed.
    #[error("expected a record, found the end of the file: it was cut or never finished")]
    Truncated,
    /// A checksum of a chunk does not match; its messages are not used.
    #[error("expected a chunk with checksum {expected:08x}, found {got:08x}")]
    ChunkCrc {
        /// Checksum in the file.
        expected: u32,
        /// Checksum of what was read.
        got: u32,
    },
    /// A chunk or a message has no checksum and is not used.
    #[error("expected messages in chunks with a checksum, found some without")]
    NoCrc,
    /// A chunk cannot be decoded.
    #[error("expected an intact chunk, found a damaged one that cannot be read ({0}); its frames are lost")]
    Chunk(String),
    /// The chunks so far expand to more than a file of this size may.
    #[error("expected chunks that expand to at most {max} times the file's size, found more; the rest is not read", max = EXPANSION_MAX)]
    Expansion,
    /// Messages that a checksum vouches for, but that were read before: a chunk of the file is there twice.
    #[error("expected new messages, found {} before; not used", counted(*count, "message that was read", "messages that were read"))]
    RepeatedMessages {
        /// How many.
        count: u64,
    },
    /// Raw frames that were read before, by their count.
    #[error("expected raw frame number {expected}, found {} before; not used", counted(*count, "frame that was read", "frames that were read"))]
    RepeatedFrames {
        /// Place of the first one that is new.
        expected: u64,
        /// How many.
        count: u64,
    },
    /// A record claims an impossible length.
    #[error("expected a record of at most {max} bytes, found one of {got}", max = RECORD_BYTES_MAX)]
    TooLarge {
        /// Length claimed.
        got: u64,
    },
    /// The chain of records is broken.
    #[error("expected a record, found something else: {0}")]
    Broken(String),
    /// The checksum over all data does not match, although every chunk's does.
    #[error("expected data with checksum {expected:08x}, found {got:08x}; every chunk read is intact")]
    DataCrc {
        /// Checksum in the file.
        expected: u32,
        /// Checksum of what was read.
        got: u32,
    },
    /// Messages of a channel whose definition was lost.
    #[error("expected a defined channel, found a message of unknown channel {id}")]
    UnknownChannel {
        /// Number of the channel.
        id: u16,
    },
    /// A definition beyond what is held; its channel is unknown from here on.
    #[error(
        "expected at most {} definitions of schemas and channels with {} bytes in all, found more",
        DEFINITIONS_MAX,
        DEFINITION_BYTES_MAX
    )]
    Definitions,
    /// Raw frames are missing by their count.
    #[error("expected raw frame number {first_index}, found a gap: {} missing", counted(*count, "frame is", "frames are"))]
    MissingFrames {
        /// Place of the first one in the stream.
        first_index: u64,
        /// How many.
        count: u64,
    },
    /// A message does not follow its schema.
    #[error("expected a raw batch, found another message: {0}")]
    Batch(String),
    /// A topic of ours with a schema that is not.
    #[error("expected schema {expected} on {topic}, found \"{found}\"")]
    Schema {
        /// The topic.
        topic: String,
        /// Name of the schema wanted.
        expected: &'static str,
        /// Name of the schema found.
        found: String,
    },
    /// The interface in a topic cannot be taken.
    #[error("expected an interface in topic {topic}: {cause}")]
    Bus {
        /// The topic.
        topic: String,
        /// Why it is refused.
        cause: hmd_core::frame::BusError,
    },
    /// A metadata record that no checksum vouches for, or that cannot be read.
    #[error("expected metadata with a checksum, found \"{name}\" without a right one")]
    Metadata {
        /// Its name; empty when not even that can be read.
        name: String,
    },
    /// A metadata record beyond what is held.
    #[error(
        "expected at most {} metadata records with {} bytes in all, found more: one of {got} bytes is left out",
        METADATA_MAX,
        METADATA_BYTES_MAX
    )]
    MetadataLimit {
        /// Its length.
        got: usize,
    },
    /// The file cannot be read further.
    #[error("expected to read on, found an input error: {0}")]
    Io(io::ErrorKind),
}
