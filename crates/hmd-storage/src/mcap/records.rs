//! The few MCAP records that are read here, field by field.
//!
//! The crate's own parser reserves whatever length a string claims, up to 4 GiB, before it looks at the record's size;
//! in a damaged file on a small computer that ends the process.

use std::collections::BTreeMap;

/// Fields of a record, front to back; `None` when the record is too short for what it claims.
pub(super) struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    pub(super) fn new(record: &'a [u8]) -> Self {
        Self(record)
    }

    fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (field, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(field)
    }

    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.bytes(N)?.try_into().ok()
    }

    fn u16(&mut self) -> Option<u16> {
        self.number().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.number().map(u64::from_le_bytes)
    }

    fn text(&mut self) -> Option<&'a str> {
        let length = self.u32()?;
        std::str::from_utf8(self.bytes(usize::try_from(length).ok()?)?).ok()
    }

    fn map(&mut self) -> Option<BTreeMap<String, String>> {
        let length = self.u32()?;
        let mut inner = Self(self.bytes(usize::try_from(length).ok()?)?);
        let mut map = BTreeMap::new();
        while !inner.0.is_empty() {
            map.insert(inner.text()?.to_owned(), inner.text()?.to_owned());
        }
        Some(map)
    }
}

/// The number that a definition begins with.
pub(super) fn first_number(record: &[u8]) -> Option<u16> {
    Fields::new(record).u16()
}

/// Definition of a schema.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct SchemaRecord<'a> {
    pub(super) id: u16,
    pub(super) name: &'a str,
    pub(super) encoding: &'a str,
    pub(super) data: &'a [u8],
}

/// A schema.
pub(super) fn schema(record: &[u8]) -> Option<SchemaRecord<'_>> {
    let mut fields = Fields::new(record);
    let id = fields.u16()?;
    let (name, encoding) = (fields.text()?, fields.text()?);
    let length = fields.u32()?;
    let data = fields.bytes(usize::try_from(length).ok()?)?;
    Some(SchemaRecord {
        id,
        name,
        encoding,
        data,
    })
}

/// Definition of a channel.
pub(super) struct ChannelRecord<'a> {
    pub(super) id: u16,
    pub(super) schema_id: u16,
    pub(super) topic: &'a str,
    pub(super) encoding: &'a str,
    pub(super) metadata: BTreeMap<String, String>,
}

/// A channel.
pub(super) fn channel(record: &[u8]) -> Option<ChannelRecord<'_>> {
    let mut fields = Fields::new(record);
    let (id, schema_id) = (fields.u16()?, fields.u16()?);
    Some(ChannelRecord {
        id,
        schema_id,
        topic: fields.text()?,
        encoding: fields.text()?,
        metadata: fields.map()?,
    })
}

/// One message.
pub(super) struct MessageRecord<'a> {
    pub(super) channel_id: u16,
    pub(super) sequence: u32,
    pub(super) log_time_ns: u64,
    pub(super) publish_time_ns: u64,
    pub(super) data: &'a [u8],
}

/// A message.
pub(super) fn message(record: &[u8]) -> Option<MessageRecord<'_>> {
    let mut fields = Fields::new(record);
    Some(MessageRecord {
        channel_id: fields.u16()?,
        sequence: fields.u32()?,
        log_time_ns: fields.u64()?,
        publish_time_ns: fields.u64()?,
        data: fields.0,
    })
}

/// Name and content of a metadata record; nothing may follow them, so that a right checksum vouches for the length too.
pub(super) fn metadata(record: &[u8]) -> Option<(&str, BTreeMap<String, String>)> {
    let mut fields = Fields::new(record);
    let (name, content) = (fields.text()?, fields.map()?);
    fields.0.is_empty().then_some((name, content))
}

/// What wrote a file, by its header.
pub(super) fn library(record: &[u8]) -> Option<&str> {
    let mut fields = Fields::new(record);
    let _profile = fields.text()?;
    fields.text()
}

/// Length that a chunk says its content has when decompressed; the decoder goes no further.
pub(super) fn chunk_expanded_bytes(record: &[u8]) -> Option<u64> {
    let mut fields = Fields::new(record);
    let _times: [u8; 16] = fields.number()?;
    fields.u64()
}

/// Checksum of a chunk's decompressed content; 0 when it has none.
pub(super) fn chunk_crc(record: &[u8]) -> Option<u32> {
    let mut fields = Fields::new(record);
    let _times_and_size: [u8; 24] = fields.number()?;
    fields.u32()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_beyond_the_record_is_refused() {
        let whole = [1, 0, 2, 0, 0, 0, b'a', b'b', 1, 0, 0, 0, b'e', 1, 0, 0, 0, 7];
        let expected = SchemaRecord {
            id: 1,
            name: "ab",
            encoding: "e",
            data: &[7],
        };
        assert_eq!(schema(&whole), Some(expected));
        assert_eq!(schema(&whole[..17]), None);
        assert_eq!(schema(&[1, 0, 0xFF, 0xFF, 0xFF, 0xFF, b'a', b'b']), None);
        assert_eq!(schema(&[1, 0, 1, 0, 0, 0, 0xFF]), None, "not UTF-8");
        assert_eq!(metadata(&[1, 0, 0, 0, b'n', 0, 0, 0, 0]), Some(("n", BTreeMap::new())));
        assert_eq!(metadata(&[1, 0, 0, 0, b'n', 9, 0, 0, 0]), None);
        assert_eq!(metadata(&[1, 0, 0, 0, b'n', 0, 0, 0, 0, 0]), None, "bytes left over");
    }
}
