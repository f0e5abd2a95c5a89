//! By what each window was assessed when it was recorded, where its run learnt the unit.
//!
//! A run marks every window ([`UnitMark`]). Kept is where the mark changes, not each window: a recording of months has a few changes.

use std::collections::BTreeMap;

use hmd_core::record::{Assessed, UnitMark};

/// The marks of all logs.
#[derive(Debug, Default)]
pub(super) struct RecordedUnits {
    /// The run of each log, and whether the log is a capture.
    logs: Vec<(String, bool)>,
    /// Of each run the actuators with marks.
    runs: BTreeMap<String, BTreeMap<String, Spans>>,
    current: usize,
}

/// The windows of one actuator in a run, in the order in which they were assessed.
#[derive(Debug, Default)]
struct Spans {
    spans: Vec<Span>,
    /// The one that the replay has come to; `None` before its first window.
    at: Option<usize>,
    /// The replay has met its last window.
    is_over: bool,
}

/// Windows in a row with the same mark.
#[derive(Debug)]
struct Span {
    unit: UnitMark,
    /// Starts of the earliest and the latest by the clock, which may have stepped, UTC ns.
    times_ns: (u64, u64),
    /// Start of the one that was assessed last, UTC ns.
    last_ns: u64,
}

/// By what the run of a log assessed a window.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct RecordedUnit {
    pub(super) unit: UnitMark,
    /// It is the first of its actuator that the replay meets of this run.
    pub(super) is_first: bool,
}

impl RecordedUnits {
    /// The marks that come are of this log, the next one.
    pub(super) fn add_log(&mut self, name: String) {
        self.logs.push((name, false));
    }

    /// The log is of this run, which may have others.
    pub(super) fn set_run(&mut self, run: Option<&String>, is_capture: bool) {
        if let Some(log) = self.logs.last_mut() {
            if let Some(run) = run {
                log.0.clone_from(run);
            }
            log.1 = is_capture;
        }
    }

    /// Takes the mark of a window.
    pub(super) fn add(&mut self, mark: &Assessed) {
        let unit = UnitMark::from_text(&mark.unit);
        if let (Some((run, _)), true) = (self.logs.last(), unit != UnitMark::Untold) {
            let actuators = self.runs.entry(run.clone()).or_default();
            let spans = actuators.entry(mark.actuator.clone()).or_default();
            spans.add(unit, mark.t_start_ns);
        }
    }

    /// The windows that come are of this log.
    pub(super) fn begin_log(&mut self, number: usize) {
        self.current = number;
    }

    /// Whether the log is a capture, which lacks windows of its run.
    pub(super) fn is_capture(&self) -> bool {
        self.logs.get(self.current).is_some_and(|(_, is_capture)| *is_capture)
    }

    /// By what the run of the log assessed the next window of an actuator, which begins at a time, UTC ns. Of one without a mark of its own,
    /// as at the begin of a capture, it is that of its neighbours.
    pub(super) fn next(&mut self, actuator: &str, t_ns: u64) -> RecordedUnit {
        let run = self.logs.get(self.current).and_then(|(run, _)| self.runs.get_mut(run));
        match run.and_then(|actuators| actuators.get_mut(actuator)) {
            Some(spans) => spans.next(t_ns),
            None => RecordedUnit {
                unit: UnitMark::Untold,
                is_first: false,
            },
        }
    }
}

impl Spans {
    fn add(&mut self, unit: UnitMark, t_ns: u64) {
        match self.spans.last_mut().filter(|last| last.unit == unit) {
            Some(last) => {
                last.times_ns = (last.times_ns.0.min(t_ns), last.times_ns.1.max(t_ns));
                last.last_ns = t_ns;
            }
            None => self.spans.push(Span {
                unit,
                times_ns: (t_ns, t_ns),
                last_ns: t_ns,
            }),
        }
    }

    fn next(&mut self, t_ns: u64) -> RecordedUnit {
        let is_first = self.at.is_none();
        let last = self.spans.len().saturating_sub(1);
        let from = (self.at.unwrap_or(0) + usize::from(self.is_over)).min(last);
        let holds = |span: &Span| span.times_ns.0 <= t_ns && t_ns <= span.times_ns.1;
        let found = self.spans.iter().skip(from).position(holds);
        let at = found.map_or(from, |found| from + found);
        self.at = Some(at);
        self.is_over = self.spans.get(at).is_some_and(|span| span.last_ns == t_ns);
        let unit = self.spans.get(at).map_or(UnitMark::Untold, |span| span.unit.clone());
        RecordedUnit { unit, is_first }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recorded(marks: &[(u64, &str)]) -> RecordedUnits {
        let mut found = RecordedUnits::default();
        found.add_log("run".to_owned());
        for &(t_start_ns, unit) in marks {
            found.add(&Assessed {
                actuator: "ema0".to_owned(),
                t_start_ns,
                unit: unit.to_owned(),
                ..Assessed::default()
            });
        }
        found
    }

    fn units(of: &mut RecordedUnits, times_ns: &[u64]) -> Vec<String> {
        let unit = |t_ns: &u64| of.next("ema0", *t_ns).unit.to_text().to_owned();
        times_ns.iter().map(unit).collect()
    }

    #[test]
    fn a_window_without_a_mark_is_as_its_neighbours() {
        let marks = [(3, "learning"), (5, "a"), (7, "a"), (9, "learning"), (11, "b")];
        let mut all = recorded(&marks);
        assert_eq!(
            units(&mut all, &[1, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]),
            [
                "learning", "learning", "a", "a", "a", "a", "learning", "learning", "b", "b", "b"
            ]
        );
        let mut without_some = recorded(&marks);
        assert_eq!(units(&mut without_some, &[6, 9, 10, 12]), ["a", "learning", "b", "b"]);
        let first: Vec<bool> = [1, 3].map(|t_ns| recorded(&marks).next("ema0", t_ns).is_first).into();
        assert_eq!(first, [true, true]);
        assert_eq!(units(&mut recorded(&[]), &[1]), [""]);
    }

    #[test]
    fn a_clock_that_steps_back_mixes_no_marks() {
        // Ahead by 100 until the middle of the windows by "a".
        let marks = [(101, "learning"), (103, "a"), (5, "a"), (7, "learning"), (9, "b")];
        let times: Vec<u64> = marks.iter().map(|(t_ns, _)| *t_ns).collect();
        let expected: Vec<&str> = marks.iter().map(|(_, unit)| *unit).collect();
        assert_eq!(units(&mut recorded(&marks), &times), expected);
    }
}
