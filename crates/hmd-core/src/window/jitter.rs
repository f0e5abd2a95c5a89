//! Jitter of the sample instants of one window, from the resolver's counts.
//!
//! A sample that is taken u periods late shows a turning motor u periods further on. Third differences of the counts are free of speed
//! and acceleration; relative to the speed, those of the instants remain. A glitch stands in few of them, so their median shows the
//! jitter of all. Derived here.

use super::quality::Part;
use super::ring::Slot;

/// Slowest speed at which a count shows its instant, counts per period: slower, rounding looks like jitter.
const SPEED_MIN: f64 = 32.0;

/// Fewest third differences that show the jitter.
const GROUPS_MIN: usize = 32;

/// Median magnitude of the third difference of instants that are evenly off by up to ±1: a sum of four, nearly normal, of variance
/// 20/3.
const MEDIAN_OF_EVEN: f64 = 1.74;

/// Jitter that is not told from rounding and motion, periods.
const SHOWN_MIN: f64 = 0.05;

/// Largest jitter with which samples have a rate, periods.
const JITTER_MAX: f64 = 0.3;

/// Largest time by which samples are taken early or late, periods; 0 where the window shows none.
#[must_use]
pub(super) fn sample_jitter(slots: &[Slot]) -> f64 {
    let mut relative: Vec<f64> = slots
        .windows(4)
        .filter(|four| four.iter().all(|slot| slot.is_good(Part::Motor)))
        .filter_map(|four| {
            let origin = four[0].sample.motor_counts;
            let [b, c, d] = [1, 2, 3].map(|n| four[n].sample.motor_counts.saturating_sub(origin) as f64);
            let speed = d.abs() / 3.0;
            (speed >= SPEED_MIN).then(|| (d - 3.0 * (c - b)).abs() / speed)
        })
        .collect();
    if relative.len() < GROUPS_MIN {
        return 0.0;
    }
    let middle = relative.len() / 2;
    let (_, median, _) = relative.select_nth_unstable_by(middle, f64::total_cmp);
    let jitter = *median / MEDIAN_OF_EVEN;
    if jitter < SHOWN_MIN {
        0.0
    } else {
        jitter.min(JITTER_MAX)
    }
}

