//! Messages of an MCAP file, as far as a checksum vouches for them.
//!
//! Chunks are decoded only after their CRC was checked; anything else in the file (bare messages, chunks without
//! a CRC) is not trusted. A damaged chunk costs that chunk, and a broken record costs none behind it ([`super::resync_reader`]).
//!
//! Tried and dropped: the crate's `MessageStream` and `IndexedReader`. A flipped byte gave silently wrong messages or
//! allocations that ended the process.

use super::channels::{Channel, ChannelTable};
use super::chunk::{Content, malformed};
use super::fault::{McapFault, McapLoss};
use super::limits::{METADATA_BYTES_MAX, METADATA_MAX};
use super::records;
use super::resync_reader::{ItemKind, ResyncItem, ResyncReader};
use super::summary::read_summary;
use crate::mcap_writer::METADATA_NAME;
use crate::schema_copy::{CHANNEL_NAME, LIBRARY_START, SCHEMA_NAME};
use hmd_core::metadata_checksum::is_sealed;
use mcap::records::op;
use std::collections::BTreeMap;
use std::io::{self, Read, Seek};
use std::sync::Arc;

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

/// A metadata record. MCAP gives it no checksum; one of ours has it as an entry ([`mod@hmd_core::metadata_checksum`]).
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct McapMetadata {
    pub(crate) at_byte: u64,
    pub(crate) name: String,
    pub(crate) content: BTreeMap<String, String>,
}

/// Iterates over the messages of an MCAP file in bounded memory.
#[derive(Debug)]
pub struct McapMessages<R> {
    reader: ResyncReader<R>,
    file: Arc<str>,
    definitions: ChannelTable,
    summary: ChannelTable,
    metadata: Vec<McapMetadata>,
    metadata_bytes: usize,
    /// Whether the first header is one of ours, so that its copies of definitions are believed; of further ones, as damage makes them, nothing is.
    is_own_file: Option<bool>,
    /// Number of the newest message on each topic. Our writer counts them without a gap, so that one that is not higher was read
    /// before; other writers number as they like.
    newest: BTreeMap<Arc<str>, u32>,
    /// The chunk that is being read: its messages are handed out one by one, not all held at once.
    chunk: Option<Open>,
    /// To be handed out next.
    loss: Option<McapLoss>,
    chunks: u64,
    attachments: u64,
    all_verified: bool,
    first_loss: Option<McapLoss>,
}

/// A chunk that is being read.
#[derive(Debug)]
struct Open {
    at_byte: u64,
    content: Content,
    /// The first fault in it; reported once, because all of them have the same cause.
    fault: Option<McapFault>,
    /// Messages that were read before.
    repeated: u64,
}

impl<R: Read + Seek> McapMessages<R> {
    /// A reader of `input` from its start; `file` names it in errors.
    ///
    /// # Errors
    /// When the input cannot be read or sought.
    pub fn new(mut input: R, file: &str) -> io::Result<Self> {
        let summary = read_summary(&mut input)?.unwrap_or_default();
        Ok(Self::with_reader(ResyncReader::new(input)?, summary, file))
    }

    /// A reader of a recording by its name: of a segment in progress (`.part`) a torn end is no loss, because it is not written yet.
    ///
    /// # Errors
    /// When the input cannot be read or sought.
    pub fn of_recording(input: R, file: &str) -> io::Result<Self> {
        let mut messages = Self::new(input, file)?;
        if file.ends_with(".part") {
            messages.reader = messages.reader.in_progress();
        }
        Ok(messages)
    }

    /// The same, which ends with [`McapFault::Expansion`] before the chunks expand to more than `bytes`, too.
    #[must_use]
    pub(crate) fn expanding_at_most(mut self, bytes: u64) -> Self {
        self.reader.limit_expansion(bytes);
        self
    }

    /// A reader of a file that is being written: as far as `length`, where a record must end.
    pub(super) fn growing(input: R, file: &str, length: u64) -> Self {
        Self::with_reader(ResyncReader::growing(input, length), ChannelTable::default(), file)
    }

    /// Goes on as far as `length`, where a record must end unless nothing more will come.
    pub(super) fn grow(&mut self, length: u64, last: bool) {
        self.reader.grow(length, last);
    }

