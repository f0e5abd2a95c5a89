//! One chunk of an MCAP file, read only when its checksum is right.

use super::fault::{McapFault, McapLoss};
use super::messages::McapMessage;
use super::records;
use crate::ingest::shown;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, records::op};
use std::collections::{HashMap, VecDeque};
use std::io::{self, Read};
use std::sync::Arc;

/// Longest record and longest decompressed chunk that is read, bytes.
pub(super) const RECORD_LIMIT: usize = 64 << 20;
/// Bytes asked for at least in one read.
const BLOCK: usize = 64 << 10;

#[derive(Debug, Clone)]
struct Channel {
    topic: Arc<str>,
    schema: Arc<str>,
}

/// Channel definitions, from chunks or from the summary.
#[derive(Debug, Default)]
pub(super) struct Channels {
    schemas: HashMap<u16, Arc<str>>,
    channels: HashMap<u16, Channel>,
}

impl Channels {
    /// All topics, in no order.
    pub(super) fn topics(&self) -> impl Iterator<Item = String> {
        self.channels.values().map(|channel| channel.topic.to_string())
    }

    /// Takes a schema or channel record; `None` when it is malformed.
    pub(super) fn add(&mut self, opcode: u8, data: &[u8]) -> Option<()> {
        if opcode == op::SCHEMA {
            let (id, name) = records::schema(data)?;
            self.schemas.insert(id, name.into());
        } else {
            let channel = records::channel(data)?;
            // Only protobuf is decoded here; another encoding must not pass under the schema's name.
            let named = self
                .schemas
                .get(&channel.schema_id)
                .filter(|_| channel.encoding == "protobuf");
            let schema = named.cloned().unwrap_or_else(|| "".into());
            self.channels.insert(
                channel.id,
                Channel {
                    topic: channel.topic.into(),
                    schema,
                },
            );
        }
        Some(())
    }
}
/// Decodes one chunk record; its messages are queued only if all of it is intact.
pub(super) fn read_chunk(
    chunk: &[u8],
    at_byte: u64,
    channels: &mut Channels,
    fallback: &Channels,
    queue: &mut VecDeque<Result<McapMessage, McapLoss>>,
) -> Result<(), McapFault> {
    let malformed = || McapFault::Chunk("a record in it is malformed".to_owned());
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
        .with_record_length_limit(RECORD_LIMIT);
    let mut reader = LinearReader::new_with_options(options);
    let mut messages = Vec::new();
    let mut unknown = None;
    while let Some(event) = reader.next_event() {
        match event.map_err(chunk_fault)? {
            LinearReadEvent::ReadRequest(need) => {
                read_some(&mut input, &mut reader, need).map_err(|error| McapFault::Io(error.kind()))?;
            }
            LinearReadEvent::Record {
                opcode: opcode @ (op::SCHEMA | op::CHANNEL),
                data,
            } => {
                channels.add(opcode, data).ok_or_else(malformed)?;
            }
            LinearReadEvent::Record {
                opcode: op::MESSAGE,
                data,
            } => {
                let (id, log_time_ns, data) = records::message(data).ok_or_else(malformed)?;
                let Some(channel) = channels.channels.get(&id).or_else(|| fallback.channels.get(&id)) else {
                    unknown = unknown.or(Some(McapFault::UnknownChannel { id }));
                    continue;
                };
                let (topic, schema) = (channel.topic.clone(), channel.schema.clone());
                messages.push(Ok(McapMessage {
                    topic,
                    schema,
                    log_time_ns,
                    at_byte,
                    data: data.to_vec(),
                }));
            }
            LinearReadEvent::Record { .. } => {}
        }
    }
    queue.extend(messages);
    unknown.map_or(Ok(()), Err)
}

fn chunk_fault(error: McapError) -> McapFault {
    match error {
        McapError::BadChunkCrc { saved, calculated } => McapFault::ChunkCrc {
            expected: saved,
            got: calculated,
        },
        McapError::ChunkTooLarge(got) | McapError::RecordTooLarge { len: got, .. } => McapFault::TooLarge { got },
        McapError::UnsupportedCompression(name) => {
            McapFault::Chunk(format!("unknown compression \"{}\"", shown(name.as_bytes())))
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
