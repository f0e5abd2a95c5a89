//! The records that are written to an MCAP file, with their schemas, and the line of `--json`.
//!
//! Each record is one protobuf message of package `hmd.v1` on one topic; `docs/records.md` is the table for readers of
//! the file. A value that does not exist is absent (proto3 `optional`), never NaN.

mod assessed;
mod dropped;
mod health;
mod json;
mod last_shown;
mod log;
mod raw;
mod rul;
pub mod schema;
mod sensors;
mod shortened;
mod status;
mod unit_mark;
mod window;
mod window_status;

pub use assessed::{Assessed, Ended};
pub use dropped::Dropped;
pub use health::{Estimate, Health};
pub use json::{HealthLine, Interval};
pub use last_shown::{LastShown, Shown};
pub use log::{Log, LogLevel};
pub use raw::{BatchError, RawBatch};
pub use rul::Rul;
pub use schema::PACKAGE;
pub use sensors::{SensorReading, Sensors};
pub use shortened::{Grant, Shortened};
pub use status::{ActuatorStatus, DataState, InterfaceStatus, Status, StorageState, StoreStatus};
pub use unit_mark::UnitMark;
pub use window::Window;
pub use window_status::WindowStatus;

use prost_types::FileDescriptorSet;

/// Version of the meaning of the records, written into every channel's metadata; a breaking change counts it up.
pub const SCHEMA_VERSION: &str = "2";

/// A message with a schema and a topic of its own.
pub trait Record: prost::Message + Default {
    /// Full protobuf name, which is also the name of the MCAP schema.
    const SCHEMA_NAME: &'static str;

    /// The topic that this record goes to.
    fn topic(&self) -> String;

    /// Descriptor of the message and of all that it imports.
    fn descriptor() -> FileDescriptorSet;
}

/// Joins a message of the table, its name and its topic.
macro_rules! impl_record {
    ($name:ident, |$record:ident| $topic:expr) => {
        impl $crate::record::Record for $name {
            const SCHEMA_NAME: &'static str = concat!("hmd.v1.", stringify!($name));

            fn topic(&self) -> String {
                let $record = self;
                $topic
            }

            fn descriptor() -> ::prost_types::FileDescriptorSet {
                $crate::record::schema::descriptor_set(Self::message_descriptor(), Self::row_descriptors())
            }
        }
    };
}
pub(crate) use impl_record;

/// `value` if it is a number; protobuf and JSON say "none" by absence.
pub(crate) fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check<R: Record>() {
        let set = R::descriptor();
        let file = set.file.last().unwrap();
        let message = &file.message_type[0];
        assert_eq!(R::SCHEMA_NAME, format!("{}.{}", file.package(), message.name()));
        let mut tags: Vec<_> = message.field.iter().map(|field| field.number()).collect();
        tags.dedup();
        assert_eq!(tags.len(), message.field.len(), "tags of {}", R::SCHEMA_NAME);
        let mut sorted = tags.clone();
        sorted.sort_unstable();
        assert_eq!(tags, sorted, "fields of {} stand in tag order", R::SCHEMA_NAME);
    }

    #[test]
    fn every_descriptor_is_complete() {
        check::<RawBatch>();
        check::<Window>();
        check::<Health>();
        check::<Rul>();
        check::<Sensors>();
        check::<Status>();
        check::<Log>();
        check::<Assessed>();
        check::<Ended>();
        check::<Dropped>();
        check::<Shortened>();
    }

    #[test]
    fn a_field_that_is_gone_keeps_its_number_and_its_name() {
        let set = Status::descriptor();
        let message = &set.file[0].message_type[0];
        let reserved: Vec<_> = message.reserved_range.iter().map(|of| (of.start(), of.end())).collect();
        // `lost_own_queue`, and the parallel lists of schema version 1.
        let gone: Vec<_> = [14].into_iter().chain(31..=33).chain(71..=80).collect();
        assert_eq!(reserved, gone.iter().map(|&n| (n, n + 1)).collect::<Vec<_>>());
        assert_eq!(message.reserved_name.len(), gone.len());
        assert_eq!(message.reserved_name[0], "lost_own_queue");
        assert!(message.field.iter().all(|field| !gone.contains(&field.number())));
        // A file that has it, with 5 in it, is read all the same.
        assert_eq!(
            <Status as prost::Message>::decode(&[14 << 3, 5][..]),
            Ok(Status::default())
        );
    }

    #[test]
    fn the_package_is_the_one_in_the_names() {
        assert!(Health::SCHEMA_NAME.starts_with(PACKAGE));
    }
}
