//! Maintenance events: a part was replaced, and a new life begins. A file of lines, in JSON, that only grows.

use std::fs::OpenOptions;
use std::io::{self, Write};
use std::path::Path;

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
}

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EventKind {
    /// The unit was replaced or overhauled: what was known of its wear is void.
    Reset,
}

/// Why events cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum EventError {
    /// The file cannot be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// What the system said.
        source: io::Error,
    },
    /// A line is no event.
    #[error("{path}:{line}: expected a maintenance event, found {found}")]
    Line {
        /// The file.
        path: String,
        /// Its line, from 1.
        line: usize,
        /// What the reader said.
        found: String,
    },
}

/// Reads all events in the order of time; none if there is no file.
///
/// # Errors
/// [`EventError`].
pub(super) fn read(path: &Path) -> Result<Vec<Event>, EventError> {
    let name = || path.display().to_string();
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(source) => return Err(EventError::Io { path: name(), source }),
    };
    let mut events = Vec::new();
    for (n, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let event: Event = serde_json::from_str(line).map_err(|e| EventError::Line {
            path: name(),
            line: n + 1,
            found: e.to_string(),
        })?;
        events.push(event);
    }
    events.sort_by_key(|event| event.t_ns);
    Ok(events)
}

/// Adds an event at the end of the file.
///
/// # Errors
/// [`EventError::Io`].
pub fn append(path: &Path, event: &Event) -> Result<(), EventError> {
    let put = || {
        let mut file = OpenOptions::new().create(true).append(true).open(path)?;
        // One write: a line is there as a whole or not at all.
        file.write_all(format!("{}\n", serde_json::to_string(event)?).as_bytes())?;
        file.sync_data()
    };
    put().map_err(|source| EventError::Io {
        path: path.display().to_string(),
        source,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_are_read_in_the_order_of_time_and_a_bad_line_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.jsonl");
        assert_eq!(read(&path).unwrap(), []);
        let event = |t_ns| Event {
            t_ns,
            actuator: "ema0".to_owned(),
            event: EventKind::Reset,
        };
        for t_ns in [2, 1] {
            append(&path, &event(t_ns)).unwrap();
        }
        assert_eq!(read(&path).unwrap(), [event(1), event(2)]);
        std::fs::write(&path, "{\"t_ns\":1,\"actuator\":\"ema0\",\"event\":\"party\"}\n").unwrap();
        let error = read(&path).unwrap_err().to_string();
        assert!(
            error.contains("events.jsonl:1: expected a maintenance event"),
            "{error}"
        );
    }
}
