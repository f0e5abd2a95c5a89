//! How much of an actuator's time the logs of a replay hold: hours of operation count what was recorded alone.

use std::collections::BTreeMap;

use hmd_core::config::HoursOf;
use hmd_core::record::Rul;

/// Hours between the first and the last window from which on a gap is worth a word.
const ELAPSED_MIN_H: f64 = 1.0;

/// Share of them that logs of an actuator which works all the time hold at least.
const SHARE_MIN: f64 = 0.05;

/// Use of each actuator so far, by the windows of the logs.
#[derive(Debug, Default)]
pub(crate) struct RecordedUse(BTreeMap<String, Recorded>);

#[derive(Clone, Copy, Debug)]
struct Recorded {
    first_ns: u64,
    last_ns: u64,
    operating_h: f64,
}

impl RecordedUse {
    /// Takes the record of a window.
    pub(crate) fn add(&mut self, rul: &Rul) {
        let (true, Some(operating_h)) = (rul.hours_of == HoursOf::Operating.name(), rul.operating_h) else {
            return;
        };
        let new = || Recorded {
            first_ns: rul.t_start_ns,
            last_ns: 0,
            operating_h: 0.0,
        };
        let recorded = self.0.entry(rul.actuator.clone()).or_insert_with(new);
        recorded.last_ns = rul.t_start_ns;
        recorded.operating_h = operating_h;
    }

    /// What an operator should know of actuators whose logs leave most of their time out.
    pub(crate) fn notices(&self) -> impl Iterator<Item = String> {
        self.0.iter().filter_map(|(actuator, recorded)| {
            let elapsed_h = recorded.last_ns.saturating_sub(recorded.first_ns) as f64 / 3600e9;
            let is_most_left_out = elapsed_h >= ELAPSED_MIN_H && recorded.operating_h < SHARE_MIN * elapsed_h;
            is_most_left_out.then(|| {
                format!(
                    "{actuator}: the logs hold {:.3} h of operation within {elapsed_h:.0} h, and the remaining life is in hours of \
                     operation: where it works between the logs too, set hours = \"elapsed\" in [rul]",
                    recorded.operating_h
                )
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn notices(windows: &[(u64, f64)], hours_of: &str) -> usize {
        let mut recorded = RecordedUse::default();
        for (hours, operating_h) in windows {
            let rul = Rul {
                actuator: "ema0".to_owned(),
                t_start_ns: hours * 3_600_000_000_000,
                operating_h: Some(*operating_h),
                hours_of: hours_of.to_owned(),
                ..Rul::default()
            };
            recorded.add(&rul);
        }
        recorded.notices().count()
    }

    #[test]
    fn logs_a_day_apart_are_told_from_one_of_many_hours() {
        let days = [(0, 0.01), (24, 0.02), (48, 0.03)];
        assert_eq!(notices(&days, "operating"), 1);
        assert_eq!(notices(&days, "elapsed"), 0);
        assert_eq!(notices(&[(0, 0.01), (10, 9.0)], "operating"), 0);
        assert_eq!(notices(&[(0, 0.01)], "operating"), 0);
    }
}
