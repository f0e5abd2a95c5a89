//! Findings of currents and resolver: wiring, offsets, gains, zero, age.

use ema_models::ActuatorParams;

use super::{Finding, suspicion};
use crate::sensor_checks::correction::Correction;
use crate::sensor_checks::currents::{CurrentError, ZERO_MIN};
use crate::sensor_checks::offset_of_sum::{SumOffset, offset_of_sum};
use crate::sensor_checks::signals::Signals;
use crate::sensor_checks::suspect::{Suspect, Suspicion};
use crate::sensor_checks::wiring::{FAR, FarZero, OnTorqueAxis, Wiring};

/// Names of the phases.
const PHASES: [char; 3] = ['a', 'b', 'c'];

pub(super) fn of_wiring(params: &ActuatorParams, found: &OnTorqueAxis, configured: f64) -> Finding {
    let [now, then] = [configured, found.share].map(|share| 100.0 * share);
    let shares = format!("{then:.0} % of the current lies on the torque axis then, {now:.0} % now");
    let (suspect, what, correction) = match found.wiring {
        Wiring::Swapped(one, other) => (
            Suspect::PhaseOrder,
            format!("{} and {} seem swapped", PHASES[one.min(other)], PHASES[one.max(other)]),
            Some(Correction::Swap(one, other)),
        ),
        Wiring::Reversed(phase) => (
            Suspect::CurrentSign,
            format!("{} seems reversed", PHASES[phase]),
            Some(reversed(phase)),
        ),
        Wiring::ResolverReversed => (
            Suspect::ResolverDirection,
            "it seems to count backwards".to_owned(),
            Some(Correction::ResolverReversed),
        ),
        Wiring::ResolverTimes(times) => (
            Suspect::ResolverCounts,
            format!("it seems to count {times:.2} times what is configured"),
            None,
        ),
        Wiring::PolePairs(pole_pairs) => (
            Suspect::PolePairs,
            format!(
                "the motor seems to have {pole_pairs:.0}, not {:.0}",
                params.motor.pole_pairs
            ),
            Some(Correction::PolePairs(pole_pairs)),
        ),
        Wiring::CurrentsLate(late) => (Suspect::SampleOrder, currents_late(late), Some(Correction::Later(late))),
        Wiring::Right => (Suspect::PhaseOrder, String::new(), None),
    };
    Finding::new(suspect, &format!("{what}: {shares}"), correction)
}

/// Currents that are so many samples older than the angles, in words.
fn currents_late(late: isize) -> String {
    let (what, count) = (if late > 0 { "currents" } else { "angles" }, late.unsigned_abs());
    let samples = if count == 1 { "sample" } else { "samples" };
    format!("the {what} seem to be {count} {samples} late")
}

/// A far zero, and every wiring that turns the currents alike: all reversed by half a turn, phases in cyclic order by a third.
pub(super) fn of_far_zero(params: &ActuatorParams, far: &FarZero) -> Finding {
    let ahead = far.ahead.to_degrees();
    let evidence = format!(
        "{ahead:+.1}° electrical ahead of the rotor: {:.0} % of the current lies on the torque axis then",
        100.0 * far.share
    );
    let mut finding = Finding::new(
        Suspect::ResolverZero,
        &evidence,
        Some(Correction::ResolverZero(counts_of(params, far.ahead))),
    );
    let others = &mut finding.suspicions;
    let half_turn_less = ahead - 180_f64.copysign(ahead);
    let is_cyclic = |ahead: f64| (ahead.abs() - 120.0).abs() < ZERO_MIN.to_degrees();
    if is_cyclic(ahead) {
        others.push(suspicion(Suspect::PhaseOrder, "all seem shifted by one place"));
    } else if is_cyclic(half_turn_less) {
        others.push(suspicion(
            Suspect::PhaseOrder,
            "all seem shifted by one place and reversed",
        ));
    }
    if ahead.abs() > 90.0 {
        let evidence =
            format!("all seem reversed, and the resolver {half_turn_less:+.1}° electrical ahead of the rotor");
        others.push(suspicion(Suspect::CurrentSign, &evidence));
    }
    let or_late = far.or_late.map(currents_late);
    others.extend(or_late.map(|evidence| suspicion(Suspect::SampleOrder, &evidence)));
    finding
}

/// Resolver counts of an electrical angle, rad.
fn counts_of(params: &ActuatorParams, electrical: f64) -> i64 {
    (electrical / params.motor.pole_pairs / params.sensors.motor_lsb()).round() as i64
}

fn reversed(phase: usize) -> Correction {
    let mut gain = [1.0; 3];
    gain[phase] = -1.0;
    Correction::Currents { offset: [0.0; 3], gain }
}

