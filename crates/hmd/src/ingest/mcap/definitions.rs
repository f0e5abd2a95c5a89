//! Channels and their schemas, from verified chunks or from a verified summary.

use super::records;
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

/// All definitions read so far.
#[derive(Debug, Default)]
pub(crate) struct Definitions {
    schemas: HashMap<u16, Arc<Schema>>,
    channels: HashMap<u16, Arc<Channel>>,
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

    /// Takes a schema or channel record; `None` when it is malformed.
    pub(super) fn add(&mut self, opcode: u8, data: &[u8]) -> Option<()> {
        if opcode == op::SCHEMA {
            let schema = records::schema(data)?;
            let content = Schema {
                name: schema.name.into(),
                encoding: schema.encoding.to_owned(),
                data: schema.data.to_vec(),
            };
            if self.schemas.get(&schema.id).is_none_or(|known| **known != content) {
                self.schemas.insert(schema.id, Arc::new(content));
            }
        } else {
            let channel = records::channel(data)?;
            let content = Channel {
                topic: channel.topic.into(),
                encoding: channel.encoding.to_owned(),
                metadata: channel.metadata,
                schema: self.schemas.get(&channel.schema_id).cloned(),
            };
            // A repeated definition stays the one it is: whoever holds it sees that nothing has changed.
            if self.channels.get(&channel.id).is_none_or(|known| **known != content) {
                self.channels.insert(channel.id, Arc::new(content));
            }
        }
        Some(())
    }
}
