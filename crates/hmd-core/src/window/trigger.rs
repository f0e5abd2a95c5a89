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
    use crate::window::bench_slots::slots;

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

    /// Samples of which the trigger is asked after the last one, with 40 samples of rest.
    fn fires_at_the_end_of(setpoints: &[Setpoint]) -> bool {
        let mut ring = Ring::with_capacity(200);
        for slot in slots(setpoints.len(), |n, s| s.setpoint = setpoints[n]) {
            ring.push(slot);
        }
        Trigger::new(&WindowConfig::default(), 40).fires(&ring)
    }

    /// Forty samples at rest, one of them changed, and a last one.
    fn rest_then(last: Setpoint, changed: (usize, Setpoint)) -> Vec<Setpoint> {
        let mut setpoints = vec![Setpoint::Position(0.3); 40];
        setpoints[changed.0] = changed.1;
        setpoints.push(last);
        setpoints
    }

    #[test]
    fn a_trigger_differs_by_more_than_the_threshold_from_a_rest_within_it() {
        use Setpoint::{Idle, Position, Speed};
        let at_rest = (20, Position(0.3));
        for sign in [1.0, -1.0] {
            let to = |mrad: f64| Position(0.3 + sign * 1e-3 * mrad);
            assert!(fires_at_the_end_of(&rest_then(to(1.1), at_rest)));
            assert!(
                !fires_at_the_end_of(&rest_then(to(1.0), at_rest)),
                "exactly the threshold"
            );
            for place in [0, 1, 39] {
                assert!(!fires_at_the_end_of(&rest_then(to(1.1), (place, to(-1.1)))), "{place}");
            }
            for place in [1, 39] {
                assert!(fires_at_the_end_of(&rest_then(to(1.1), (place, to(-1.0)))), "{place}");
            }
        }
        for other in [Idle, Speed(0.3)] {
            assert!(!fires_at_the_end_of(&rest_then(other, at_rest)), "another mode");
            for place in [0, 1, 39] {
                assert!(
                    !fires_at_the_end_of(&rest_then(Position(0.4), (place, other))),
                    "{place}"
                );
            }
        }
        // One sample of rest too few, and one more.
        assert!(!fires_at_the_end_of(&rest_then(Position(0.4), at_rest)[1..]));
        let mut longer = vec![Position(0.9)];
        longer.extend(rest_then(Position(0.4), at_rest));
        assert!(fires_at_the_end_of(&longer));
    }

    #[test]
    fn an_idle_drive_is_never_triggered() {
        assert!(!fires_at_the_end_of(&[Setpoint::Idle; 41]));
        let thresholds = Thresholds::new(&WindowConfig::default());
        assert!(!thresholds.differ(Setpoint::Idle, Setpoint::Idle));
        assert!(thresholds.jump_at(Setpoint::Idle).is_infinite());
    }

    #[test]
    fn thresholds_are_in_the_unit_of_the_mode() {
        let thresholds = Thresholds::new(&WindowConfig {
            trigger_position_rad: 0.01,
            trigger_speed_rad_s: 5.0,
            ..WindowConfig::default()
        });
        let is = |found: f64, expected: f64| (found - expected).abs() < 1e-5 * expected;
        assert!(is(thresholds.jump_at(Setpoint::Position(3.0)), 0.01));
        assert!(is(thresholds.jump_at(Setpoint::Speed(3.0)), 5.0));
        for mode in [Setpoint::Position, Setpoint::Speed] {
            let at = mode(thresholds.jump_at(mode(0.0)));
            assert!(!thresholds.differ(at, mode(0.0)), "exactly there is not beyond");
        }
        assert!(is(thresholds.held(Setpoint::Position(3.0)), 1e-4));
        assert!(is(thresholds.held(Setpoint::Speed(3.0)), 0.05));
    }

    /// Whether motion begins with the last of 41 counts.
    fn begins_to_move(counts: impl Fn(usize) -> i64, rad: f64) -> bool {
        let mut ring = Ring::with_capacity(200);
        for slot in slots(41, |n, s| s.motor_counts = counts(n)) {
            ring.push(slot);
        }
        let mut trigger = Trigger::new(&WindowConfig::default(), 40);
        trigger.of_motion(rad);
        trigger.fires(&ring)
    }

    #[test]
    fn motion_begins_a_tenth_of_the_threshold_beyond_a_rest_within_a_hundredth() {
        // At 10^-7 rad a count: 1000 counts of motion, 100 of rest.
        let rad = 1e-7;
        for sign in [1, -1] {
            let last = |counts: i64| begins_to_move(|n| 7 + if n == 40 { sign * counts } else { 0 }, rad);
            assert_eq!((last(999), last(1001)), (false, true));
            for (place, expected) in [(1, false), (20, false), (21, true), (39, true)] {
                let stood = |counts: i64| {
                    let at = |n: usize| {
                        if n == 40 {
                            5000
                        } else if n == place {
                            counts
                        } else {
                            0
                        }
                    };
                    begins_to_move(|n| sign * at(n), rad)
                };
                assert!(stood(99), "{place}");
                assert_eq!(stood(101), expected, "{place}");
            }
        }
    }

    #[test]
    fn of_a_coarse_encoder_six_counts_are_rest_and_one_may_change_in_it() {
        // A count is 2^-10 rad, half of the threshold that it need not pass; exact in binary.
        let rad = 2.0_f64.powi(-10);
        let last = |counts: i64| begins_to_move(|n| if n == 40 { counts } else { 0 }, rad);
        assert_eq!((last(6), last(7)), (false, true));
        let dithering = |by: i64| begins_to_move(|n| if n == 40 { 50 } else { by * (n as i64 % 2) }, rad);
        assert_eq!((dithering(1), dithering(2)), (true, false));
    }

    #[test]
    fn without_set_point_the_motor_is_watched_in_place_of_it() {
        let mut trigger = Trigger::new(&WindowConfig::default(), 40);
        let sample = slots(1, |_, s| {
            s.motor_counts = -200;
            s.setpoint = Setpoint::Speed(4.0);
        })[0]
            .sample;
        assert_eq!(trigger.watched(&sample), Setpoint::Speed(4.0));
        trigger.of_motion(0.5);
        assert_eq!(trigger.watched(&sample), Setpoint::Position(-100.0));
    }

    #[test]
    fn a_setpoint_is_held_from_the_last_sample_of_the_rest_on() {
        let mut held = Held::new(&Trigger::new(&WindowConfig::default(), 40));
        let mut push = |angle: f64| {
            held.push(Setpoint::Position(angle));
            held.was_held()
        };
        // Within a hundredth of the threshold of the first, 10^-5 rad.
        for n in 0..39 {
            assert!(!push(if n % 2 == 0 { 0.0 } else { 1e-5 }), "{n}");
        }
        // A step begins the rest anew, from itself on.
        for n in 0..39 {
            assert!(!push(1.1e-5), "{n}");
        }
        assert!(push(1.1e-5));
        assert!(push(1.0), "it was held once");
        held.forget();
        assert!(!held.was_held());
        for n in 0..40 {
            assert!(!held.was_held(), "{n}");
            held.push(Setpoint::Position(1.0));
        }
        assert!(held.was_held());
        // A hundredth of the threshold in speed mode: 10^-2 rad/s.
        for (step, expected) in [(0.01, true), (0.011, false)] {
            held.forget();
            for n in 0..40 {
                held.push(Setpoint::Speed(5.0 + step * f64::from(n % 2)));
            }
            assert_eq!(held.was_held(), expected, "{step} rad/s");
        }
        // Another mode is another setpoint.
        held.forget();
        for n in 0..80 {
            held.push(if n % 39 < 20 {
                Setpoint::Speed(0.0)
            } else {
                Setpoint::Idle
            });
            assert!(!held.was_held(), "{n}");
        }
    }
}
