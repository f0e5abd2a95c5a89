//! What a live run decided by time, or what its end has decided: replay must decide the same.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use prost::Message;

use super::held_events::HeldEvents;
use super::recorded_units::RecordedUnits;
use hmd_core::metadata_checksum::is_sealed;
use hmd_core::record::{Assessed, Dropped, Ended, Health, RawBatch, Record, Shortened};
use hmd_storage::mcap::{McapMessage, McapMessages};
use hmd_storage::mcap_writer::METADATA_NAME;
use hmd_storage::recorder::{ASSESSED_KEY, ASSESSED_MARKED};
use hmd_storage::segment_store::current_path;

/// A window: its actuator, and its start, UTC ns.
type WindowKey = (String, u64);

/// Topics of what is looked for end like this.
const TOPICS: [&str; 5] = ["/dropped", "/shortened", "/assessed", "/ended", "/health"];

/// What live runs decided, out of the logs that they wrote.
#[derive(Debug, Default)]
pub(super) struct LiveDecisions {
    pub(super) dropped: BTreeSet<WindowKey>,
    pub(super) shortened: BTreeMap<WindowKey, Shortened>,
    /// The runs that marked what they assessed, and were of this configuration: others have other windows.
    runs: BTreeMap<String, MarkedRun>,
    /// Which of them each log is of.
    of_logs: Vec<Option<String>>,
    current: Option<String>,
    /// By what each window was assessed, where the run learnt its unit.
    pub(super) units: RecordedUnits,
    /// Maintenance events that it followed after its clock was set back.
    pub(super) held_events: HeldEvents,
}

/// A run that marked the windows it assessed.
#[derive(Debug, Default)]
struct MarkedRun {
    /// The last that was assessed, until the replay has met it.
    last: Option<WindowKey>,
    /// It came to its end and counted the time of operation up to there.
    is_ended: bool,
}

impl LiveDecisions {
    /// They must be known before their windows are met, and a run records them only later. A log that cannot be read has none; it is
    /// reported when it is replayed.
    pub(super) fn of(logs: &[PathBuf], config_hash: &str) -> Self {
        let mut found = Self::default();
        for log in logs {
            found.units.add_log(log.display().to_string());
            found.held_events.add_log();
            let run = found.read(log, config_hash).unwrap_or_default();
            found.of_logs.push(run);
        }
        found
    }

    /// Reads one log; the run that it is of, if that marked its windows.
    fn read(&mut self, log: &Path, config_hash: &str) -> Option<Option<String>> {
        let log = current_path(log);
        // Nothing else than a regular file can be read twice.
        if !log.metadata().is_ok_and(|of| of.is_file()) {
            return None;
        }
        let file = File::open(&log).ok()?;
        let mut messages = McapMessages::new(BufReader::new(file), &log.display().to_string()).ok()?;
        let topics = messages.topics();
        // The metadata stand before the first message.
        let first = messages.by_ref().flatten().next();
        let metadata = messages.metadata(METADATA_NAME);
        let has = |key: &str| metadata.is_some_and(|found| found.contains_key(key));
        let is_segment = has("run");
        let of_run = metadata.and_then(|found| found.get("run"));
        self.units.set_run(of_run, has("capture"));
        let mut run = marked_run(&messages, &log, config_hash);
        if let Some(run) = &run {
            self.runs.entry(run.clone()).or_default();
        }
        let dropped = self.dropped.len();
        let is_wanted = |topic: &String| TOPICS.iter().any(|end| topic.ends_with(end));
        if topics.is_empty() || topics.iter().any(is_wanted) {
            for message in first.into_iter().chain(messages.flatten()) {
                self.take(&message, run.as_deref());
            }
        }
        // Whoever took the records out of a file left the frames to be assessed; a folder has them in segments of their own.
        let is_bare = |run: &mut String| !is_segment && self.runs[run].last.is_none() && self.dropped.len() == dropped;
        if let Some(bare) = run.take_if(is_bare) {
            self.runs.remove(&bare);
        }
        Some(run)
    }