    fn with_reader(reader: ResyncReader<R>, summary: ChannelTable, file: &str) -> Self {
        Self {
            reader,
            file: file.into(),
            definitions: ChannelTable::default(),
            summary,
            metadata: Vec::new(),
            metadata_bytes: 0,
            is_own_file: None,
            newest: BTreeMap::new(),
            chunk: None,
            loss: None,
            chunks: 0,
            attachments: 0,
            all_verified: false,
            first_loss: None,
        }
    }

    /// The file's name, as given.
    pub fn file(&self) -> &Arc<str> {
        &self.file
    }

    /// Place in the file up to which records were read.
    pub fn position(&self) -> u64 {
        self.reader.position()
    }

    /// The newest metadata record of this name read so far. Nothing vouches for it yet: see [`hmd_core::metadata_checksum::is_sealed`], and
    /// [`McapMessages::verified_metadata`] at the end of the file.
    pub fn metadata(&self, name: &str) -> Option<&BTreeMap<String, String>> {
        let named = self.metadata.iter().rev().find(|metadata| metadata.name == name);
        named.map(|metadata| &metadata.content)
    }

    /// The newest metadata record of this name that a checksum vouches for, its own or the one over all data, which is known
    /// at the end of the file; `None` if the file has no record of this name.
    ///
    /// # Errors
    /// The place of the record, where it has the name and no checksum is right.
    pub fn verified_metadata(&self, name: &str) -> Result<Option<&BTreeMap<String, String>>, McapLoss> {
        let mut named = self.metadata.iter().rev().filter(|metadata| metadata.name == name);
        let Some(newest) = named.clone().next() else {
            return Ok(None);
        };
        let vouched = named.find(|metadata| self.all_verified || is_sealed(name, &metadata.content));
        match vouched {
            Some(metadata) => Ok(Some(&metadata.content)),
            None => Err(McapLoss {
                file: self.file.clone(),
                at_byte: newest.at_byte,
                fault: McapFault::Metadata { name: name.to_owned() },
            }),
        }
    }

    /// Serial number of an actuator by the newest metadata of its recording that a checksum vouches for; known from the first message on.
    pub fn serial_number(&self, actuator: &str) -> Option<&str> {
        let mut ours = self
            .metadata
            .iter()
            .rev()
            .filter(|metadata| metadata.name == METADATA_NAME);
        let newest = ours.find(|metadata| is_sealed(METADATA_NAME, &metadata.content))?;
        newest
            .content
            .get(&format!("{actuator}.serial_number"))
            .map(String::as_str)
    }

    /// Bytes that the chunks so far were expanded to.
    pub(crate) fn expanded_bytes(&self) -> u64 {
        self.reader.expanded_bytes()
    }

    /// Whether the header, which is read with the first item, is one of ours.
    pub(crate) fn is_own_file(&self) -> bool {
        self.is_own_file == Some(true)
    }

    /// All metadata records read so far.
    pub(crate) fn all_metadata(&self) -> &[McapMetadata] {
        &self.metadata
    }

