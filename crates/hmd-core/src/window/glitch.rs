//! Setpoints that last one sample only.
//!
//! A flipped bit in a command would open a window without an actuation, or end one. No command lasts one sample, so a
//! sample is released when the next one is known, and its setpoint is replaced by the one before if it is the odd one out.

use super::TimedSample;
use super::quality::{Defect, Part};
use super::ring::Slot;
use super::trigger::{Thresholds, same_mode, value};
use ema_models::Setpoint;

/// Holds one sample back until the next is known.
#[derive(Clone, Debug)]
pub(super) struct Deglitch {
    thresholds: Thresholds,
    /// Neighbours further away than this many missing samples are no witnesses.
    reach: u64,
    before: Option<(u64, Setpoint)>,
    pending: Option<TimedSample>,
}

impl Deglitch {
    pub(super) fn new(thresholds: Thresholds, reach: u64) -> Self {
        Self {
            thresholds,
            reach,
            before: None,
            pending: None,
        }
    }

    /// Takes the next sample, of a higher number, and releases the one before.
    pub(super) fn push(&mut self, next: TimedSample) -> Option<Slot> {
        let pending = self.pending.replace(next)?;
        Some(self.release(&pending, Some(&next)))
    }

    /// Releases the last sample and forgets what was.
    pub(super) fn flush(&mut self) -> Option<Slot> {
        let pending = self.pending.take();
        let slot = pending.map(|pending| self.release(&pending, None));
        self.before = None;
        slot
    }

    fn release(&mut self, sample: &TimedSample, next: Option<&TimedSample>) -> Slot {
        let mut slot = Slot::received(sample);
        let setpoint = sample.sensed.setpoint;
        if self.is_glitch(sample, next) {
            slot.sample.setpoint = self.before.map_or(Setpoint::Idle, |(_, before)| before);
            slot.refuse(Part::Setpoint, Defect::CommandGlitch);
        } else {
            self.before = Some((sample.seq, setpoint));
        }
        slot
    }

    fn is_glitch(&self, sample: &TimedSample, next: Option<&TimedSample>) -> bool {
        let now = sample.sensed.setpoint;
        if !value(now).is_finite() {
            return true;
        }
        let (Some((seq_before, before)), Some(next)) = (self.before, next) else {
            return false;
        };
        let after = next.sensed.setpoint;
        let span = next.seq - seq_before;
        if span > 2 * (self.reach + 1) || !same_mode(before, after) {
            return false;
        }
        if !same_mode(now, before) {
            return true;
        }
        let (from_before, from_after) = (value(now) - value(before), value(now) - value(after));
        from_before * from_after > 0.0 && self.thresholds.differ(now, before) && self.thresholds.differ(now, after)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::window::WindowConfig;
    use ema_models::SensedSample;

    fn released(setpoints: &[Setpoint]) -> Vec<(Setpoint, bool)> {
        let mut deglitch = Deglitch::new(Thresholds::new(&WindowConfig::default()), 2);
        let mut slots: Vec<Slot> = Vec::new();
        for (seq, &setpoint) in setpoints.iter().enumerate() {
            slots.extend(deglitch.push(timed(seq as u64, setpoint)));
        }
        slots.extend(deglitch.flush());
        slots
            .iter()
            .map(|slot| (slot.sample.setpoint, slot.is_command_glitch()))
            .collect()
    }

    #[test]
    fn one_odd_setpoint_or_mode_is_replaced() {
        use Setpoint::{Idle, Position, Speed};
        for odd in [Position(1.048_576), Position(f64::NAN), Idle, Speed(0.0)] {
            let expected = [(Position(0.0), false), (Position(0.0), true), (Position(0.0), false)];
            assert_eq!(released(&[Position(0.0), odd, Position(0.0)]), expected, "{odd:?}");
        }
    }

    #[test]
    fn steps_ramps_and_changes_of_mode_pass() {
        use Setpoint::{Idle, Position, Speed};
        for genuine in [
            [Position(0.0), Position(0.25), Position(0.25), Position(0.25)],
            [Position(0.0), Position(0.1), Position(0.2), Position(0.3)],
            [Position(0.0), Position(0.0), Speed(9.0), Speed(9.0)],
            [Position(0.0), Idle, Idle, Position(0.0)],
        ] {
            assert_eq!(released(&genuine), genuine.map(|setpoint| (setpoint, false)));
        }
    }

    fn timed(seq: u64, setpoint: Setpoint) -> TimedSample {
        let sensed = SensedSample {
            seq,
            currents: [0.0; 3],
            motor_counts: 0,
            output_counts: 0,
            setpoint,
        };
        TimedSample {
            seq,
            stamp_ns: 0,
            sensed,
        }
    }

    #[test]
    fn a_setpoint_is_odd_when_it_is_beyond_the_threshold_from_both_neighbours_on_one_side() {
        use Setpoint::{Position, Speed};
        let is_odd = |three: [f64; 3], mode: fn(f64) -> Setpoint| released(&three.map(mode))[1].1;
        for sign in [1.0, -1.0] {
            for (three, expected) in [
                ([0.0, 1.1e-3, 0.0], true),
                ([0.0, 1.0e-3, 0.0], false),
                ([0.0, 1.1e-3, 0.2e-3], false),
                ([0.2e-3, 1.1e-3, 0.0], false),
                ([0.0, 5.0e-3, 2.0e-3], true),
                ([2.0e-3, 5.0e-3, 0.0], true),
                ([0.0, 5.0e-3, 9.0e-3], false),
            ] {
                // Wherever the setpoint rests.
                for rest in [0.0, 0.5] {
                    let three = three.map(|x| rest + sign * x);
                    assert_eq!(is_odd(three, Position), expected, "{three:?}");
                }
                assert_eq!(
                    is_odd(three.map(|x| sign * 1e3 * x), Speed),
                    expected,
                    "{three:?}, speed"
                );
            }
        }
    }

    #[test]
    fn neighbours_behind_longer_gaps_than_the_reach_are_no_witnesses() {
        // Two samples may be missing on each side.
        for (before, after, expected) in [(3, 3, true), (1, 5, true), (3, 4, false), (6, 1, false)] {
            let mut deglitch = Deglitch::new(Thresholds::new(&WindowConfig::default()), 2);
            let samples = [(100, 0.0), (100 + before, 1.0), (100 + before + after, 0.0)];
            let slots = samples.map(|(seq, angle)| deglitch.push(timed(seq, Setpoint::Position(angle))));
            let odd = slots[2].map(|slot| slot.is_command_glitch());
            assert_eq!(odd, Some(expected), "{before} before, {after} after");
        }
    }

    #[test]
    fn each_sample_waits_for_the_next_and_the_last_for_the_end() {
        let mut deglitch = Deglitch::new(Thresholds::new(&WindowConfig::default()), 2);
        assert_eq!(deglitch.push(timed(0, Setpoint::Position(0.0))), None);
        let first = deglitch.push(timed(1, Setpoint::Position(1.0)));
        assert_eq!(first.map(|slot| slot.sample.seq), Some(0));
        let last = deglitch.flush().expect("one waits");
        assert_eq!((last.sample.seq, last.is_command_glitch()), (1, false));
        assert_eq!(deglitch.flush(), None);
        // What came before the end is no witness against what comes after it.
        deglitch.push(timed(2, Setpoint::Position(0.0)));
        let first = deglitch.push(timed(3, Setpoint::Position(1.0))).expect("released");
        assert!(!first.is_command_glitch());
    }
}
