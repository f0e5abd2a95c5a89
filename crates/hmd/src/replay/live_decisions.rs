//! What a live run decided by time: replay must decide the same.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;

use prost::Message;

use hmd_core::record::{Dropped, Record, Shortened};
use hmd_storage::mcap::McapMessages;

/// What a live run decided by time, out of the logs that it wrote; by actuator and start of each window.
#[derive(Debug, Default)]
pub(super) struct LiveDecisions {
    pub(super) dropped: BTreeSet<(String, u64)>,
    pub(super) shortened: BTreeMap<(String, u64), Shortened>,
}

impl LiveDecisions {
    /// They must be known before their windows are met, and a run records them only later. A log that cannot be read has none; it is
    /// reported when it is replayed.
    pub(super) fn of(logs: &[PathBuf]) -> Self {
        let mut found = Self::default();
        for log in logs {
            // Nothing else than a regular file can be read twice.
            if !log.metadata().is_ok_and(|of| of.is_file()) {
                continue;
            }
            let Ok(file) = File::open(log) else { continue };
            let Ok(messages) = McapMessages::new(BufReader::new(file), &log.display().to_string()) else {
                continue;
            };
            let topics = messages.topics();
            let none = |topic: &String| !topic.ends_with("/dropped") && !topic.ends_with("/shortened");
            if !topics.is_empty() && topics.iter().all(none) {
                continue;
            }
            for message in messages.flatten() {
                let data = message.data.as_slice();
                if *message.schema == *Dropped::SCHEMA_NAME {
                    let decoded = Dropped::decode(data);
                    found
                        .dropped
                        .extend(decoded.map(|record| (record.actuator, record.t_start_ns)));
                } else if *message.schema == *Shortened::SCHEMA_NAME {
                    let decoded = Shortened::decode(data);
                    found
                        .shortened
                        .extend(decoded.map(|record| ((record.actuator.clone(), record.t_start_ns), record)));
                }
            }
        }
        found
    }
}
