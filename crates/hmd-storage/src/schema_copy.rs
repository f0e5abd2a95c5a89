//! The further copies of a channel's definition, outside the chunks.
//!
//! MCAP defines a channel once, in the chunk where it is first used, and again in the summary, which a file that was cut
//! has not. One flipped bit in that chunk would take every message behind it. So each schema and each channel is written
//! as a sealed metadata record as well ([`mod@hmd_core::metadata_checksum`]), before the chunk that defines it, and once more some kilobytes
//! on, since a disk may lose a block as a whole.
//!
//! The numbers in such a record hold only in the file that it was written for: a reader believes it only below a header
//! of ours (`LIBRARY_START`), because other programs copy metadata into files whose channels they number anew.

use std::collections::BTreeMap;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

/// Name of the metadata record that repeats a schema.
pub const SCHEMA_NAME: &str = "hmd-schema";
/// Name of the metadata record that repeats a channel.
pub const CHANNEL_NAME: &str = "hmd-channel";
/// How the library in the header of a file begins that `hmd` wrote.
pub(crate) const LIBRARY_START: &str = "hmd/";

/// What an entry of a channel's own metadata is called in the record, with its key behind it.
const METADATA_START: &str = "metadata.";

/// A schema with its number.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct SchemaCopy {
    pub(crate) id: u16,
    pub(crate) name: String,
    pub(crate) encoding: String,
    pub(crate) data: Vec<u8>,
}

impl SchemaCopy {
    /// As the content of a metadata record.
    pub(crate) fn emit(&self) -> BTreeMap<String, String> {
        entries([
            ("id", self.id.to_string()),
            ("name", self.name.clone()),
            ("encoding", self.encoding.clone()),
            ("data_base64", STANDARD.encode(&self.data)),
        ])
    }

    /// `None` when an entry is missing or not of its kind.
    pub(crate) fn parse(content: &BTreeMap<String, String>) -> Option<Self> {
        Some(Self {
            id: content.get("id")?.parse().ok()?,
            name: content.get("name")?.clone(),
            encoding: content.get("encoding")?.clone(),
            data: STANDARD.decode(content.get("data_base64")?).ok()?,
        })
    }
}

/// A channel with its number and that of its schema.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ChannelCopy {
    pub(crate) id: u16,
    pub(crate) schema_id: u16,
    pub(crate) topic: String,
    pub(crate) encoding: String,
    pub(crate) metadata: BTreeMap<String, String>,
}

impl ChannelCopy {
    /// As the content of a metadata record.
    pub(crate) fn emit(&self) -> BTreeMap<String, String> {
        let mut content = entries([
            ("id", self.id.to_string()),
            ("schema_id", self.schema_id.to_string()),
            ("topic", self.topic.clone()),
            ("encoding", self.encoding.clone()),
        ]);
        for (key, value) in &self.metadata {
            content.insert(format!("{METADATA_START}{key}"), value.clone());
        }
        content
    }

    /// `None` when an entry is missing or not of its kind.
    pub(crate) fn parse(content: &BTreeMap<String, String>) -> Option<Self> {
        let own = content
            .iter()
            .filter_map(|(key, value)| Some((key.strip_prefix(METADATA_START)?.to_owned(), value.clone())));
        Some(Self {
            id: content.get("id")?.parse().ok()?,
            schema_id: content.get("schema_id")?.parse().ok()?,
            topic: content.get("topic")?.clone(),
            encoding: content.get("encoding")?.clone(),
            metadata: own.collect(),
        })
    }
}

fn entries<const N: usize>(entries: [(&str, String); N]) -> BTreeMap<String, String> {
    entries.map(|(key, value)| (key.to_owned(), value)).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        // Texts of any characters take long to draw.
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn a_copy_is_read_as_it_is_written(
            id: u16, schema_id: u16, name: String, encoding: String, data: Vec<u8>,
            metadata: BTreeMap<String, String>,
        ) {
            let schema = SchemaCopy { id, name: name.clone(), encoding: encoding.clone(), data };
            prop_assert_eq!(SchemaCopy::parse(&schema.emit()), Some(schema));
            let channel = ChannelCopy { id, schema_id, topic: name, encoding, metadata };
            prop_assert_eq!(ChannelCopy::parse(&channel.emit()), Some(channel));
        }
    }

    #[test]
    fn what_is_missing_or_of_another_kind_is_refused() {
        let channel = ChannelCopy {
            id: 1,
            schema_id: 2,
            topic: "/log".to_owned(),
            encoding: "protobuf".to_owned(),
            metadata: BTreeMap::new(),
        };
        for key in ["id", "schema_id", "topic", "encoding"] {
            let mut content = channel.emit();
            content.remove(key);
            assert_eq!(ChannelCopy::parse(&content), None, "{key}");
        }
        let mut content = channel.emit();
        content.insert("id".to_owned(), "65536".to_owned());
        assert_eq!(ChannelCopy::parse(&content), None);
    }
}
