//! What stands on the grid where a sample, or a part of it, cannot be used.
//!
//! Everything is interpolated linearly between the nearest good samples; at an end of the window the nearest is held.
//! The resolver's counts are interpolated by the cubic through two good samples on each side, where there are so many: an
//! accelerating motor leaves the chord at 400 Hz by up to 500 counts, enough to look like a fault. The currents are
//! interpolated in the rotor frame, because between two samples at 400 Hz a phase turns by up to 2 rad. The
//! setpoint too is interpolated, not held: the device received it although its frame was lost here, and windows whose
//! command jumped in a gap are invalid, so that what is left changes smoothly (held, a chirp at 400 Hz would be wrong by
//! 1 mrad for one lost sample).

use super::quality::Part;
use super::ring::Slot;
use super::trigger::value;
use ema_models::{Real, SensedSample, SensorParams, Setpoint, abc_from_alpha_beta, alpha_beta_from_dq, dq_from_abc};

/// What turns a resolver count into the electrical angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rotor {
    pub(super) pole_pairs: f64,
    pub(super) motor_lsb: f64,
    counts_per_rev: i64,
}

impl Rotor {
    pub(super) fn new(pole_pairs: f64, sensors: &SensorParams) -> Self {
        let counts_per_rev = (sensors.motor_counts_per_rev as i64).max(1);
        Self {
            pole_pairs,
            motor_lsb: sensors.motor_lsb(),
            counts_per_rev,
        }
    }

    fn sin_cos(&self, motor_counts: i64) -> (f64, f64) {
        let within_turn = motor_counts.rem_euclid(self.counts_per_rev) as f64;
        (self.pole_pairs * (within_turn + 0.5) * self.motor_lsb).sin_cos_poly()
    }
}

/// Indices of all slots that lack something.
pub(super) fn indices(slots: &[Slot]) -> Vec<usize> {
    slots
        .iter()
        .enumerate()
        .filter(|(_, slot)| slot.is_flawed())
        .map(|(index, _)| index)
        .collect()
}

/// The samples of an invalid window, as received; completed only where they are missing or hold no number.
pub(super) fn as_received(slots: &[Slot], rotor: &Rotor) -> Vec<SensedSample> {
    let is_number =
        |sample: &SensedSample| sample.currents.iter().all(|i| i.is_finite()) && value(sample.setpoint).is_finite();
    let mut all = samples(slots, rotor);
    for (slot, sample) in slots.iter().zip(&mut all) {
        if slot.was_received() && is_number(&slot.sample) {
            *sample = slot.sample;
        }
    }
    all
}

/// The window's samples, completed.
pub(super) fn samples(slots: &[Slot], rotor: &Rotor) -> Vec<SensedSample> {
    let mut samples: Vec<SensedSample> = slots.iter().map(|slot| slot.sample).collect();
    let good = |part: Part| move |n: usize| slots[n].is_good(part);
    fill_motor(&mut samples, good(Part::Motor));
    fill_output(&mut samples, good(Part::Output));
    fill(&mut samples, good(Part::Setpoint), |a, b, x, s| {
        s.setpoint = commanded(a.setpoint, b.setpoint, x)
    });
    // After the counts, whose angles it needs.
    fill(&mut samples, good(Part::Currents), |a, b, x, s| {
        let [from, to] = [a, b].map(|s| dq_from_abc(s.currents, rotor.sin_cos(s.motor_counts)));
        let dq = [0, 1].map(|axis| from[axis] + (to[axis] - from[axis]) * x);
        s.currents = abc_from_alpha_beta(alpha_beta_from_dq(dq, rotor.sin_cos(s.motor_counts)));
    });
    if !slots.iter().any(|slot| slot.is_good(Part::Currents)) {
        samples.iter_mut().for_each(|sample| sample.currents = [0.0; 3]);
    }
    samples
}

/// Fills the resolver's counts that are not good.
pub(super) fn fill_motor(samples: &mut [SensedSample], good: impl Fn(usize) -> bool) {
    fill(samples, &good, |a, b, x, s| {
        s.motor_counts = between(a.motor_counts, b.motor_counts, x);
    });
    for n in (0..samples.len()).filter(|&n| !good(n)) {
        let mut before = (0..n).rev().filter(|&n| good(n));
        let mut after = (n + 1..samples.len()).filter(|&n| good(n));
        if let (Some(b), Some(a), Some(c), Some(d)) = (before.next(), before.next(), after.next(), after.next()) {
            samples[n].motor_counts = on_the_cubic(n, [a, b, c, d], samples);
        }
    }
}

/// Fills the encoder's counts that are not good.
pub(super) fn fill_output(samples: &mut [SensedSample], good: impl Fn(usize) -> bool) {
    fill(samples, good, |a, b, x, s| {
        s.output_counts = between(a.output_counts, b.output_counts, x);
    });
}

