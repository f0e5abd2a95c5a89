//! Maintenance events: a part was replaced, and the history of the unit starts again; or the frames of a time shall be kept.

use serde::{Deserialize, Serialize};

/// One event.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Event {
    /// When, UTC ns.
    pub t_ns: u64,
    /// Which actuator.
    pub actuator: String,
    /// What happened.
    pub event: EventKind,
    /// What the person who entered it wrote; older files had none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EventKind {
    /// The unit was replaced or overhauled: what was known of its wear is void.
    Reset,
    /// The frames around this time shall be stored by a daemon that does not store all; the history goes on.
    Keep,
}

/// The events of a file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Events {
    /// In the order of time.
    pub list: Vec<Event>,
    /// Lines that were never finished, as when the power went while one was written; from 1.
    pub unfinished: Vec<usize>,
}
