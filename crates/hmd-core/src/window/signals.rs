//! The currents: which readings cannot be used, and whether a signal is stuck.

use super::config::CURRENT_SUM_MAX_A;
use super::limits::Limits;
use super::quality::{Defect, Part, Signal};
use super::ring::Slot;
use ema_models::SensedSample;

/// Refuses the currents that no working converters can have read.
///
/// The star point has no way out, so the three currents sum to zero at every instant, however fast they change; a
/// spike in one phase is found by that and needs no comparison with its neighbours, between which a phase may cross its
/// whole range (2 rad of electrical angle in one sample at 400 Hz).
pub(super) fn refuse_currents(slots: &mut [Slot], limits: &Limits) {
    for slot in slots {
        if let Some(defect) = current_defect(slot.sample.currents, limits) {
            slot.refuse(Part::Currents, defect);
        }
    }
}

/// Refuses samples that hold what the one before held, currents and resolver to the bit, while the motor turned by several counts
/// a sample on either side: a device or a gateway sent them again under a new number.
pub(super) fn refuse_repeated(slots: &mut [Slot], limits: &Limits) {
    let turns = |a: &Slot, b: &Slot| b.sample.motor_counts.abs_diff(a.sample.motor_counts) as f64;
    let least = REPEATED_COUNTS.max(REPEATED_RAD / limits.rotor.motor_lsb);
    let repeated: Vec<usize> = (2..slots.len().saturating_sub(1))
        .filter(|&n| {
            let [earlier, before, now, after] = [n - 2, n - 1, n, n + 1].map(|n| &slots[n]);
            let same = |a: &Slot, b: &Slot| {
                a.sample.motor_counts == b.sample.motor_counts
                    && a.sample.currents.map(f64::to_bits) == b.sample.currents.map(f64::to_bits)
            };
            [earlier, before, now, after].iter().all(|slot| slot.was_received())
                && same(before, now)
                && turns(earlier, before) > least
                && turns(now, after) > least
        })
        .collect();
    for n in repeated {
        for part in [Part::Currents, Part::Motor, Part::Output, Part::Setpoint] {
            slots[n].refuse(part, Defect::Repeated);
        }
    }
}

/// Turn from sample to sample in which the counts must change, counts and rad.
const REPEATED_COUNTS: f64 = 4.0;
const REPEATED_RAD: f64 = 1e-3;

fn current_defect(currents: [f64; 3], limits: &Limits) -> Option<Defect> {
    let largest = currents.iter().fold(0.0, |max: f64, i| max.max(i.abs()));
    if currents.iter().any(|i| !i.is_finite()) {
        Some(Defect::NotFinite)
    } else if largest > limits.full_scale_a + 1.5 * limits.current_lsb_a {
        Some(Defect::BeyondScale)
    } else if largest > limits.full_scale_a - 1.5 * limits.current_lsb_a {
        // The positive end of a two's complement converter is one step short of full scale.
        Some(Defect::Clipped)
    } else if limits.quadrature_max_a.is_some_and(|most| length(currents) >= most) {
        Some(Defect::Clipped)
    } else if currents.iter().sum::<f64>().abs() > CURRENT_SUM_MAX_A {
        Some(Defect::CurrentSum)
    } else {
        None
    }
}

/// Length of the current vector, A: of a quadrature current without a direct one, its magnitude.
fn length(currents: [f64; 3]) -> f64 {
    (currents.iter().map(|i| i * i).sum::<f64>() / 1.5).sqrt()
}

