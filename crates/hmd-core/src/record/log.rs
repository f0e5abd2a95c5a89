//! Log lines in the form that viewers know: `foxglove.Log`.
//!
//! The one message whose definition is not ours. It has an enum and an import, so its descriptor is written out here
//! instead of stretching the table; the test below and `fixtures/check_mcap.py` compare it with the encoding.

use super::Record;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto, FileDescriptorProto,
    FileDescriptorSet, Timestamp,
};

/// Severity of a log line, with the numbers of `foxglove.Log.Level`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ::prost::Enumeration)]
#[repr(i32)]
pub enum LogLevel {
    /// Not said.
    Unknown = 0,
    /// For developers.
    Debug = 1,
    /// For the record.
    Info = 2,
    /// Worth a look.
    Warning = 3,
    /// Something failed.
    Error = 4,
    /// The process ends.
    Fatal = 5,
}

/// One log line.
#[derive(Clone, PartialEq, ::prost::Message)]
pub struct Log {
    /// Time of the line, UTC.
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    /// Severity, a [`LogLevel`].
    #[prost(enumeration = "LogLevel", tag = "2")]
    pub level: i32,
    /// The text.
    #[prost(string, tag = "3")]
    pub message: String,
    /// What wrote it (crate and module).
    #[prost(string, tag = "4")]
    pub name: String,
    /// Source file.
    #[prost(string, tag = "5")]
    pub file: String,
    /// Line in the source file.
    #[prost(fixed32, tag = "6")]
    pub line: u32,
}

impl LogLevel {
    /// Name as in the schema.
    pub fn name(self) -> &'static str {
        match self {
            Self::Unknown => "UNKNOWN",
            Self::Debug => "DEBUG",
            Self::Info => "INFO",
            Self::Warning => "WARNING",
            Self::Error => "ERROR",
            Self::Fatal => "FATAL",
        }
    }
}

impl Log {
    /// A line of `name` at `stamp_ns` (UTC ns), without a place in the source.
    pub fn new(stamp_ns: u64, level: LogLevel, name: &str, message: &str) -> Self {
        Self {
            timestamp: Some(Timestamp {
                seconds: (stamp_ns / 1_000_000_000) as i64,
                nanos: (stamp_ns % 1_000_000_000) as i32,
            }),
            level: level as i32,
            message: message.to_owned(),
            name: name.to_owned(),
            ..Self::default()
        }
    }
}

impl Record for Log {
    const SCHEMA_NAME: &'static str = "foxglove.Log";

    fn topic(&self) -> String {
        "/log".to_owned()
    }

    fn descriptor() -> FileDescriptorSet {
        let levels = (0..).map_while(|number| LogLevel::try_from(number).ok());
        let level = EnumDescriptorProto {
            name: Some("Level".to_owned()),
            value: levels
                .map(|level| EnumValueDescriptorProto {
                    name: Some(level.name().to_owned()),
                    number: Some(level as i32),
                    options: None,
                })
                .collect(),
            ..Default::default()
        };
        let message = DescriptorProto {
            name: Some("Log".to_owned()),
            field: vec![
                field(1, "timestamp", Type::Message, Some(".google.protobuf.Timestamp")),
                field(2, "level", Type::Enum, Some(".foxglove.Log.Level")),
                field(3, "message", Type::String, None),
                field(4, "name", Type::String, None),
                field(5, "file", Type::String, None),
                field(6, "line", Type::Fixed32, None),
            ],
            enum_type: vec![level],
            ..Default::default()
        };
        let timestamp = DescriptorProto {
            name: Some("Timestamp".to_owned()),
            field: vec![
                field(1, "seconds", Type::Int64, None),
                field(2, "nanos", Type::Int32, None),
            ],
            ..Default::default()
        };
        let file = |name: &str, package: &str, message| FileDescriptorProto {
            name: Some(name.to_owned()),
            package: Some(package.to_owned()),
            message_type: vec![message],
            syntax: Some("proto3".to_owned()),
            ..Default::default()
        };
        let imported = "google/protobuf/timestamp.proto";
        let mut log = file("foxglove/Log.proto", "foxglove", message);
        log.dependency = vec![imported.to_owned()];
        FileDescriptorSet {
            file: vec![file(imported, "google.protobuf", timestamp), log],
        }
    }
}

fn field(tag: i32, name: &str, kind: Type, type_name: Option<&str>) -> FieldDescriptorProto {
    FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(tag),
        label: Some(Label::Optional as i32),
        r#type: Some(kind as i32),
        type_name: type_name.map(str::to_owned),
        ..Default::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use prost::Message;

    #[test]
    fn the_encoding_follows_the_descriptor() {
        let mut log = Log::new(1_700_000_000_000_000_005, LogLevel::Warning, "hmd", "cold");
        log.file = "a.rs".to_owned();
        log.line = 7;
        let bytes = log.encode_to_vec();
        // Tag and wire type of each field, in order: message, varint, three strings, fixed32.
        let mut expected = vec![0x0A, 8, 0x08, 0x80, 0xE2, 0xCF, 0xAA, 0x06, 0x10, 5, 0x10, 3, 0x1A, 4];
        expected.extend(b"cold\x22\x03hmd\x2A\x04a.rs\x35\x07\0\0\0");
        assert_eq!(bytes, expected);
        assert_eq!(Log::decode(bytes.as_slice()).unwrap(), log);
    }
}