    /// The first part that could not be read so far.
    pub fn first_loss(&self) -> Option<&McapLoss> {
        self.first_loss.as_ref()
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

    fn process(&mut self, found: ResyncItem) {
        let at_byte = found.at_byte;
        match found.kind {
            ItemKind::Chunk(content) => {
                self.chunks += 1;
                self.chunk = Some(Open {
                    at_byte,
                    content,
                    fault: None,
                    repeated: 0,
                });
            }
            ItemKind::Header(data) => {
                let is_own = || records::library(&data).is_some_and(|library| library.starts_with(LIBRARY_START));
                self.is_own_file.get_or_insert_with(is_own);
            }
            ItemKind::Metadata(data) => {
                if let Err(fault) = self.add_metadata(at_byte, &data) {
                    self.lose(at_byte, fault);
                }
            }
            ItemKind::AllVerified => self.all_verified = true,
            ItemKind::Attachment => self.attachments += 1,
            // After a damaged chunk the sum over all data is wrong as well: nothing new.
            ItemKind::Fault(McapFault::DataCrc { .. }) if self.first_loss.is_some() => {}
            ItemKind::Fault(fault) => self.lose(at_byte, fault),
        }
    }

    fn add_metadata(&mut self, at_byte: u64, data: &[u8]) -> Result<(), McapFault> {
        let limit = McapFault::MetadataLimit { got: data.len() };
        if data.len() > METADATA_BYTES_MAX {
            return Err(limit);
        }
        let (name, content) = records::metadata(data).ok_or(McapFault::Metadata { name: String::new() })?;
        if [SCHEMA_NAME, CHANNEL_NAME].contains(&name) {
            return match is_sealed(name, &content) {
                false => Err(McapFault::Metadata { name: name.to_owned() }),
                true if self.is_own_file() => self.definitions.add_copy(name, &content),
                // The numbers in it may be those of another file.
                true => Ok(()),
            };
        }
        if self.metadata.len() == METADATA_MAX || self.metadata_bytes + data.len() > METADATA_BYTES_MAX {
            return Err(limit);
        }
        self.metadata_bytes += data.len();
        let name = name.to_owned();
        self.metadata.push(McapMetadata { at_byte, name, content });
        Ok(())
    }

    /// The next message of a chunk; the definitions before it are processed.
    fn next_in_chunk(&mut self, chunk: &mut Open) -> Option<McapMessage> {
        while let Some((opcode, data)) = chunk.content.next() {
            let taken = match opcode {
                op::SCHEMA | op::CHANNEL => self.definitions.add(opcode, data),
                op::MESSAGE => match self.message(chunk.at_byte, data) {
                    Ok(message) if self.is_repeated(&message) => {
                        chunk.repeated += 1;
                        Ok(())
                    }
                    Ok(message) => return Some(message),
                    Err(fault) => Err(fault),
                },
                _ => Ok(()),
            };
            chunk.fault = chunk.fault.take().or(taken.err());
        }
        None
    }

    /// Whether a message of our writer was read before, by its number; notes the number.
    ///
    /// Our writer has one channel for each topic. Of two, as damage makes them, a copy has one again.
    fn is_repeated(&mut self, message: &McapMessage) -> bool {
        if !self.is_own_file() {
            return false;
        }
        let newest = self.newest.get(&message.topic);
        // Numbers wrap.
        if newest.is_some_and(|newest| newest.wrapping_sub(message.sequence) < 1 << 31) {
            return true;
        }
        self.newest.insert(message.topic.clone(), message.sequence);
        false
    }

    fn message(&self, at_byte: u64, data: &[u8]) -> Result<McapMessage, McapFault> {
        let message = records::message(data).ok_or_else(malformed)?;
        let id = message.channel_id;
        let known = self.definitions.channel(id).or_else(|| self.summary.channel(id));
        let channel = known.cloned().ok_or(McapFault::UnknownChannel { id })?;
        Ok(McapMessage {
            topic: channel.topic.clone(),
            schema: channel.protobuf_schema(),
            log_time_ns: message.log_time_ns,
            publish_time_ns: message.publish_time_ns,
            sequence: message.sequence,
            at_byte,
            data: message.data.to_vec(),
            channel,
        })
    }

    fn lose(&mut self, at_byte: u64, fault: McapFault) {
        let loss = McapLoss {
            file: self.file.clone(),
            at_byte,
            fault,
        };
        self.first_loss.get_or_insert_with(|| loss.clone());
        self.loss = Some(loss);
    }
}

impl<R: Read + Seek> Iterator for McapMessages<R> {
    type Item = Result<McapMessage, McapLoss>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(loss) = self.loss.take() {
                return Some(Err(loss));
            }
            let Some(mut chunk) = self.chunk.take() else {
                let found = self.reader.next()?;
                self.process(found);
                continue;
            };
            match self.next_in_chunk(&mut chunk) {
                Some(message) => {
                    self.chunk = Some(chunk);
                    return Some(Ok(message));
                }
                None => {
                    let repeated = McapFault::RepeatedMessages { count: chunk.repeated };
                    if let Some(fault) = chunk.fault.or((chunk.repeated > 0).then_some(repeated)) {
                        self.lose(chunk.at_byte, fault);
                    }
                }
            }
        }
    }
}