/// Resolver count at `n` on the cubic through those at four other places.
fn on_the_cubic(n: usize, nodes: [usize; 4], samples: &[SensedSample]) -> i64 {
    let origin = samples[nodes[0]].motor_counts;
    let mut beyond = 0.0;
    for at in nodes {
        let mut share = 1.0;
        for other in nodes.into_iter().filter(|&other| other != at) {
            share *= (n as f64 - other as f64) / (at as f64 - other as f64);
        }
        beyond += share * samples[at].motor_counts.saturating_sub(origin) as f64;
    }
    origin.saturating_add(beyond.round() as i64)
}

/// Calls `set(left, right, place between them in 0…1, sample)` for every sample that is not good.
fn fill(
    samples: &mut [SensedSample],
    good: impl Fn(usize) -> bool,
    set: impl Fn(&SensedSample, &SensedSample, f64, &mut SensedSample),
) {
    let mut left: Option<usize> = None;
    let mut n = 0;
    while n < samples.len() {
        if good(n) {
            left = Some(n);
            n += 1;
            continue;
        }
        let end = (n..samples.len()).find(|&m| good(m));
        let (Some(from), Some(to)) = (left.or(end), end.or(left)) else {
            return;
        };
        let (a, b) = (samples[from], samples[to]);
        for m in n..end.unwrap_or(samples.len()) {
            let x = if from < to {
                (m - from) as f64 / (to - from) as f64
            } else {
                0.0
            };
            set(&a, &b, x, &mut samples[m]);
        }
        n = end.unwrap_or(samples.len());
    }
}

fn between(from: i64, to: i64, x: f64) -> i64 {
    from.saturating_add((to.saturating_sub(from) as f64 * x).round() as i64)
}

