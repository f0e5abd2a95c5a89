//! When does an actuation begin?

use super::config::WindowConfig;
use super::ring::{Ring, Slot};
use ema_models::{SensedSample, Setpoint};

/// How far two setpoints of one mode may be apart to be the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Thresholds {
    position_rad: f64,
    speed_rad_s: f64,
}

impl Thresholds {
    pub(super) fn new(config: &WindowConfig) -> Self {
        // A millionth more, so that a difference of exactly the threshold is not lifted over it by rounding.
        Self {
            position_rad: config.trigger_position_rad * (1.0 + 1e-6),
            speed_rad_s: config.trigger_speed_rad_s * (1.0 + 1e-6),
        }
    }

    fn scaled(self, factor: f64) -> Self {
        Self {
            position_rad: self.position_rad * factor,
            speed_rad_s: self.speed_rad_s * factor,
        }
    }

    /// Threshold in the unit of a setpoint's mode.
    pub(super) fn jump_at(&self, setpoint: Setpoint) -> f64 {
        match setpoint {
            Setpoint::Idle => f64::INFINITY,
            Setpoint::Position(_) => self.position_rad,
            Setpoint::Speed(_) => self.speed_rad_s,
        }
    }

    /// Range of a setpoint that is held, in the unit of its mode; see [`Held`].
    pub(super) fn held(&self, setpoint: Setpoint) -> f64 {
        HELD_SHARE * self.jump_at(setpoint)
    }

    /// Whether two setpoints of the same mode are further apart than the threshold.
    pub(super) fn differ(&self, a: Setpoint, b: Setpoint) -> bool {
        (value(a) - value(b)).abs() > self.jump_at(a)
    }
}

/// The number in a setpoint, rad or rad/s by its mode; 0 for idle.
pub(super) fn value(setpoint: Setpoint) -> f64 {
    match setpoint {
        Setpoint::Idle => 0.0,
        Setpoint::Position(value) | Setpoint::Speed(value) => value,
    }
}

pub(super) fn same_mode(a: Setpoint, b: Setpoint) -> bool {
    core::mem::discriminant(&a) == core::mem::discriminant(&b)
}

/// The trigger rule, over the samples in the ring.
#[derive(Clone, Copy, Debug)]
pub(super) struct Trigger {
    pub(super) thresholds: Thresholds,
    rest: usize,
    /// Output angle of a rigid gear per count of the motor, rad, where nothing is commanded and the motion itself is watched.
    motion: Option<f64>,
}

impl Trigger {
    pub(super) fn new(config: &WindowConfig, rest: usize) -> Self {
        Self {
            thresholds: Thresholds::new(config),
            rest,
            motion: None,
        }
    }

    /// The same for samples without set point: the position that the motor has takes its place.
    pub(super) fn of_motion(&mut self, rad_per_motor_count: f64) {
        self.motion = Some(rad_per_motor_count);
    }

    /// What is watched of a sample.
    pub(super) fn watched(&self, sample: &SensedSample) -> Setpoint {
        match self.motion {
            Some(rad) => Setpoint::Position(sample.motor_counts as f64 * rad),
            None => sample.setpoint,
        }
    }

    /// Whether the latest setpoint differs from the one `rest` samples earlier, in the same mode.
    pub(super) fn moved(&self, ring: &Ring) -> bool {
        ring.newest(self.rest + 1).is_some_and(|slots| {
            let [reference, now] = [0, self.rest].map(|n| self.watched(&slots[n].sample));
            same_mode(now, reference) && self.thresholds.differ(now, reference)
        })
    }

    /// Whether the latest sample is a trigger: it has moved, and all samples since the one it is compared with rested,
    /// that is, stood within the threshold of that one, in the same mode.
    pub(super) fn fires(&self, ring: &Ring) -> bool {
        if self.motion.is_some() {
            return self.has_begun_to_move(ring);
        }
        self.moved(ring)
            && ring.newest(self.rest + 1).is_some_and(|slots| {
                let reference = self.watched(&slots[0].sample);
                slots[1..self.rest].iter().all(|slot| {
                    let setpoint = self.watched(&slot.sample);
                    same_mode(setpoint, reference) && !self.thresholds.differ(setpoint, reference)
                })
            })
    }

