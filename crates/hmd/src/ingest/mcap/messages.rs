//! Messages of an MCAP file, as far as a checksum vouches for them.
//!
//! Chunks are decoded only after their CRC was checked; whatever else stands in the file (bare messages, chunks without
//! a CRC) is not trusted. A damaged chunk costs that chunk, and a broken record costs none behind it ([`super::walk`]).
//!
//! Tried and dropped: the crate's `MessageStream` and `IndexedReader`. A flipped byte gave silently wrong messages or
//! allocations that ended the process.

use super::chunk::malformed;
use super::definitions::{Channel, Definitions};
use super::fault::{McapFault, McapLoss};
use super::records;
use super::summary::read_summary;
use super::walk::{Found, Walk, What};
use mcap::records::op;
use std::collections::{BTreeMap, VecDeque};
use std::io::{self, Read, Seek};
use std::sync::Arc;

/// Most metadata records that are kept.
const METADATA_LIMIT: usize = 64;
/// Longest metadata record that is kept, bytes.
const METADATA_BYTES: usize = 1 << 20;

/// One message of an intact chunk.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct McapMessage {
    /// Topic.
    pub topic: Arc<str>,
    /// Name of the schema; empty when the channel has none.
    pub schema: Arc<str>,
    /// UTC time of the record, ns.
    pub log_time_ns: u64,
    /// Time at which it was published, ns.
    pub publish_time_ns: u64,
    /// Its number in the channel.
    pub sequence: u32,
    /// Place of its chunk in the file.
    pub at_byte: u64,
    /// The encoded message.
    pub data: Vec<u8>,
    pub(crate) channel: Arc<Channel>,
}

/// A metadata record; it has no checksum of its own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct McapMetadata {
    pub(crate) at_byte: u64,
    pub(crate) name: String,
    pub(crate) content: BTreeMap<String, String>,
}

/// Iterates over the messages of an MCAP file in bounded memory.
#[derive(Debug)]
pub struct McapMessages<R> {
    walk: Walk<R>,
    file: Arc<str>,
    definitions: Definitions,
    summary: Definitions,
    metadata: Vec<McapMetadata>,
    queue: VecDeque<Result<McapMessage, McapLoss>>,
    chunks: u64,
    attachments: u64,
    all_verified: bool,
    any_loss: bool,
}

impl<R: Read + Seek> McapMessages<R> {
    /// A reader of `input` from its start; `file` names it in errors.
    ///
    /// # Errors
    /// When the input cannot be read or sought.
    pub fn new(mut input: R, file: &str) -> io::Result<Self> {
        let summary = read_summary(&mut input)?.unwrap_or_default();
        Ok(Self::over(Walk::new(input)?, summary, file))
    }

    /// A reader of a file that is being written: as far as `length`, where a record must end.
    pub(super) fn growing(input: R, file: &str, length: u64) -> Self {
        Self::over(Walk::growing(input, length), Definitions::default(), file)
    }

    /// Goes on as far as `length`, where a record must end unless nothing more will come.
    pub(super) fn grow(&mut self, length: u64, last: bool) {
        self.walk.grow(length, last);
    }

    fn over(walk: Walk<R>, summary: Definitions, file: &str) -> Self {
        Self {
            walk,
            file: file.into(),
            definitions: Definitions::default(),
            summary,
            metadata: Vec::new(),
            queue: VecDeque::new(),
            chunks: 0,
            attachments: 0,
            all_verified: false,
            any_loss: false,
        }
    }

    /// The file's name, as given.
    pub fn file(&self) -> &Arc<str> {
        &self.file
    }

    /// Place in the file up to which records were read.
    pub fn position(&self) -> u64 {
        self.walk.position()
    }

    /// The newest metadata record of this name read so far. It has no checksum of its own.
    pub fn metadata(&self, name: &str) -> Option<&BTreeMap<String, String>> {
        let named = self.metadata.iter().rev().find(|metadata| metadata.name == name);
        named.map(|metadata| &metadata.content)
    }

    /// All metadata records read so far.
    pub(crate) fn all_metadata(&self) -> &[McapMetadata] {
        &self.metadata
    }

    /// Intact chunks so far.
    pub fn chunks(&self) -> u64 {
        self.chunks
    }

    /// Attachments so far; they are not read.
    pub fn attachments(&self) -> u64 {
        self.attachments
    }

    /// Whether the checksum over all data was found right: then metadata are too.
    pub fn all_verified(&self) -> bool {
        self.all_verified
    }

    /// Topics known so far, sorted.
    pub fn topics(&self) -> Vec<String> {
        let mut topics: Vec<String> = self.definitions.topics().chain(self.summary.topics()).collect();
        topics.sort_unstable();
        topics.dedup();
        topics
    }

    fn take(&mut self, found: Found) {
        let at_byte = found.at_byte;
        match found.what {
            What::Chunk(content) => {
                self.chunks += 1;
                let mut unknown = None;
                for (opcode, data) in content.records() {
                    if let Err(fault) = self.take_record(at_byte, opcode, data) {
                        // Said once for each chunk: all of them have the same cause.
                        unknown = unknown.or(Some(fault));
                    }
                }
                if let Some(fault) = unknown {
                    self.lose(at_byte, fault);
                }
            }
            What::Metadata(data) => match records::metadata(&data).filter(|_| data.len() <= METADATA_BYTES) {
                Some((name, content)) if self.metadata.len() < METADATA_LIMIT => {
                    let name = name.to_owned();
                    self.metadata.push(McapMetadata { at_byte, name, content });
                }
                Some(_) => {}
                None => self.lose(at_byte, McapFault::Metadata { name: String::new() }),
            },
            What::AllVerified => self.all_verified = true,
            What::Attachment => self.attachments += 1,
            // After a damaged chunk the sum over all data is wrong as well: nothing new.
            What::Fault(McapFault::DataCrc { .. }) if self.any_loss => {}
            What::Fault(fault) => self.lose(at_byte, fault),
        }
    }

    fn take_record(&mut self, at_byte: u64, opcode: u8, data: &[u8]) -> Result<(), McapFault> {
        match opcode {
            op::SCHEMA | op::CHANNEL => self.definitions.add(opcode, data).ok_or_else(malformed),
            op::MESSAGE => {
                let message = records::message(data).ok_or_else(malformed)?;
                let id = message.channel_id;
                let known = self.definitions.channel(id).or_else(|| self.summary.channel(id));
                let channel = known.cloned().ok_or(McapFault::UnknownChannel { id })?;
                self.queue.push_back(Ok(McapMessage {
                    topic: channel.topic.clone(),
                    schema: channel.protobuf_schema(),
                    log_time_ns: message.log_time_ns,
                    publish_time_ns: message.publish_time_ns,
                    sequence: message.sequence,
                    at_byte,
                    data: message.data.to_vec(),
                    channel,
                }));
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn lose(&mut self, at_byte: u64, fault: McapFault) {
        self.queue.push_back(Err(McapLoss {
            file: self.file.clone(),
            at_byte,
            fault,
        }));
        self.any_loss = true;
    }
}

impl<R: Read + Seek> Iterator for McapMessages<R> {
    type Item = Result<McapMessage, McapLoss>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(item) = self.queue.pop_front() {
                return Some(item);
            }
            let found = self.walk.next()?;
            self.take(found);
        }
    }
}