fn commanded(from: Setpoint, to: Setpoint, x: f64) -> Setpoint {
    match (from, to) {
        (Setpoint::Position(a), Setpoint::Position(b)) => Setpoint::Position(a + (b - a) * x),
        (Setpoint::Speed(a), Setpoint::Speed(b)) => Setpoint::Speed(a + (b - a) * x),
        _ => from,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::window::bench_slots::slots;
    use crate::window::{Defect, TimedSample};
    use ema_models::{ActuatorParams, phase_shapes};

    #[test]
    fn a_lost_sample_of_a_turning_motor_comes_back() {
        // 150 rad/s at 400 Hz: 1.5 rad electrical per sample, where a chord between phase currents is of no use.
        let params = ActuatorParams::bench();
        let rotor = Rotor::new(params.motor.pole_pairs, &params.sensors);
        let turning = |n: u64| {
            let motor_counts = (n as f64 * 150.0 / 400.0 / rotor.motor_lsb) as i64;
            let currents = phase_shapes(rotor.sin_cos(motor_counts)).map(|s| (5.0 + 0.1 * n as f64) * s);
            let setpoint = Setpoint::Position(0.001 * n as f64);
            SensedSample {
                seq: n,
                currents,
                motor_counts,
                output_counts: 10 * n as i64,
                setpoint,
            }
        };
        let mut slots: Vec<Slot> = (0..9)
            .map(|n| {
                Slot::received(&TimedSample {
                    seq: n,
                    stamp_ns: 0,
                    sensed: turning(n),
                })
            })
            .collect();
        slots[4] = slots[3].missing_next();
        slots[6].sample.currents = [99.0; 3];
        slots[6].refuse(Part::Currents, Defect::BeyondScale);
        assert_eq!(indices(&slots), [4, 6]);
        for (n, sample) in samples(&slots, &rotor).iter().enumerate() {
            let truth = turning(n as u64);
            assert!((sample.motor_counts - truth.motor_counts).abs() <= 1);
            assert_eq!(sample.output_counts, truth.output_counts);
            for (found, expected) in sample.currents.iter().zip(truth.currents) {
                assert!((found - expected).abs() < 1e-2, "{n}: {found} {expected}");
            }
            assert!((super::super::trigger::value(sample.setpoint) - 0.001 * n as f64).abs() < 1e-12);
        }
    }

    fn bench() -> Rotor {
        let params = ActuatorParams::bench();
        Rotor::new(params.motor.pole_pairs, &params.sensors)
    }

    #[test]
    fn the_electrical_angle_is_that_of_the_middle_of_a_count_and_repeats_with_the_turn() {
        let rotor = bench();
        for counts in [0_i64, 1, 5_000, 65_535] {
            let angle = 4.0 * (counts as f64 + 0.5) * core::f64::consts::TAU / 65_536.0;
            for turns in [0, 3, -2] {
                let (sin, cos) = rotor.sin_cos(counts + 65_536 * turns);
                assert!(
                    (sin - angle.sin()).abs() < 1e-9 && (cos - angle.cos()).abs() < 1e-9,
                    "{counts}"
                );
            }
        }
    }

    #[test]
    fn at_an_end_the_nearest_good_sample_is_held() {
        let mut slots = slots(6, |n, s| {
            s.motor_counts = 100 * n as i64;
            s.output_counts = 10 * n as i64;
            s.setpoint = Setpoint::Position(0.1 * n as f64);
        });
        for n in [0, 1, 5] {
            for part in [Part::Motor, Part::Output, Part::Setpoint] {
                slots[n].refuse(part, Defect::Repeated);
            }
        }
        let found = samples(&slots, &bench());
        let of = |part: fn(&SensedSample) -> f64| found.iter().map(part).collect::<Vec<_>>();
        assert_eq!(
            of(|s| s.motor_counts as f64),
            [200.0, 200.0, 200.0, 300.0, 400.0, 400.0]
        );
        assert_eq!(of(|s| s.output_counts as f64), [20.0, 20.0, 20.0, 30.0, 40.0, 40.0]);
        assert_eq!(
            of(|s| (10.0 * value(s.setpoint)).round()),
            [2.0, 2.0, 2.0, 3.0, 4.0, 4.0]
        );
    }

    #[test]
    fn between_good_samples_encoder_and_command_go_straight() {
        for speed_mode in [false, true] {
            let mode = if speed_mode {
                Setpoint::Speed
            } else {
                Setpoint::Position
            };
            let mut slots = slots(8, |n, s| {
                s.output_counts = if n < 4 { -40 } else { 60 };
                s.setpoint = mode(if n < 4 { 1.0 } else { 3.0 });
            });
            for n in [2, 3, 4] {
                slots[n].refuse(Part::Output, Defect::OutputSpike);
                slots[n].refuse(Part::Setpoint, Defect::CommandGlitch);
            }
            let found = samples(&slots, &bench());
            let output: Vec<_> = found.iter().map(|s| s.output_counts).collect();
            assert_eq!(output, [-40, -40, -15, 10, 35, 60, 60, 60]);
            let command: Vec<_> = found.iter().map(|s| s.setpoint).collect();
            assert_eq!(command[1..6], [1.0, 1.5, 2.0, 2.5, 3.0].map(mode));
        }
    }

    #[test]
    fn a_command_whose_mode_changes_in_a_gap_is_held() {
        let mut slots = slots(3, |n, s| {
            s.setpoint = [Setpoint::Position(0.5), Setpoint::Idle, Setpoint::Speed(9.0)][n];
        });
        slots[1].refuse(Part::Setpoint, Defect::CommandGlitch);
        assert_eq!(samples(&slots, &bench())[1].setpoint, Setpoint::Position(0.5));
    }

    #[test]
    fn an_accelerating_motor_is_filled_by_the_cubic_of_two_good_counts_on_each_side() {
        let cubic = |n: usize| {
            let n = n as i64;
            1_000_000 + 7 * n * n * n - 30 * n * n + n
        };
        for lost in [&[5][..], &[5, 6], &[4, 6]] {
            let mut samples: Vec<_> = slots(12, |n, s| s.motor_counts = cubic(n))
                .iter()
                .map(|s| s.sample)
                .collect();
            lost.iter().for_each(|&n| samples[n].motor_counts = -99);
            fill_motor(&mut samples, |n| !lost.contains(&n));
            for (n, sample) in samples.iter().enumerate() {
                assert_eq!(sample.motor_counts, cubic(n), "{n} of {lost:?}");
            }
        }
    }

    #[test]
    fn beside_an_end_a_count_is_filled_by_the_chord() {
        let square = |n: usize| (n * n) as i64;
        for (lost, chord) in [(1, 2), (10, 101)] {
            let mut samples: Vec<_> = slots(12, |n, s| s.motor_counts = square(n))
                .iter()
                .map(|s| s.sample)
                .collect();
            samples[lost].motor_counts = -99;
            fill_motor(&mut samples, |n| n != lost);
            assert_eq!(samples[lost].motor_counts, chord);
        }
    }

    #[test]
    fn without_any_good_currents_there_are_none() {
        let mut slots = slots(4, |_, s| s.currents = [20.0, -10.0, -10.0]);
        for slot in &mut slots {
            slot.refuse(Part::Currents, Defect::BeyondScale);
        }
        assert!(
            samples(&slots, &bench())
                .iter()
                .all(|s| s.currents.map(f64::to_bits) == [0; 3])
        );
    }

    #[test]
    fn an_invalid_window_keeps_what_was_received_but_for_what_is_no_number() {
        let mut slots = slots(8, |n, s| {
            s.output_counts = 10 * n as i64;
            s.currents = [0.5, -0.5, 0.0];
        });
        let change = |slot: &mut Slot, part, to: fn(&mut SensedSample)| {
            to(&mut slot.sample);
            slot.refuse(part, Defect::OutputSpike);
        };
        change(&mut slots[1], Part::Output, |s| s.output_counts = 7_000);
        change(&mut slots[2], Part::Currents, |s| s.currents = [9.0, 9.0, 9.0]);
        change(&mut slots[3], Part::Currents, |s| s.currents[2] = f64::NAN);
        change(&mut slots[4], Part::Setpoint, |s| {
            s.setpoint = Setpoint::Position(f64::INFINITY)
        });
        slots[6] = slots[5].missing_next();
        let found = as_received(&slots, &bench());
        for n in [0, 1, 2, 5, 7] {
            assert_eq!(found[n], slots[n].sample, "{n}");
        }
        assert!((found[3].currents[0] - 0.5).abs() < 0.01 && found[3].currents[2].abs() < 0.01);
        assert_eq!(found[4].setpoint, Setpoint::Position(0.0));
        assert_eq!(found[6].output_counts, 60, "filled, not held");
    }
}
