//! Channels and their schemas, from verified chunks, from sealed metadata or from a verified summary.

use super::chunk::malformed;
use super::fault::McapFault;
use super::records;
use crate::schema_copy::{ChannelCopy, SCHEMA_NAME, SchemaCopy};
use mcap::records::op;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// What the messages of a channel are encoded by.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Schema {
    pub(crate) name: Arc<str>,
    pub(crate) encoding: String,
    pub(crate) data: Vec<u8>,
}

/// A channel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Channel {
    pub(crate) topic: Arc<str>,
    pub(crate) encoding: String,
    pub(crate) metadata: BTreeMap<String, String>,
    /// `None` when it has none, or when its definition is lost.
    pub(crate) schema: Option<Arc<Schema>>,
}

impl Channel {
    /// Name of the schema when the messages are protobuf; another encoding must not pass under the schema's name.
    pub(crate) fn protobuf_schema(&self) -> Arc<str> {
        let schema = self.schema.as_ref().filter(|_| self.encoding == "protobuf");
        schema.map_or_else(|| "".into(), |schema| schema.name.clone())
    }
}

/// Most definitions that are taken from a file, repetitions apart.
pub(super) const ENTRIES_MAX: usize = 4096;
/// Most bytes of all of them together, as they stand in the file; a map of many small entries takes some ten times that.
pub(super) const BYTES_MAX: usize = 4 << 20;

/// All definitions read so far.
///
/// What was replaced may still be held by messages, so the bounds count whatever was ever taken. A definition beyond
/// them is a fault, and leaves its number without any: its messages must not pass for others'.
#[derive(Debug, Default)]
pub(crate) struct Definitions {
    schemas: HashMap<u16, Arc<Schema>>,
    channels: HashMap<u16, Arc<Channel>>,
    entries: usize,
    bytes: usize,
}

impl Definitions {
    /// All topics, in no order.
    pub(super) fn topics(&self) -> impl Iterator<Item = String> {
        self.channels.values().map(|channel| channel.topic.to_string())
    }

    /// The channel with this number.
    pub(crate) fn channel(&self, id: u16) -> Option<&Arc<Channel>> {
        self.channels.get(&id)
    }

    /// Takes a schema or channel record.
    pub(super) fn add(&mut self, opcode: u8, data: &[u8]) -> Result<(), McapFault> {
        let is_schema = opcode == op::SCHEMA;
        if data.len() > BYTES_MAX {
            // Not even parsed.
            return Err(self.refuse(is_schema, records::first_number(data)));
        }
        if is_schema {
            let schema = records::schema(data).ok_or_else(malformed)?;
            let content = Schema {
                name: schema.name.into(),
                encoding: schema.encoding.to_owned(),
                data: schema.data.to_vec(),
            };
            self.set_schema(schema.id, content, data.len())
        } else {
            let channel = records::channel(data).ok_or_else(malformed)?;
            let content = Channel {
                topic: channel.topic.into(),
                encoding: channel.encoding.to_owned(),
                metadata: channel.metadata,
                schema: self.schemas.get(&channel.schema_id).cloned(),
            };
            self.set_channel(channel.id, content, data.len())
        }
    }

    /// Takes a sealed metadata record that repeats a definition ([`mod@crate::schema_copy`]).
    pub(super) fn add_copy(&mut self, name: &str, content: &BTreeMap<String, String>) -> Result<(), McapFault> {
        let bytes = content.iter().map(|(key, value)| key.len() + value.len()).sum();
        let unreadable = || McapFault::Metadata { name: name.to_owned() };
        if name == SCHEMA_NAME {
            let copy = SchemaCopy::parse(content).ok_or_else(unreadable)?;
            let content = Schema {
                name: copy.name.into(),
                encoding: copy.encoding,
                data: copy.data,
            };
            self.set_schema(copy.id, content, bytes)
        } else {
            let copy = ChannelCopy::parse(content).ok_or_else(unreadable)?;
            let content = Channel {
                topic: copy.topic.into(),
                encoding: copy.encoding,
                metadata: copy.metadata,
                schema: self.schemas.get(&copy.schema_id).cloned(),
            };
            self.set_channel(copy.id, content, bytes)
        }
    }

    // A repeated definition stays the one it is: whoever holds it sees that nothing has changed.

    fn set_schema(&mut self, id: u16, content: Schema, bytes: usize) -> Result<(), McapFault> {
        if self.schemas.get(&id).is_some_and(|known| **known == content) {
            return Ok(());
        }
        if !self.count(bytes) {
            return Err(self.refuse(true, Some(id)));
        }
        self.schemas.insert(id, Arc::new(content));
        Ok(())
    }

    fn set_channel(&mut self, id: u16, content: Channel, bytes: usize) -> Result<(), McapFault> {
        if self.channels.get(&id).is_some_and(|known| **known == content) {
            return Ok(());
        }
        if !self.count(bytes) {
            return Err(self.refuse(false, Some(id)));
        }
        self.channels.insert(id, Arc::new(content));
        Ok(())
    }

    /// Whether one more of that size is within the bounds; then it is counted.
    fn count(&mut self, bytes: usize) -> bool {
        let fits = self.entries < ENTRIES_MAX && self.bytes + bytes <= BYTES_MAX;
        if fits {
            self.entries += 1;
            self.bytes += bytes;
        }
        fits
    }

    fn refuse(&mut self, is_schema: bool, id: Option<u16>) -> McapFault {
        match id {
            Some(id) if is_schema => drop(self.schemas.remove(&id)),
            Some(id) => drop(self.channels.remove(&id)),
            None => {}
        }
        McapFault::Definitions
    }
}
