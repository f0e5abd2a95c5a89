//! Times whose frames `hmd event --keep` asks for, out of the file of maintenance events.
//!
//! Each request has one answer, whatever becomes of the run that should have given it: a file beside the captures says which have theirs.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use hmd_core::config::Config;
use hmd_core::history::{Event, EventKind};
use hmd_storage::event_file;

/// Name of the file of requests that were answered, in the folder of the captures.
const ANSWERED: &str = "keep-requests.jsonl";

/// The file, and what was read of it.
#[derive(Debug, Default)]
pub(super) struct KeepRequests {
    path: Option<PathBuf>,
    /// Change and length of the file when it was read last.
    read: Option<(SystemTime, u64)>,
    known: BTreeSet<(u64, String)>,
    /// Requests that a run before has answered, and whose frames still come.
    continued: BTreeSet<(u64, String)>,
    answered: PathBuf,
}

/// Frames of a time that somebody asks for.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct KeepRequest {
    pub(super) event: Event,
    /// A run before has answered it, and this one goes on with it.
    pub(super) is_continued: bool,
}

impl KeepRequests {
    /// Those of a configuration that no run has answered yet; `folder` is that of the captures. In a folder that has not been used, a
    /// request whose frames have passed asks for nothing.
    pub(super) fn of(config: &Config, folder: &Path, now_ns: u64) -> Self {
        let path = config.rul().events.as_ref().map(|path| config.resolve(path));
        let mut requests = Self {
            path,
            answered: folder.join(ANSWERED),
            ..Self::default()
        };
        let after_ns = (config.output().capture_after_s * 1e9) as u64;
        let has_passed = |t_ns: u64| t_ns.saturating_add(after_ns) < now_ns;
        if let (true, Ok(answered)) = (requests.answered.exists(), event_file::read(&requests.answered)) {
            let answered = answered.list.into_iter().map(|event| (event.t_ns, event.actuator));
            (requests.known, requests.continued) = answered.partition(|(t_ns, _)| has_passed(*t_ns));
        } else {
            let passed: Vec<_> = requests
                .take_new()
                .into_iter()
                .filter(|of| has_passed(of.event.t_ns))
                .collect();
            requests.known = passed.iter().map(|of| key(&of.event)).collect();
            requests.read = None;
            // Whatever else fails, the file says from here on that the folder has been used.
            let _ = event_file::append_all(&requests.answered, passed.iter().map(|of| &of.event));
        }
        requests
    }

    /// Requests since the last call. A file that cannot be read asks for nothing; it is reported with the next window.
    pub(super) fn take_new(&mut self) -> Vec<KeepRequest> {
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
        let (known, continued) = (&mut self.known, &self.continued);
        let keeps = events.list.into_iter().filter(is_keep);
        let new = keeps.filter(|event| known.insert(key(event)));
        new.map(|event| KeepRequest {
            is_continued: continued.contains(&key(&event)),
            event,
        })
        .collect()
    }

    /// Remembers for the next run that requests were answered. Where that cannot be written, the next one answers again.
    pub(super) fn note_answered(&self, requests: &[KeepRequest]) {
        let mut new = requests.iter().filter(|request| !request.is_continued).peekable();
        if new.peek().is_some() && self.answered.exists() {
            let _ = event_file::append_all(&self.answered, new.map(|request| &request.event));
        }
    }
}

/// What tells one request from another.
fn key(event: &Event) -> (u64, String) {
    (event.t_ns, event.actuator.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW_NS: u64 = 10_000_000_000;

    fn config(events: &Path) -> Config {
        let text = format!("[rul]\nevents = {events:?}\n[output]\ncapture_after_s = 2");
        Config::from_toml_str(&text, "test").unwrap()
    }

    fn event(t_ns: u64, event: EventKind) -> Event {
        Event {
            t_ns,
            actuator: "ema0".to_owned(),
            event,
            part: None,
            note: None,
        }
    }

    /// Times of the requests, and which of them go on, all of them answered.
    fn answered(requests: &mut KeepRequests) -> Vec<(u64, bool)> {
        let new = requests.take_new();
        requests.note_answered(&new);
        new.into_iter().map(|of| (of.event.t_ns, of.is_continued)).collect()
    }

    #[test]
    fn a_request_is_taken_once_and_those_whose_frames_had_passed_in_a_new_folder_never() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.jsonl");
        let config = config(&path);
        for t_ns in [1, NOW_NS - 2_000_000_001, NOW_NS - 2_000_000_000, NOW_NS + 1] {
            event_file::append(&path, &event(t_ns, EventKind::Keep)).unwrap();
        }
        let mut requests = KeepRequests::of(&config, folder.path(), NOW_NS);
        let to_come = [NOW_NS - 2_000_000_000, NOW_NS + 1];
        assert_eq!(answered(&mut requests), to_come.map(|t_ns| (t_ns, false)));
        event_file::append(&path, &event(2, EventKind::Reset)).unwrap();
        event_file::append(&path, &event(3, EventKind::Keep)).unwrap();
        assert_eq!(answered(&mut requests), [(3, false)]);
        assert_eq!(answered(&mut requests), []);
        std::fs::write(&path, "no event").unwrap();
        assert_eq!(answered(&mut requests), []);
    }

    #[test]
    fn a_request_that_no_run_has_answered_is_taken_by_the_next_and_one_that_goes_on_is_known() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.jsonl");
        let config = config(&path);
        // The run begins without any request.
        let mut requests = KeepRequests::of(&config, folder.path(), NOW_NS);
        assert_eq!(answered(&mut requests), []);
        for t_ns in [NOW_NS + 1, NOW_NS + 8_000_000_000] {
            event_file::append(&path, &event(t_ns, EventKind::Keep)).unwrap();
        }
        assert_eq!(answered(&mut requests).len(), 2);
        // It is killed before it sees this one.
        event_file::append(&path, &event(NOW_NS + 2, EventKind::Keep)).unwrap();
        let mut requests = KeepRequests::of(&config, folder.path(), NOW_NS + 9_000_000_000);
        assert_eq!(
            answered(&mut requests),
            [(NOW_NS + 2, false), (NOW_NS + 8_000_000_000, true)]
        );
        let mut requests = KeepRequests::of(&config, folder.path(), NOW_NS + 20_000_000_000);
        assert_eq!(answered(&mut requests), []);
    }
}
