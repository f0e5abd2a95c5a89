//! Reads and writes the file of maintenance events: one JSON object a line, appended only. A replaced part resets the history.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

use hmd_core::config::Config;
use hmd_core::history::{Event, Events, UnreadableLine};

use crate::output_file::sync_folder_of;
use crate::regular_file::read_regular;

/// Most bytes of a file: a hundred thousand events.
const BYTES_MAX: u64 = 16 << 20;

/// Why events cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum EventError {
    /// The file cannot be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// Error of the operating system.
        source: io::Error,
    },
    /// An event cannot be added.
    #[error("{path}: the event is not noted: {source}")]
    Append {
        /// The file.
        path: String,
        /// Error of the operating system.
        source: io::Error,
    },
    /// No line is an event.
    #[error("{path}:{line}: expected a maintenance event, found {found}")]
    Line {
        /// The file.
        path: String,
        /// Its line, from 1.
        line: usize,
        /// Error of the reader.
        found: String,
    },
}

/// Reads all events; none if there is no file. Lines that are none are told, the first of them by their numbers: one bad line does not
/// keep the others from counting.
///
/// # Errors
/// [`EventError`]; a file of which no line is an event is none of ours.
pub fn read(path: &Path) -> Result<Events, EventError> {
    let name = || path.display().to_string();
    let bytes = match read_regular(path, BYTES_MAX) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Events::default()),
        Err(source) => return Err(EventError::Io { path: name(), source }),
    };
    let mut events = Events::default();
    let mut lines = bytes
        .split(|byte| *byte == b'\n')
        .map(<[u8]>::trim_ascii)
        .enumerate()
        .peekable();
    while let Some((n, line)) = lines.next() {
        if line.is_empty() {
            continue;
        }
        // Behind the last end of a line; a power cut may leave zeros there as well.
        let is_torn = (lines.peek().is_none() || line.contains(&0)) && matches!(line[0], b'{' | 0);
        match serde_json::from_slice::<Event>(line) {
            Ok(event) => events.list.push(event),
            Err(_) if !events.takes_bad_line() => {}
            Err(e) if e.is_eof() || is_torn => events.unfinished.push(n + 1),
            Err(e) => {
                // Where in the line matters to nobody, and counts another line.
                let found = e.to_string();
                let found = found.split(" at line ").next().unwrap_or_default().to_owned();
                events.unreadable.push(UnreadableLine { line: n + 1, found });
            }
        }
    }
    if let (true, Some(UnreadableLine { line, found })) = (events.list.is_empty(), events.unreadable.first()) {
        return Err(EventError::Line {
            path: name(),
            line: *line,
            found: found.clone(),
        });
    }
    events.list.sort_by_key(|event| event.t_ns);
    Ok(events)
}

/// The maintenance events of a configuration.
///
/// # Errors
/// A file that is there and cannot be read.
pub fn load_events(config: &Config) -> Result<Events, EventError> {
    match &config.rul().events {
        Some(path) => read(&config.resolve(path)),
        None => Ok(Events::default()),
    }
}

/// Adds an event at the end of the file, which must be one of events.
///
/// # Errors
/// [`EventError`].
pub fn append(path: &Path, event: &Event) -> Result<(), EventError> {
    read(path)?;
    let was_there = path.exists();
    let put = || {
        let is_new = !path.exists();
        let mut file = OpenOptions::new().create(true).read(true).append(true).open(path)?;
        // After a line that was never finished.
        let begin = if ends_a_line(&mut file)? { "" } else { "\n" };
        file.write_all(format!("{begin}{}\n", serde_json::to_string(event)?).as_bytes())?;
        file.sync_data()?;
        if is_new { sync_folder_of(path) } else { Ok(()) }
    };
    put().map_err(|source| {
        // A full disk takes the name of a file, and nothing in it.
        if !was_there && fs::metadata(path).is_ok_and(|about| about.len() == 0) {
            let _ = fs::remove_file(path);
        }
        let path = path.display().to_string();
        EventError::Append { path, source }
    })
}

/// Whether the next line can begin at the end of a file.
fn ends_a_line(file: &mut File) -> io::Result<bool> {
    if file.seek(SeekFrom::End(0))? == 0 {
        return Ok(true);
    }
    let mut last = [0];
    file.seek(SeekFrom::End(-1))?;
    file.read_exact(&mut last)?;
    Ok(last == *b"\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use hmd_core::history::EventKind;

    #[test]
    fn events_are_read_in_the_order_of_time_and_a_bad_line_is_reported() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.jsonl");
        assert_eq!(read(&path).unwrap(), Events::default());
        let found = |list, unfinished| {
            let unreadable = Vec::new();
            let expected = Events {
                list,
                unfinished,
                unreadable,
                more_bad_lines: 0,
            };
            assert_eq!(read(&path).unwrap(), expected);
        };
        let event = |t_ns| Event {
            t_ns,
            actuator: "ema0".to_owned(),
            event: EventKind::Reset,
            part: None,
            note: None,
        };
        for t_ns in [2, 1] {
            append(&path, &event(t_ns)).unwrap();
        }
        found(vec![event(1), event(2)], vec![]);
        // The power goes at any byte of a third, and the event is entered again.
        let two = std::fs::read(&path).unwrap();
        append(&path, &event(3)).unwrap();
        let three = std::fs::read(&path).unwrap();
        for cut in two.len() + 1..three.len() - 1 {
            std::fs::write(&path, &three[..cut]).unwrap();
            found(vec![event(1), event(2)], vec![3]);
            append(&path, &event(4)).unwrap();
            found(vec![event(1), event(2), event(4)], vec![3]);
        }
        std::fs::write(&path, &three[..three.len() - 1]).unwrap();
        append(&path, &event(4)).unwrap();
        assert_eq!(
            read(&path).unwrap().list.len(),
            4,
            "only the end of the line was missing"
        );
        std::fs::write(&path, [two.as_slice(), &[0, 0, 0xff]].concat()).unwrap();
        found(vec![event(1), event(2)], vec![3]);
        // A line that somebody spoilt leaves the others.
        let spoilt = [two.as_slice(), b"reset ema0\n", two.as_slice()].concat();
        std::fs::write(&path, spoilt).unwrap();
        let events = read(&path).unwrap();
        let lines: Vec<usize> = events.unreadable.iter().map(|bad| bad.line).collect();
        assert_eq!((events.list.len(), lines), (4, vec![3]));
        // However many lines are bad, a bounded number is held.
        let bad = [two.as_slice(), &b"{\nno event\n".repeat(1000)].concat();
        std::fs::write(&path, bad).unwrap();
        let events = read(&path).unwrap();
        assert_eq!((events.unfinished.len(), events.unreadable.len()), (50, 50));
        assert_eq!((events.list.len(), events.more_bad_lines), (2, 1900));
        // Zeros alone make no line of events.
        std::fs::write(&path, b"\x89MCAP0\r\n\x01\0\0\n").unwrap();
        assert!(matches!(
            append(&path, &event(1)),
            Err(EventError::Line { line: 1, .. })
        ));
        std::fs::write(&path, "{\"t_ns\":1,\"actuator\":\"ema0\",\"event\":\"party\"}\n").unwrap();
        let error = read(&path).unwrap_err().to_string();
        assert!(
            error.contains("events.jsonl:1: expected a maintenance event"),
            "{error}"
        );
    }
}
