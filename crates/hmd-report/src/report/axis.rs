//! One continuous axis of use for a history, and the marks where something other than wear changed it.

use hmd_core::history::ReplacedPart;

use super::history::{History, Point, is_elapsed};

/// What changed the history before a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mark {
    /// The unit was replaced or overhauled, by a maintenance event or by its serial number.
    Unit,
    /// A recording that knew nothing of the one before.
    Reset,
    /// A part was replaced, by a maintenance event; the rest of the unit goes on.
    Replaced(ReplacedPart),
    /// The program was started again and continued the history.
    Restart,
}

impl Mark {
    /// Name for people.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Unit => "actuator replaced",
            Self::Reset => "recording without the history before it",
            Self::Replaced(ReplacedPart::Motor) => "motor replaced",
            Self::Replaced(ReplacedPart::Gearbox) => "gearbox replaced",
            Self::Replaced(ReplacedPart::Controller) => "controller replaced",
            Self::Restart => "program restarted",
        }
    }

    /// Class of the line in the page's style.
    pub(super) const fn class(self) -> &'static str {
        match self {
            Self::Unit | Self::Reset => "reset",
            Self::Replaced(_) => "replaced",
            Self::Restart => "restart",
        }
    }
}

/// Where each window lies on the axis, and the marks between them.
pub(super) struct UseAxis {
    /// Label of the axis.
    pub(super) label: &'static str,
    /// One place per window of the history; never decreasing.
    pub(super) places: Vec<f64>,
    /// Marks, each with the index of the window before which it lies.
    pub(super) marks: Vec<(usize, Mark)>,
}

impl UseAxis {
    /// Hours, added up over resets; or the count of windows where the hours are not known, below one, or of two kinds.
    pub(super) fn new(history: &History) -> Self {
        let hours = continuous_hours(history);
        let kinds = history.points.windows(2);
        let is_of_one_kind = kinds.into_iter().all(|pair| pair[0].is_elapsed == pair[1].is_elapsed);
        let (label, places) = if is_of_one_kind && hours.last().is_some_and(|last| *last >= 1.0) {
            let label = if is_elapsed(&history.newest.rul) {
                "elapsed time, h"
            } else {
                "operating time, h"
            };
            (label, hours)
        } else {
            ("window", (0..history.points.len()).map(|n| n as f64).collect())
        };
        let marks = (1..history.points.len())
            .flat_map(|n| marks_before(history, n).into_iter().map(move |mark| (n, mark)))
            .collect();
        Self { label, places, marks }
    }
}

/// Hours of use since the first window. After a reset the count of the records begins again; the axis goes on, where the hours are those of
/// the clock by the time between the two windows.
pub(super) fn continuous_hours(history: &History) -> Vec<f64> {
    let (mut base, mut last) = (0.0, 0.0);
    let mut before: Option<&Point> = None;
    history
        .points
        .iter()
        .map(|point| {
            let used = point.used_h.unwrap_or(last);
            if used < last {
                let pause = before.map_or(0.0, |before| pause_h(before, point) - used);
                base += last + pause.max(0.0);
            }
            (last, before) = (used, Some(point));
            base + used
        })
        .collect()
}

/// Hours that count between two windows of recordings that know nothing of each other.
fn pause_h(before: &Point, after: &Point) -> f64 {
    if before.is_elapsed && after.is_elapsed {
        after.t_start_ns.saturating_sub(before.t_start_ns) as f64 / 3.6e12
    } else {
        0.0
    }
}

/// What lies between window `n` and the one before.
pub(super) fn marks_before(history: &History, n: usize) -> Vec<Mark> {
    let [before, after] = [&history.points[n - 1], &history.points[n]];
    let began_again = matches!((before.used_h, after.used_h), (Some(before), Some(after)) if after < before);
    if after.replaced.contains(&None) {
        return vec![Mark::Unit];
    }
    let begun = match began_again {
        true => Some(Mark::Reset),
        false => (after.window <= before.window).then_some(Mark::Restart),
    };
    let parts = after.replaced.iter().flatten().copied().map(Mark::Replaced);
    begun.into_iter().chain(parts).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn history(windows: &[(u64, f64)]) -> History {
        let points = windows.iter().map(|&(window, used_h)| Point {
            window,
            used_h: Some(used_h),
            ..Point::default()
        });
        History {
            points: points.collect(),
            ..History::default()
        }
    }

    #[test]
    fn hours_go_on_over_a_reset_and_a_restart() {
        let axis = UseAxis::new(&history(&[
            (0, 0.0),
            (1, 10.0),
            (0, 11.0),
            (1, 12.0),
            (2, 0.5),
            (3, 2.0),
        ]));
        assert_eq!(axis.places, [0.0, 10.0, 11.0, 12.0, 12.5, 14.0]);
        assert_eq!(axis.marks, [(2, Mark::Restart), (4, Mark::Reset)]);
        assert_eq!(axis.label, "operating time, h");
    }

    #[test]
    fn hours_of_the_clock_go_on_between_recordings() {
        let mut history = history(&[(0, 0.0), (1, 10.0), (0, 0.0), (1, 2.0)]);
        for (point, hours) in history.points.iter_mut().zip([0, 10, 34, 36]) {
            (point.is_elapsed, point.t_start_ns) = (true, hours * 3_600_000_000_000);
        }
        assert_eq!(UseAxis::new(&history).places, [0.0, 10.0, 34.0, 36.0]);
    }

    #[test]
    fn replaced_parts_are_marks_and_a_replaced_unit_is_a_reset() {
        let mut history = history(&[(0, 1.0), (1, 2.0), (2, 3.0)]);
        let parts = [ReplacedPart::Motor, ReplacedPart::Gearbox];
        history.points[1].replaced = parts.map(Some).to_vec();
        history.points[2].replaced = vec![None];
        let [motor, gearbox] = parts.map(Mark::Replaced);
        let axis = UseAxis::new(&history);
        assert_eq!(axis.marks, [(1, motor), (1, gearbox), (2, Mark::Unit)]);
        assert_eq!(axis.places, [1.0, 2.0, 3.0], "use goes on");
        // Before a recording that knew nothing of the one before.
        history.points[1].used_h = Some(0.0);
        let marks = [(1, Mark::Reset), (1, motor), (1, gearbox), (2, Mark::Unit)];
        assert_eq!(UseAxis::new(&history).marks, marks);
        // Hours of operation and of the clock have no axis in common.
        history.points[2].is_elapsed = true;
        assert_eq!(UseAxis::new(&history).label, "window");
    }

    #[test]
    fn windows_count_on_where_hours_do_not() {
        let axis = UseAxis::new(&history(&[(0, 0.0), (1, 0.1), (0, 0.2)]));
        assert_eq!((axis.label, axis.places), ("window", vec![0.0, 1.0, 2.0]));
        assert_eq!(axis.marks, [(2, Mark::Restart)]);
    }
}
