//! Times whose frames `hmd event --keep` asks for, out of the file of maintenance events.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::SystemTime;

use hmd_core::config::Config;
use hmd_core::history::{Event, EventKind};
use hmd_storage::event_file;

/// The file, and what was read of it.
#[derive(Debug, Default)]
pub(super) struct KeepRequests {
    path: Option<PathBuf>,
    /// Change and length of the file when it was read last.
    read: Option<(SystemTime, u64)>,
    known: BTreeSet<(u64, String)>,
}

impl KeepRequests {
    /// What is in the file of a configuration already asks for nothing: its frames have passed.
    pub(super) fn of(config: &Config) -> Self {
        let path = config.rul().events.as_ref().map(|path| config.resolve(path));
        let mut requests = Self {
            path,
            ..Self::default()
        };
        requests.take_new();
        requests
    }

    /// Requests since the last call. A file that cannot be read asks for nothing; it is reported with the next window.
    pub(super) fn take_new(&mut self) -> Vec<Event> {
        let Some(path) = &self.path else { return Vec::new() };
        let about = path.metadata().and_then(|about| Ok((about.modified()?, about.len())));
        let Ok(about) = about else { return Vec::new() };
        if self.read == Some(about) {
            return Vec::new();
        }
        let Ok(events) = event_file::read(path) else {
            return Vec::new();
        };
        self.read = Some(about);
        let is_keep = |event: &Event| event.event == EventKind::Keep;
        let known = &mut self.known;
        let keeps = events.list.into_iter().filter(is_keep);
        keeps
            .filter(|event| known.insert((event.t_ns, event.actuator.clone())))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_is_taken_once_and_those_before_the_start_never() {
        let folder = tempfile::tempdir().unwrap();
        let config = Config::from_toml_str("[rul]\nevents = \"events.jsonl\"", "test").unwrap();
        let path = folder.path().join("events.jsonl");
        let event = |t_ns, event| Event {
            t_ns,
            actuator: "ema0".to_owned(),
            event,
            part: None,
            note: None,
        };
        event_file::append(&path, &event(1, EventKind::Keep)).unwrap();
        let mut requests = KeepRequests {
            path: Some(path.clone()),
            ..KeepRequests::of(&config)
        };
        requests.take_new();
        event_file::append(&path, &event(2, EventKind::Reset)).unwrap();
        event_file::append(&path, &event(3, EventKind::Keep)).unwrap();
        assert_eq!(requests.take_new(), [event(3, EventKind::Keep)]);
        assert_eq!(requests.take_new(), []);
        std::fs::write(&path, "no event").unwrap();
        assert_eq!(requests.take_new(), []);
    }
}
