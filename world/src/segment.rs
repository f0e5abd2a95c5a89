//! What a segment says.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Read, Seek};
use std::path::Path;

use hmd_storage::mcap::McapMessages;

/// Topic, time and content of a record.
pub(crate) type Messages = BTreeMap<(String, u64), Vec<Vec<u8>>>;

/// The records of one segment.
#[derive(Default)]
pub(crate) struct Segment {
    pub(crate) found: Messages,
    /// Places that cannot be read.
    pub(crate) losses: usize,
}

pub(crate) fn read_segment(input: impl Read + Seek, name: &str) -> io::Result<Segment> {
    let mut segment = Segment::default();
    for message in McapMessages::new(input, name)? {
        match message {
            Ok(message) => {
                let key = (message.topic.to_string(), message.log_time_ns);
                segment.found.entry(key).or_default().push(message.data);
            }
            Err(_) => segment.losses += 1,
        }
    }
    Ok(segment)
}

/// All that can be read of a segment.
pub(crate) fn read_messages(path: &Path) -> Messages {
    let segment = fs::File::open(path).and_then(|file| read_segment(file, &path.to_string_lossy()));
    segment.unwrap_or_default().found
}