/// Root mean square by which the stamps of a window are off the straight line through them, as a share of a period.
#[must_use]
pub(super) fn time_jitter(slots: &[Slot], sample_rate_hz: f64) -> f64 {
    let received = || slots.iter().filter(|slot| slot.was_received());
    let Some(first) = received().next() else { return 0.0 };
    let point = |slot: &Slot| {
        let number = slot.sample.seq.saturating_sub(first.sample.seq) as f64;
        let since_ns = i128::from(slot.stamp_ns) - i128::from(first.stamp_ns);
        (number, since_ns as f64 * 1e-9 * sample_rate_hz)
    };
    let count = received().count() as f64;
    let mean = |of: &dyn Fn((f64, f64)) -> f64| received().map(|slot| of(point(slot))).sum::<f64>() / count;
    let (number, time) = (mean(&|(number, _)| number), mean(&|(_, time)| time));
    let of_number = mean(&|(n, _)| (n - number).powi(2));
    let of_both = mean(&|(n, t)| (n - number) * (t - time));
    let of_time = mean(&|(_, t)| (t - time).powi(2));
    // One sample has no line.
    if of_number > 0.0 {
        (of_time - of_both * of_both / of_number).max(0.0).sqrt()
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use ema_models::{SensedSample, Setpoint};

    use super::*;
    use crate::window::TimedSample;

    /// A motor that speeds up, sampled early or late by up to `jitter` periods; a count in `spoilt` is off by 400.
    fn slots(jitter: f64, spoilt: usize) -> Vec<Slot> {
        let mut random = 1_u32;
        (0..200)
            .map(|seq| {
                // Lehmer's generator, -1 to 1.
                random = (u64::from(random) * 48_271 % 0x7fff_ffff) as u32;
                let t = seq as f64 + jitter * (2.0 * f64::from(random) / f64::from(0x7fff_ffff_u32) - 1.0);
                let spike = if (seq as usize) < spoilt && seq % 3 == 0 {
                    400
                } else {
                    0
                };
                let sensed = SensedSample {
                    seq,
                    currents: [0.0; 3],
                    motor_counts: (100.0 * t + t * t) as i64 + spike,
                    output_counts: 0,
                    setpoint: Setpoint::Idle,
                };
                Slot::received(&TimedSample {
                    seq,
                    stamp_ns: 0,
                    sensed,
                })
            })
            .collect()
    }

    #[test]
    fn stamps_jitter_about_their_own_line() {
        let mut slots = slots(0.0, 0);
        for (n, slot) in slots.iter_mut().enumerate() {
            // A clock that is 1 % fast, and every other stamp late by a fifth of a period of 2.5 ms.
            slot.stamp_ns = 1_000_000_000 + 2_525_000 * n as u64 + 500_000 * (n as u64 % 2);
        }
        let found = time_jitter(&slots, 400.0);
        assert!((found - 0.1).abs() < 1e-3, "{found}");
    }

    #[test]
    fn jitter_is_found_and_spikes_are_none() {
        for jitter in [0.1, 0.2] {
            let found = sample_jitter(&slots(jitter, 0));
            assert!((found - jitter).abs() < 0.25 * jitter, "{found} instead of {jitter}");
        }
        assert!(sample_jitter(&slots(0.0, 0)).abs() < f64::EPSILON);
        assert!(sample_jitter(&slots(0.0, 60)).abs() < f64::EPSILON);
        assert!(sample_jitter(&slots(0.45, 200)) <= JITTER_MAX);
    }

    /// Counts of a motor, sampled at other instants than it should by a pattern of ±`off` periods.
    fn at_speed(count: usize, per_period: f64, off: f64) -> Vec<Slot> {
        crate::window::bench_slots::slots(count, |n, s| {
            let t = n as f64 + if n % 2 == 0 { off } else { -off };
            s.motor_counts = (per_period * t).round() as i64;
        })
    }

    #[test]
    fn jitter_is_the_third_difference_over_the_speed() {
        for direction in [1.0, -1.0] {
            // Early and late in turn: the third difference is eight times the offset, the turn of three periods two offsets shorter or
            // longer, in turn.
            let found = sample_jitter(&at_speed(100, direction * 3000.0, 0.04));
            let [longer, shorter] =
                [1.0 + 0.08 / 3.0, 1.0 - 0.08 / 3.0].map(|speed| 8.0 * 0.04 / speed / MEDIAN_OF_EVEN);
            assert!(
                (longer - 1e-3..shorter + 1e-3).contains(&found),
                "{found}, {longer} to {shorter}"
            );
        }
    }

    #[test]
    fn a_window_shows_jitter_from_thirty_two_groups_of_a_motor_that_turns_by_as_many_counts() {
        let is_shown = |count, per_period| sample_jitter(&at_speed(count, per_period, 0.05)) > 0.0;
        assert!(is_shown(35, 3000.0));
        assert!(!is_shown(34, 3000.0));
        // Three periods turn by three times the speed, less two offsets in every other group: 31.9 to 34.1 counts, then 30 to 33.
        assert!(is_shown(200, 34.0));
        assert!(!is_shown(200, 30.0));
    }

    #[test]
    fn little_jitter_is_none_and_much_is_what_still_has_a_rate() {
        // The offsets of the pattern look 8 / 1.74 times as large.
        let of = |off| sample_jitter(&at_speed(200, 3000.0, off));
        assert!(of(0.0105).abs() < f64::EPSILON);
        assert!((of(0.0115) - 0.0529).abs() < 2e-3, "{}", of(0.0115));
        assert!((of(0.2) - JITTER_MAX).abs() < f64::EPSILON);
    }

    #[test]
    fn groups_with_a_refused_count_show_no_jitter() {
        let mut slots = at_speed(37, 3000.0, 0.05);
        assert!(sample_jitter(&slots) > 0.0);
        // Three groups fewer.
        slots[2].refuse(Part::Motor, super::super::quality::Defect::MotorSpike);
        assert!(sample_jitter(&slots).abs() < f64::EPSILON);
    }

    #[test]
    fn stamps_of_one_sample_have_no_line_and_missing_samples_none() {
        let mut slots = at_speed(101, 0.0, 0.0);
        assert!(time_jitter(&slots[..1], 2000.0).abs() < f64::EPSILON);
        assert!(time_jitter(&[], 2000.0).abs() < f64::EPSILON);
        assert!(time_jitter(&slots, 2000.0) < 1e-6);
        for n in (1..100).step_by(3) {
            crate::window::bench_slots::lose(&mut slots, n);
        }
        assert!(time_jitter(&slots, 2000.0) < 1e-6, "places without a stamp");
        // Stamps of today are as exact as those after 1970.
        let mut today = at_speed(101, 0.0, 0.0);
        today
            .iter_mut()
            .for_each(|slot| slot.stamp_ns += 1_700_000_000_000_000_000);
        assert!(time_jitter(&today, 2000.0) < 1e-6);
        // One of two stamps is late by a period; the line goes through both.
        let mut two = at_speed(2, 0.0, 0.0);
        two[1].stamp_ns += 500_000;
        assert!(time_jitter(&two, 2000.0) < 1e-6);
    }
}
