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
    fill(&mut samples, good(Part::Output), |a, b, x, s| {
        s.output_counts = between(a.output_counts, b.output_counts, x);
    });
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
}