/// A signal that stayed the same, bit for bit, for the stuck time and longer, while another says that it must have changed:
/// the currents while the motor turned, one counter while the other moved by more than the transmission's play.
pub(super) fn stuck(slots: &[Slot], limits: &Limits) -> Option<Signal> {
    let play = limits.play_max_rad;
    let motor = |s: &SensedSample| s.motor_counts as f64 * limits.rotor.motor_lsb;
    let output = |s: &SensedSample| s.output_counts as f64 * limits.output_lsb;
    let (currents_good, motor_good, output_good) = (
        |s: &Slot| s.is_good(Part::Currents),
        |s: &Slot| s.is_good(Part::Motor),
        |s: &Slot| s.is_good(Part::Output),
    );
    let counters_good = |s: &Slot| motor_good(s) && output_good(s);
    // A quadrature current alone, in steps as wide as what friction takes, reads 0 A for a while where a motor runs down.
    let currents_stuck = if limits.is_quadrature_alone {
        RUN_DOWN_FACTOR * limits.lengths.stuck
    } else {
        limits.lengths.stuck
    };

    let frozen_currents = stands_while(
        slots.iter().filter(|s| currents_good(s) && motor_good(s)),
        currents_stuck,
        |a, b| (0..3).all(|phase| is_held(a, b, phase)),
        |a, b| (motor(b) - motor(a)).abs() > MOTION_RAD,
    );
    let frozen_motor = stands_while(
        slots.iter().filter(|s| counters_good(s)),
        limits.lengths.stuck,
        |a, b| a.motor_counts == b.motor_counts,
        |a, b| (output(b) - output(a)).abs() > play,
    );
    let frozen_output = stands_while(
        slots.iter().filter(|s| counters_good(s)),
        limits.lengths.stuck,
        |a, b| a.output_counts == b.output_counts,
        |a, b| (motor(b) - motor(a)).abs() > play * limits.gear_ratio,
    );
    [
        (frozen_currents, Signal::Currents),
        (frozen_motor, Signal::Motor),
        (frozen_output, Signal::Output),
    ]
    .into_iter()
    .find_map(|(frozen, signal)| frozen.then_some(signal))
}

/// Whether one of the currents stood still, bit for bit, for the stuck time and longer, while the motor turned and another current
/// changed. The sum of the currents refuses such samples, so it is found among all that were received. At the end of the converter's range a
/// current stands still too, and is refused as that.
pub(super) fn one_current_stuck(slots: &[Slot], limits: &Limits) -> bool {
    let motor = |s: &SensedSample| s.motor_counts as f64 * limits.rotor.motor_lsb;
    let end_a = limits.full_scale_a - 1.5 * limits.current_lsb_a;
    (0..3).any(|phase| {
        stands_while(
            slots.iter().filter(|s| s.was_received() && s.is_good(Part::Motor)),
            limits.lengths.stuck,
            |a, b| a.currents[phase].abs() < end_a && is_held(a, b, phase),
            |a, b| (0..3).any(|n| !is_held(a, b, n)) && (motor(b) - motor(a)).abs() > MOTION_RAD,
        )
    })
}

/// Whether a current is the same, bit for bit, but for the sign of 0 A, which the phases of a rotating vector have.
fn is_held(a: &SensedSample, b: &SensedSample, phase: usize) -> bool {
    let [a, b] = [a, b].map(|sample| sample.currents[phase] + 0.0);
    a.to_bits() == b.to_bits()
}

/// How many times longer a quadrature current alone may read 0 A while the motor turns.
const RUN_DOWN_FACTOR: usize = 10;

/// Turn of the motor in which its currents must change, rad: two thirds of an electrical radian and more.
const MOTION_RAD: f64 = 0.25;

/// Whether there is a run of `same` samples, `needed` long, from whose start another signal `moved`.
fn stands_while<'a>(
    slots: impl Iterator<Item = &'a Slot>,
    needed: usize,
    same: impl Fn(&SensedSample, &SensedSample) -> bool,
    moved: impl Fn(&SensedSample, &SensedSample) -> bool,
) -> bool {
    let mut start: Option<(&SensedSample, usize)> = None;
    for Slot { sample, .. } in slots {
        match &mut start {
            Some((first, run)) if same(first, sample) => {
                *run += 1;
                if *run >= needed && moved(first, sample) {
                    return true;
                }
            }
            _ => start = Some((sample, 1)),
        }
    }
    false
}

#[cfg(test)]
mod tests;
