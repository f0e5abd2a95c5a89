//! Maintenance events that a run followed after its clock was set back.
//!
//! An event counts from its time on. A clock that was ahead gives windows of before an event later stamps than the event has; its run
//! marked the window with which it followed the event, and the event is held until then.

use std::collections::BTreeMap;

use hmd_core::history::Events;
use hmd_core::record::Assessed;

/// The events of all runs that are to be held.
#[derive(Debug, Default)]
pub(super) struct HeldEvents {
    held: Vec<HeldEvent>,
    /// Logs so far.
    logs: usize,
    /// Latest start of a window of each actuator so far, UTC ns.
    latest_ns: BTreeMap<String, u64>,
    /// Stamp of the frames that came last, UTC ns.
    frames_ns: u64,
}

/// Frames are stamped by their first up to so much before the record that follows them, ns.
const BATCH_NS: u64 = 1_000_000_000;

#[derive(Debug)]
struct HeldEvent {
    actuator: String,
    event_ns: u64,
    /// The window with which its run followed it: the log, and its start, UTC ns.
    log: usize,
    window_ns: u64,
}

impl HeldEvents {
    /// The marks that come are of the next log.
    pub(super) fn add_log(&mut self) {
        self.logs += 1;
    }

    /// The frames that come are stamped so, UTC ns.
    pub(super) fn add_frames(&mut self, stamp_ns: u64) {
        self.frames_ns = stamp_ns;
    }

    /// Takes the mark of a window.
    pub(super) fn add(&mut self, mark: &Assessed) {
        let window_ns = mark.t_start_ns;
        let latest_ns = self.latest_ns.entry(mark.actuator.clone()).or_default();
        // The windows wait for their assessment: by the frames that came meanwhile, the clock may have been set back since.
        let is_ahead = self.frames_ns.saturating_add(BATCH_NS) < window_ns;
        if window_ns < *latest_ns || is_ahead {
            let before_step = mark.events_ns.iter().filter(|event_ns| *event_ns <= latest_ns);
            self.held.extend(before_step.map(|&event_ns| HeldEvent {
                actuator: mark.actuator.clone(),
                event_ns,
                log: self.logs.saturating_sub(1),
                window_ns,
            }));
        }
        *latest_ns = window_ns.max(*latest_ns);
    }

    /// Whether an event was released now: the next window of an actuator begins at a time, UTC ns.
    pub(super) fn release_at(&mut self, actuator: &str, t_ns: u64) -> bool {
        self.release(|held| held.actuator == actuator && held.window_ns == t_ns)
    }

    /// Whether an event was released now: the windows that come are of this log, and those of the logs before are over.
    pub(super) fn release_before(&mut self, log: usize) -> bool {
        self.release(|held| held.log < log)
    }

    fn release(&mut self, is_over: impl Fn(&HeldEvent) -> bool) -> bool {
        let before = self.held.len();
        self.held.retain(|held| !is_over(held));
        self.held.len() < before
    }

    /// The events without those that are held.
    pub(super) fn without(&self, events: &Events) -> Events {
        let mut rest = events.clone();
        rest.list.retain(|event| {
            let is_held = |held: &HeldEvent| held.actuator == event.actuator && held.event_ns == event.t_ns;
            !self.held.iter().any(is_held)
        });
        rest
    }
}

#[cfg(test)]
mod tests {
    use hmd_core::history::{Event, EventKind};

    use super::*;

    fn mark(t_start_ns: u64, events_ns: &[u64]) -> Assessed {
        Assessed {
            actuator: "ema0".to_owned(),
            t_start_ns,
            events_ns: events_ns.to_vec(),
            ..Assessed::default()
        }
    }

    #[test]
    fn an_event_is_held_only_where_the_clock_was_set_back_before_it_was_followed() {
        let reset = |t_ns: u64| Event {
            t_ns,
            actuator: "ema0".to_owned(),
            event: EventKind::Reset,
            part: None,
            note: None,
        };
        let events = Events {
            list: vec![reset(15), reset(107)],
            ..Events::default()
        };
        let mut held = HeldEvents::default();
        held.add_log();
        // Dated back, of a clock that went right.
        for of in [mark(101, &[]), mark(105, &[]), mark(110, &[107])] {
            held.add(&of);
        }
        // Set back by 100, then the unit replaced.
        held.add(&mark(12, &[]));
        held.add(&mark(16, &[15]));
        let times = |held: &HeldEvents| held.without(&events).list.iter().map(|of| of.t_ns).collect::<Vec<_>>();
        assert_eq!(times(&held), [107]);
        assert!(!held.release_at("ema0", 12) && !held.release_at("ema1", 16) && !held.release_before(0));
        assert!(held.release_at("ema0", 16));
        assert_eq!(times(&held), [15, 107]);
        held.add(&mark(17, &[15]));
        assert!(held.release_before(1), "its window has gone");
        // Set back while the window waited.
        let second = 1_000_000_000;
        for (frames_s, is_held) in [(199, false), (20, true)] {
            held.add_frames(frames_s * second);
            held.add(&mark(200 * second, &[15]));
            assert_eq!(held.release_before(1), is_held, "{frames_s}");
        }
    }
}