    fn take(&mut self, message: &McapMessage, run: Option<&str>) {
        let data = message.data.as_slice();
        let mut assessed = None;
        match &*message.schema {
            Dropped::SCHEMA_NAME => {
                let window = key(data, |record: Dropped| (record.actuator, record.t_start_ns));
                self.dropped.extend(window);
            }
            RawBatch::SCHEMA_NAME => self.held_events.add_frames(message.log_time_ns),
            Shortened::SCHEMA_NAME => {
                let decoded = Shortened::decode(data);
                self.shortened
                    .extend(decoded.map(|record| ((record.actuator.clone(), record.t_start_ns), record)));
            }
            Assessed::SCHEMA_NAME => {
                if let Ok(mark) = Assessed::decode(data) {
                    self.units.add(&mark);
                    self.held_events.add(&mark);
                    assessed = Some((mark.actuator, mark.t_start_ns));
                }
            }
            Health::SCHEMA_NAME => assessed = key(data, |record: Health| (record.actuator, record.t_start_ns)),
            _ => {}
        }
        if let Some(run) = run.and_then(|run| self.runs.get_mut(run)) {
            run.last = assessed.or_else(|| run.last.take());
            run.is_ended |= *message.schema == *Ended::SCHEMA_NAME;
        }
    }

    /// The windows that come are of this log.
    pub(super) fn begin_log(&mut self, number: usize) {
        self.current = self.of_logs.get(number).cloned().flatten();
    }

    /// Whether the run of the log decided on this window. A run that came to its end decided on all of them. Else windows are assessed in the
    /// order in which they end: behind the last one that was marked as assessed, it has dropped some at most.
    pub(super) fn was_decided(&mut self, window: &WindowKey) -> bool {
        let is_dropped = self.dropped.contains(window);
        self.current_run().is_none_or(|run| {
            let is_before_end = run.is_ended || run.last.is_some();
            run.last.take_if(|last| last == window);
            is_before_end || is_dropped
        })
    }

    /// Whether the run of the log was killed, or is under way, so that its time of operation counts to its last window alone.
    pub(super) fn did_not_end(&mut self) -> bool {
        self.current_run().is_some_and(|run| !run.is_ended)
    }

    fn current_run(&mut self) -> Option<&mut MarkedRun> {
        self.runs.get_mut(self.current.as_ref()?)
    }
}

/// The window of a record, where that can be read.
fn key<R: Message + Default>(data: &[u8], of: fn(R) -> WindowKey) -> Option<WindowKey> {
    R::decode(data).ok().map(of)
}

/// The run of a log, if it marks its windows and has this configuration; a file is a run of its own, a capture none.
fn marked_run(messages: &McapMessages<BufReader<File>>, log: &Path, config_hash: &str) -> Option<String> {
    let metadata = messages
        .metadata(METADATA_NAME)
        .filter(|found| is_sealed(METADATA_NAME, found))?;
    let has = |key: &str, value: &str| metadata.get(key).is_some_and(|found| found == value);
    if !has(ASSESSED_KEY, ASSESSED_MARKED) || !has("config_hash", config_hash) || metadata.contains_key("capture") {
        return None;
    }
    let of_file = || log.display().to_string();
    Some(metadata.get("run").cloned().unwrap_or_else(of_file))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn behind_the_last_window_that_was_assessed_only_dropped_ones_are_met() {
        let window = |n: u64| ("ema0".to_owned(), n);
        // The frames of window 1 were deleted for room; 4 was assessed when 5 was dropped, and the process was killed over 6.
        let mut live = LiveDecisions {
            dropped: [2, 5].map(window).into(),
            current: Some("run".to_owned()),
            ..LiveDecisions::default()
        };
        let marked = MarkedRun {
            last: Some(window(4)),
            is_ended: false,
        };
        live.runs.insert("run".to_owned(), marked);
        let met: Vec<u64> = (2..9).filter(|n| live.was_decided(&window(*n))).collect();
        assert_eq!(met, [2, 3, 4, 5], "3 has lost its mark alone");
        let ended = MarkedRun {
            last: None,
            is_ended: true,
        };
        live.runs.insert("run".to_owned(), ended);
        assert!(
            live.was_decided(&window(6)),
            "a window that a run forgets at its end is missed in its records"
        );
        let killed_at_once = LiveDecisions {
            runs: [("run".to_owned(), MarkedRun::default())].into(),
            current: Some("run".to_owned()),
            ..LiveDecisions::default()
        };
        assert!(!{ killed_at_once }.was_decided(&window(0)));
    }
}
