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
    /// What is in the file of a configuration already asks for nothing where its frames have passed.
    pub(super) fn of(config: &Config, now_ns: u64) -> Self {
        let path = config.rul().events.as_ref().map(|path| config.resolve(path));
        let mut requests = Self {
            path,
            ..Self::default()
        };
        requests.take_new();
        let after_ns = (config.output().capture_after_s * 1e9) as u64;
        requests
            .known
            .retain(|(t_ns, _)| t_ns.saturating_add(after_ns) < now_ns);
        requests.read = None;
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
    fn a_request_is_taken_once_and_those_whose_frames_have_passed_at_the_start_never() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.jsonl");
        let text = format!("[rul]\nevents = {path:?}\n[output]\ncapture_after_s = 2");
        let config = Config::from_toml_str(&text, "test").unwrap();
        let event = |t_ns, event| Event {
            t_ns,
            actuator: "ema0".to_owned(),
            event,
            part: None,
            note: None,
        };
        let now_ns = 10_000_000_000;
        for t_ns in [1, now_ns - 2_000_000_001, now_ns - 2_000_000_000, now_ns + 1] {
            event_file::append(&path, &event(t_ns, EventKind::Keep)).unwrap();
        }
        let mut requests = KeepRequests::of(&config, now_ns);
        let to_come = [now_ns - 2_000_000_000, now_ns + 1].map(|t_ns| event(t_ns, EventKind::Keep));
        assert_eq!(requests.take_new(), to_come);
        event_file::append(&path, &event(2, EventKind::Reset)).unwrap();
        event_file::append(&path, &event(3, EventKind::Keep)).unwrap();
        assert_eq!(requests.take_new(), [event(3, EventKind::Keep)]);
        assert_eq!(requests.take_new(), []);
        std::fs::write(&path, "no event").unwrap();
        assert_eq!(requests.take_new(), []);
    }
}