pub(super) fn of_currents(params: &ActuatorParams, error: &CurrentError) -> Finding {
    match *error {
        CurrentError::Offsets { offset, or_rotor } => of_offsets(offset, or_rotor),
        CurrentError::Sum(sum) => Finding::new(Suspect::CurrentOffset, &of_phases_together(sum), None),
        CurrentError::Gain(phase, gain) => {
            let mut gains = [1.0; 3];
            gains[phase] = gain;
            let correction = Correction::Currents {
                offset: [0.0; 3],
                gain: gains,
            };
            let (suspect, correction) = if gain < 0.0 {
                (Suspect::CurrentSign, Some(reversed(phase)))
            } else {
                (Suspect::PhaseGain, (gain > 0.2).then_some(correction))
            };
            let evidence = format!(
                "{} reads {gain:.2} times what the two others leave for it",
                PHASES[phase]
            );
            Finding::new(suspect, &evidence, correction)
        }
        CurrentError::Zero { ahead, sigma, or_late } if ahead.abs() > FAR => {
            let mut finding = of_zero_or_opposite(ahead.to_degrees(), sigma.to_degrees());
            finding.suspicions.extend(or_late.map(of_age));
            finding
        }
        CurrentError::Zero { ahead, sigma, or_late } => {
            let (degrees, sigma) = (ahead.to_degrees(), sigma.to_degrees());
            let counts = counts_of(params, ahead);
            let evidence = format!("{degrees:+.1} ± {sigma:.1}° electrical ahead of the rotor");
            let mut finding = Finding::new(Suspect::ResolverZero, &evidence, Some(Correction::ResolverZero(counts)));
            finding.suspicions.extend(or_late.map(of_age));
            finding
        }
        CurrentError::Late(late) => {
            let samples = (late * params.sensors.sample_rate).round() as isize;
            Finding {
                suspicions: vec![of_age(late)],
                correction: Some(Correction::Later(samples)),
                or_part: false,
            }
        }
    }
}

fn of_offsets(offset: [f64; 3], or_part: bool) -> Finding {
    let all: Vec<String> = PHASES
        .iter()
        .zip(offset)
        .map(|(phase, offset)| format!("{phase} {:+.0} mA", 1e3 * offset))
        .collect();
    let correction = Correction::Currents { offset, gain: [1.0; 3] };
    Finding {
        or_part,
        ..Finding::new(Suspect::CurrentOffset, &all.join(", "), Some(correction))
    }
}

/// Offsets of the sum that the direct current does not show, beyond `limit` for one phase. What a tolerance explains as well is taken out only
/// where the estimate asks for it.
pub(super) fn of_sum(signals: &Signals, params: &ActuatorParams, sum: f64, limit: f64) -> Option<Finding> {
    match offset_of_sum(signals, params, sum, limit) {
        Some(SumOffset::OfPhase(phase)) => {
            let mut offset = [0.0; 3];
            offset[phase] = sum;
            Some(of_offsets(offset, sum.abs() <= limit))
        }
        Some(SumOffset::OfAll) => (sum.abs() > 3.0 * limit).then(|| of_offsets([sum / 3.0; 3], false)),
        // Three sensors within their tolerances sum to so much seldom.
        None => (sum.abs() > 3_f64.sqrt() * limit)
            .then(|| Finding::new(Suspect::CurrentOffset, &of_phases_together(sum), None)),
    }
}

fn of_phases_together(sum: f64) -> String {
    format!(
        "the phases sum to {:+.0} mA, the torque does not tell which it is",
        1e3 * sum
    )
}

/// A zero far off whose half turn no torque tells, and every wiring that turns the currents alike.
fn of_zero_or_opposite(degrees: f64, sigma: f64) -> Finding {
    let opposite = degrees - 180_f64.copysign(degrees);
    let evidence = format!("{degrees:+.1} or {opposite:+.1} ± {sigma:.1}° electrical ahead of the rotor");
    let mut finding = Finding::new(Suspect::ResolverZero, &evidence, None);
    let is_cyclic = |ahead: f64| (ahead.abs() - 120.0).abs() < ZERO_MIN.to_degrees();
    if is_cyclic(degrees) || is_cyclic(opposite) {
        let evidence = "all seem shifted by one place, or shifted and reversed";
        finding.suspicions.push(suspicion(Suspect::PhaseOrder, evidence));
    }
    finding
}

pub(super) fn of_limit(params: &ActuatorParams, gain: f64) -> Finding {
    let limit = params.motor.i_max;
    let evidence = format!(
        "all phases hold {:.2} A, {gain:.2} times the limit of the drive",
        gain * limit
    );
    let correction = Correction::Currents {
        offset: [0.0; 3],
        gain: [gain; 3],
    };
    Finding::new(Suspect::CurrentGain, &evidence, Some(correction))
}

fn of_age(late: f64) -> Suspicion {
    suspicion(
        Suspect::SampleOrder,
        &format!("the currents seem to be {:.2} ms older than the angles", 1e3 * late),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_far_zero_whose_half_turn_is_open_is_not_taken_out() {
        let params = ActuatorParams::bench();
        let at = |degrees: f64| {
            let error = CurrentError::Zero {
                ahead: degrees.to_radians(),
                sigma: 0.01,
                or_late: None,
            };
            of_currents(&params, &error)
        };
        let near = at(12.0);
        assert!(near.correction.is_some() && near.suspicions.len() == 1, "{near:?}");
        let far = at(-58.7);
        assert_eq!(far.correction, None);
        let named: Vec<Suspect> = far.suspicions.iter().map(|suspicion| suspicion.suspect).collect();
        assert_eq!(named, [Suspect::ResolverZero, Suspect::PhaseOrder]);
        assert!(far.suspicions[0].sentence.contains("-58.7 or +121.3"), "{far:?}");
    }
}
