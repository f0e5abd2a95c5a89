//! Setpoints that last one sample only.
//!
//! A flipped bit in a command would open a window without an actuation, or end one. No command lasts one sample, so a
//! sample is released when the next one is known, and its setpoint is replaced by the one before if it is the odd one out.

use super::TimedSample;
use super::ring::Slot;
use super::trigger::{Thresholds, same_mode, value};
use super::verdict::{Defect, Part};
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
            let seq = seq as u64;
            let sensed = SensedSample {
                seq,
                currents: [0.0; 3],
                motor_counts: 0,
                output_counts: 0,
                setpoint,
            };
            slots.extend(deglitch.push(TimedSample {
                seq,
                stamp_ns: 0,
                sensed,
            }));
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
}
