//! The currents: which readings cannot be used, and whether a signal is stuck.

use super::check::Limits;
use super::config::CURRENT_SUM_MAX_A;
use super::ring::Slot;
use super::verdict::{Defect, Part, Signal};
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

fn current_defect(currents: [f64; 3], limits: &Limits) -> Option<Defect> {
    let largest = currents.iter().fold(0.0, |max: f64, i| max.max(i.abs()));
    if currents.iter().any(|i| !i.is_finite()) {
        Some(Defect::NotFinite)
    } else if largest > limits.full_scale_a + 1.5 * limits.current_lsb_a {
        Some(Defect::BeyondScale)
    } else if largest > limits.full_scale_a - 1.5 * limits.current_lsb_a {
        // The positive end of a two's complement converter is one step short of full scale.
        Some(Defect::Clipped)
    } else if currents.iter().sum::<f64>().abs() > CURRENT_SUM_MAX_A {
        Some(Defect::CurrentSum)
    } else {
        None
    }
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

    let frozen_currents = stands_while(
        slots.iter().filter(|s| currents_good(s) && motor_good(s)),
        limits.lengths.stuck,
        |a, b| a.currents.map(f64::to_bits) == b.currents.map(f64::to_bits),
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
