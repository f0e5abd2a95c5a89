//! One chunk of an MCAP file, read only when its checksum is right.

use super::fault::McapFault;
use super::limits::RECORD_BYTES_MAX;
use super::records;
use crate::quoted;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, records::op};
use std::io::{self, Read};

/// Bytes asked for at least in one read.
const BLOCK: usize = 64 << 10;

/// The records of a chunk, front to back: a list of their places would take several times the room of small ones.
#[derive(Debug, Default)]
pub(super) struct Content {
    /// Opcode, length and content of each.
    bytes: Vec<u8>,
    /// Where the next one begins.
    at: usize,
}

impl Content {
    /// Opcode and length.
    const HEAD: usize = 5;

    /// Opcode and content of the next record.
    pub(super) fn next(&mut self) -> Option<(u8, &[u8])> {
        let (head, rest) = self.bytes.get(self.at..)?.split_at_checked(Self::HEAD)?;
        let length = u32::from_le_bytes(head[1..].try_into().ok()?) as usize;
        self.at += Self::HEAD + length;
        Some((head[0], rest.get(..length)?))
    }

    fn push(&mut self, opcode: u8, data: &[u8]) {
        self.bytes.push(opcode);
        // No record is longer than RECORD_BYTES_MAX.
        self.bytes.extend_from_slice(&(data.len() as u32).to_le_bytes());
        self.bytes.extend_from_slice(data);
    }
}

/// Decodes a chunk record; its content comes out only if all of it is intact.
pub(super) fn verify(chunk: &[u8]) -> Result<Content, McapFault> {
    if records::chunk_crc(chunk).ok_or_else(malformed)? == 0 {
        return Err(McapFault::NoCrc);
    }
    let mut head = [0; 9];
    head[0] = op::CHUNK;
    head[1..].copy_from_slice(&(chunk.len() as u64).to_le_bytes());
    let mut input = head.chain(chunk);
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(RECORD_BYTES_MAX);
    let mut reader = LinearReader::new_with_options(options);
    let mut content = Content::default();
    while let Some(event) = reader.next_event() {
        match event.map_err(chunk_fault)? {
            LinearReadEvent::ReadRequest(need) => {
                read_some(&mut input, &mut reader, need).map_err(|error| McapFault::Io(error.kind()))?;
            }
            LinearReadEvent::Record { opcode, data } => {
                content.push(opcode, data);
            }
        }
    }
    Ok(content)
}

/// Fault of a record inside a chunk that does not parse, although the checksum is right.
pub(super) fn malformed() -> McapFault {
    McapFault::Chunk("a record in it is malformed".to_owned())
}

fn chunk_fault(error: McapError) -> McapFault {
    match error {
        McapError::BadChunkCrc { saved, calculated } => McapFault::ChunkCrc {
            expected: saved,
            got: calculated,
        },
        McapError::ChunkTooLarge(got) | McapError::RecordTooLarge { len: got, .. } => McapFault::TooLarge { got },
        McapError::UnsupportedCompression(name) => {
            McapFault::Chunk(format!("unknown compression \"{}\"", quoted(name.as_bytes())))
        }
        McapError::DecompressionError(text) => McapFault::Chunk(text),
        McapError::Io(error) => McapFault::Chunk(error.to_string()),
        other => McapFault::Chunk(other.to_string()),
    }
}

/// Feeds `reader` from `input`; at least one block is asked for, so that small records do not cost a call each.
pub(super) fn read_some(input: &mut impl Read, reader: &mut LinearReader, need: usize) -> io::Result<()> {
    loop {
        match input.read(reader.insert(need.max(BLOCK))) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
            Ok(read) => {
                reader.notify_read(read);
                return Ok(());
            }
        }
    }
}