    /// Without set point: whether the motor stood for the first half of the rest and has moved since. Steady slow motion is no start,
    /// however often it passes a threshold.
    fn has_begun_to_move(&self, ring: &Ring) -> bool {
        let rad = self.motion.unwrap_or(0.0);
        let still = (HELD_SHARE * self.thresholds.position_rad).max(STILL_COUNTS * rad);
        let moving = (MOTION_SHARE * self.thresholds.position_rad).max(MOTION_COUNTS * rad);
        ring.newest(self.rest + 1).is_some_and(|slots| {
            let reference = slots[0].sample.motor_counts;
            let turned = |slot: &Slot| slot.sample.motor_counts.abs_diff(reference) as f64 * rad;
            let stood = &slots[1..=self.rest.div_ceil(2)];
            stood.iter().all(|slot| turned(slot) <= still) && turned(&slots[self.rest]) > moving
        })
    }
}

/// Motion that begins a window, as a share of the trigger's threshold: early enough that the window has the rest before it.
const MOTION_SHARE: f64 = 0.1;

/// Counts of a coarse encoder between which a motor at rest may change, and those that are motion.
const STILL_COUNTS: f64 = 1.5;
const MOTION_COUNTS: f64 = 6.0;

/// Share of the trigger's threshold within which a setpoint is held.
const HELD_SHARE: f64 = 0.01;

/// Whether the setpoint has been held inside the running actuation.
///
/// A stricter rest than the trigger's: a hundredth of its threshold. The turning points of a commanded oscillation stand
/// still to within the threshold for 20 ms too, and are no end of the actuation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    band: Thresholds,
    needed: usize,
    anchor: Option<Setpoint>,
    run: usize,
    was_held: bool,
}

impl Held {
    pub(super) fn new(trigger: &Trigger) -> Self {
        Self {
            band: trigger.thresholds.scaled(HELD_SHARE),
            needed: trigger.rest,
            anchor: None,
            run: 0,
            was_held: false,
        }
    }

    pub(super) fn push(&mut self, setpoint: Setpoint) {
        match self.anchor {
            Some(anchor) if same_mode(anchor, setpoint) && !self.band.differ(anchor, setpoint) => self.run += 1,
            _ => (self.anchor, self.run) = (Some(setpoint), 1),
        }
        self.was_held |= self.run >= self.needed;
    }

    /// Whether it was held once since [`Self::forget`].
    pub(super) fn was_held(&self) -> bool {
        self.was_held
    }

    pub(super) fn forget(&mut self) {
        (self.anchor, self.run, self.was_held) = (None, 0, false);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exactly_the_threshold_is_not_more_than_it() {
        let thresholds = Thresholds::new(&WindowConfig::default());
        for micro in 0..100_000 {
            let at = |n: i32| Setpoint::Position(f64::from(n) * 1e-6);
            assert!(!thresholds.differ(at(micro), at(micro + 1000)));
            assert!(thresholds.differ(at(micro), at(micro + 1001)));
        }
    }

    /// Samples at which windows begin, of a motor with these counts at 2 kHz.
    fn begins(counts: impl Fn(u64) -> i64) -> Vec<u64> {
        let params = ema_models::ActuatorParams::bench();
        let windower = super::super::Windower::new(WindowConfig::default(), &params).expect("defaults");
        let mut windower = windower.triggered_by_motion();
        let windows = (0..4000).filter_map(|seq| {
            windower.push(super::super::TimedSample {
                seq,
                stamp_ns: 500_000 * seq,
                sensed: SensedSample {
                    seq,
                    currents: [0.0; 3],
                    motor_counts: counts(seq),
                    output_counts: 0,
                    setpoint: Setpoint::Idle,
                },
            })
        });
        windows.map(|window| window.samples[window.trigger].seq).collect()
    }

    #[test]
    fn without_set_point_a_window_begins_where_the_motor_leaves_its_rest() {
        // 10^-4 rad at the output are 104 counts of this motor; it dithers by one count at rest.
        let at_rest = |seq: u64| (seq % 2).cast_signed();
        let moves = begins(|seq| at_rest(seq) + 20 * seq.saturating_sub(1000).cast_signed());
        assert_eq!(moves, [1006]);
        // Slow and steady from before, through any threshold.
        assert!(begins(|seq| 3 * seq.cast_signed()).is_empty());
        assert!(begins(at_rest).is_empty());
    }

    #[test]
    fn only_a_held_setpoint_counts_as_held() {
        let trigger = Trigger::new(&WindowConfig::default(), 40);
        let mut held = Held::new(&trigger);
        for n in 0..2000 {
            // 10 mrad at 2 Hz: at its turning points within 1 mrad for 140 ms.
            held.push(Setpoint::Position(
                0.01 * (core::f64::consts::TAU * 2.0 * f64::from(n) / 2000.0).sin(),
            ));
            assert!(!held.was_held());
        }
        for _ in 0..40 {
            held.push(Setpoint::Position(0.0));
        }
        assert!(held.was_held());
    }
}
