//! Readings that contradict what the motion says without them.
//!
//! The estimate of a window infers load, link voltage and torque for each ampere from all other signals, faults and tolerances free
//! (`ema_identify::InferredReadings`), each with its standard deviation. What lies further from the reading than both explain is named. A
//! window that does not show a quantity infers it with a large deviation, and names nothing.

use std::ops::RangeInclusive;

use ema_identify::relations::is_coarsely_sampled;
use ema_identify::unit_calibration::Seen;
use ema_identify::{Estimate, Inferred};
use ema_models::DriveKind;

use super::correction::{Correction, LINK_POSSIBLE};
use super::suspect::{Suspect, Suspicion};
use crate::motion::load_sigma_by_temperature;
use crate::outbox::WindowJob;

/// One reading that is contradicted.
#[derive(Clone, Debug, PartialEq)]
pub struct Contradiction {
    /// The sensor, with the evidence.
    pub suspicion: Suspicion,
    /// How it is taken out.
    pub correction: Correction,
}

/// Standard deviations from which on a reading is contradicted.
const SIGMAS: f64 = 4.0;

/// Error of an inferred load: share of it by the efficiencies of the gear, share of the friction torque at the output.
const LOAD_SHARE: f64 = 0.1;
const FRICTION_SHARE: f64 = 0.05;

/// Scatter of the friction of one unit as it warms up, as a share.
const FRICTION_SCATTER: f64 = 0.15;

/// The readings of a window that its estimate contradicts; `commissioned` are the winding temperatures at which the unit was commissioned, °C,
/// where it was; `load_error` is the largest difference of found and measured load in its healthy windows, Nm.
#[must_use]
pub fn contradictions(
    job: &WindowJob,
    estimate: &Estimate,
    commissioned: Option<Option<[f64; 2]>>,
    load_error: f64,
) -> Vec<Contradiction> {
    let mut found: Vec<Contradiction> = load(job, estimate, commissioned, load_error)
        .into_iter()
        .chain(link(job, estimate))
        .collect();
    if let (Some(temperatures), [Some(a), Some(b), Some(c)]) = (commissioned, estimate.inferred.turns) {
        let read = job.conditions.winding_temp_deg_c;
        let turns = [a, b, c].map(|turns| at_commissioning(turns, read, temperatures));
        let by_gain = current_gain(&turns, expected_torque(read, temperatures), estimate.inferred.friction);
        found.extend(by_gain.or_else(|| temperature(&turns, read?, temperatures?)));
    }
    found
}

fn contradiction(suspect: Suspect, evidence: &str, correction: Correction) -> Contradiction {
    Contradiction {
        suspicion: Suspicion {
            suspect,
            sentence: format!("{suspect}: {evidence}"),
        },
        correction,
    }
}

/// The reading against the load that the motion needs, and, where it tells load and friction only together, against the loads between
/// friction that is not worn and worn to its limit. Coarse samples do not tell a load: what they leave of the torque repeats with the motion.
fn load(
    job: &WindowJob,
    estimate: &Estimate,
    commissioned: Option<Option<[f64; 2]>>,
    load_error: f64,
) -> Option<Contradiction> {
    let read = job
        .conditions
        .load_torque_nm
        .filter(|_| !is_coarsely_sampled(&job.params))?;
    // One scale of the friction does not follow a lubricant that is warmer, or colder, than at commissioning.
    let worn = estimate.inferred.friction.map_or(1.0, |friction| friction.value);
    let of_lubricant = commissioned.map_or(0.0, |temperatures| load_sigma_by_temperature(job, temperatures, worn));
    let load_sigma = |inferred: &Inferred, share: f64| load_sigma(job, inferred, share).hypot(of_lubricant);
    let off = |inferred: Inferred, share: f64| beyond(inferred.value - read, load_error) / load_sigma(&inferred, share);
    let needed = |Inferred { value, .. }: Inferred, sigma: f64| {
        let evidence = format!("reads {read:.1} N m, the motion needs {value:.1} ± {sigma:.1} N m");
        contradiction(Suspect::LoadSensor, &evidence, Correction::NoLoad)
    };
    let inferred = estimate.inferred.load_torque;
    if let Some(inferred) = inferred.filter(|inferred| off(*inferred, FRICTION_SHARE).abs() > SIGMAS) {
        return Some(needed(inferred, load_sigma(&inferred, FRICTION_SHARE)));
    }
    let [unworn, worn] = estimate.inferred.load_by_friction?;
    let off = [unworn, worn].map(|load| off(load, FRICTION_SCATTER));
    let is_beyond = off.iter().all(|&off| off > SIGMAS) || off.iter().all(|&off| off < -SIGMAS);
    is_beyond.then(|| {
        let [least, most] = [unworn.value.min(worn.value), unworn.value.max(worn.value)];
        let sigma = load_sigma(&unworn, FRICTION_SCATTER);
        let evidence = format!(
            "reads {read:.1} N m, the motion needs {least:.1} to {most:.1} ± {sigma:.1} N m, whatever its friction"
        );
        contradiction(Suspect::LoadSensor, &evidence, Correction::NoLoad)
    })
}

/// What a difference is beyond an error that it may have either way.
fn beyond(difference: f64, error: f64) -> f64 {
    difference - difference.clamp(-error, error)
}

/// Standard deviation of an inferred load, Nm, what the gear's losses add included.
fn load_sigma(job: &WindowJob, load: &Inferred, friction_share: f64) -> f64 {
    let transmission = &job.params.transmission;
    let friction = transmission.friction_dynamic * transmission.gear_ratio;
    let size = load.value.abs().max(job.conditions.load_torque_nm.unwrap_or(0.0).abs());
    load.sigma.hypot(LOAD_SHARE * size).hypot(friction_share * friction)
}

/// Usual tolerance of a link voltage as a share, where the configuration calls it exact.
const LINK_TOLERANCE: f64 = 0.02;

fn link(job: &WindowJob, estimate: &Estimate) -> Option<Contradiction> {
    let (read, nominal) = (job.conditions.dc_link_v?, job.params.motor.v_dc);
    link_off(read, nominal, link_tolerance(job), inferred_link(job, estimate))
}

/// The motion against the reading, where the estimator knows the limit of the voltage; else the reading against the configuration.
fn link_off(read: f64, nominal: f64, tolerance: f64, inferred: Option<Inferred>) -> Option<Contradiction> {
    let is_off = |voltage: f64, sigma: f64, from: f64| (voltage - from).abs() > SIGMAS * sigma.hypot(tolerance * from);
    if let Some(Inferred { value, sigma }) = inferred {
        let is_possible = LINK_POSSIBLE.contains(&(value / nominal));
        // A link below the reading is no evidence: a vector drive, which nobody may have told, does not apply all that it has.
        if is_off(value, sigma, read) && is_possible && value > read {
            let evidence = format!("reads {read:.0} V, the currents need {value:.0} ± {sigma:.0} V");
            return Some(contradiction(Suspect::DcLink, &evidence, Correction::Link(value)));
        }
        // The supply is off, and read rightly.
        if is_off(value, sigma, nominal) && !is_off(value, sigma, read) {
            return None;
        }
    }
    is_off(read, 0.0, nominal).then(|| {
        let own = tolerance * nominal;
        let evidence = format!("reads {read:.0} V, configured are {nominal:.0} ± {own:.0} V: its sensor or the supply");
        contradiction(Suspect::DcLink, &evidence, Correction::Link(nominal))
    })
}

/// Tolerance of the link voltage, as a share.
fn link_tolerance(job: &WindowJob) -> f64 {
    match job.actuator.tolerances.v_dc {
        exact if exact <= 0.0 => LINK_TOLERANCE,
        share => share,
    }
}

/// Standard deviation of an inferred voltage up to which its line through the estimate holds, as a share.
const LINK_SIGMA_MAX: f64 = 0.08;

/// The link voltage that the currents need, where the estimator knows the drive and the motion came near the limit of its voltage.
fn inferred_link(job: &WindowJob, estimate: &Estimate) -> Option<Inferred> {
    let is_known = job.actuator.drive.kind == DriveKind::Hysteresis;
    let sigma_max = LINK_SIGMA_MAX * job.params.motor.v_dc;
    estimate
        .inferred
        .dc_link
        .filter(|link| is_known && link.sigma <= sigma_max)
}

/// A torque for each ampere as a share of that at commissioning; the estimate has it as a share of what the temperature that is read lets
/// expect.
fn at_commissioning(turns: Inferred, read: Option<f64>, commissioned: Option<[f64; 2]>) -> Inferred {
    let seen = Seen {
        winding_temp_deg_c: commissioned,
        ..Seen::default()
    };
    let factor = seen.winding_temp(read).map_or(1.0, |temp| temp.torque_factor());
    Inferred {
        value: factor * turns.value,
        sigma: factor * turns.sigma,
    }
}

/// Change of the torque for each ampere with temperature, 1/K: magnets of samarium-cobalt and of neodymium.
const TORQUE_PER_KELVIN: [f64; 2] = [-0.4e-3, -1.2e-3];

/// Distance of a temperature that is not measured from any other, K.
const TEMPERATURE_RANGE_K: f64 = 90.0;

/// Range of the torque for each ampere, relative to that of the commissioned unit, that its temperature explains.
fn expected_torque(read: Option<f64>, commissioned: Option<[f64; 2]>) -> [f64; 2] {
    let rise = match (read, commissioned) {
        (Some(read), Some([low, high])) => [read - high, read - low],
        _ => [-TEMPERATURE_RANGE_K, TEMPERATURE_RANGE_K],
    };
    let all = rise.map(|rise| TORQUE_PER_KELVIN.map(|per_kelvin| 1.0 + per_kelvin * rise));
    let all = all.iter().flatten();
    [
        all.clone().copied().fold(f64::INFINITY, f64::min),
        all.copied().fold(f64::NEG_INFINITY, f64::max),
    ]
}

/// Change of the torque for each ampere, beyond that by temperature, that no tolerance explains.
const GAIN_OFF: f64 = 0.05;

/// The same beside a short, which changes one phase and not all: twice the usual tolerance of a gain.
const GAIN_OFF_BESIDE_SHORT: f64 = 0.02;

/// Least difference between the phases that is a short, and no gain of one sensor: four of its tolerances.
const SHORT_LEAST: f64 = 0.04;

/// Gains that sensors may have.
const GAIN_POSSIBLE: RangeInclusive<f64> = 0.5..=2.0;

/// Standard deviations of each phase; their mean is [`SIGMAS`] of its own off.
const PHASE_SIGMAS: f64 = 2.0;

/// A change of all phases to the same side, beyond `low` or `high` as the temperature explains it, by the phase with the most turns, and above
/// all its turns by the second, which a short leaves as well: a worn winding changes one phase, to less. Where the `friction` has changed as
/// much to the same side, all but the inertia has: the torque balance measures by it.
fn current_gain(turns: &[Inferred; 3], [low, high]: [f64; 2], friction: Option<Inferred>) -> Option<Contradiction> {
    let mut sorted = *turns;
    sorted.sort_by(|one, other| other.value.total_cmp(&one.value));
    let [most, second, least] = sorted;
    let short_sigma = most.sigma.hypot(least.sigma);
    let is_beside_short = most.value - least.value > SHORT_LEAST.max(SIGMAS * short_sigma);
    let off = if is_beside_short {
        GAIN_OFF_BESIDE_SHORT
    } else {
        GAIN_OFF
    };
    let [low, high] = [low - off, high + off];
    let weight = |x: &Inferred| 1.0 / (x.sigma * x.sigma);
    let mean_of = |turns: &[Inferred]| {
        let weights: f64 = turns.iter().map(weight).sum();
        let mean = turns.iter().map(|x| weight(x) * x.value).sum::<f64>() / weights;
        (mean, SIGMAS / weights.sqrt())
    };
    let (mean, clear) = mean_of(turns);
    let is_less = mean + clear < low && turns.iter().all(|x| x.value + PHASE_SIGMAS * x.sigma < low);
    let more: &[Inferred] = if is_beside_short {
        &[second, most]
    } else {
        &[least, second, most]
    };
    let (mean, clear) = mean_of(more);
    let is_more = mean - clear > high && more.iter().all(|x| x.value - PHASE_SIGMAS * x.sigma > high);
    let changed = match (is_less, is_more) {
        (true, _) => most,
        (_, true) => more[0],
        _ => return None,
    };
    let gain = 1.0 / changed.value;
    // Currents that fit no motion at all, as of exchanged phases, are no matter of their gain.
    if !GAIN_POSSIBLE.contains(&gain) {
        return None;
    }
    let sigma = changed.sigma * gain * gain;
    if let Some(friction) = friction.filter(|friction| is_as_inertia(friction, &changed)) {
        let evidence = format!(
            "it seems to be {gain:.2} ± {sigma:.2} times that of the commissioned unit: currents and friction, {:.2} ± {:.2} times, have both \
             changed against it",
            friction.value, friction.sigma
        );
        let correction = Correction::Currents {
            offset: [0.0; 3],
            gain: [gain; 3],
        };
        return Some(contradiction(Suspect::Inertia, &evidence, correction));
    }
    let or_magnets = if gain > 1.0 {
        format!(
            ", or the magnets are as much weaker, or all phases shorted by {:.2}",
            1.0 - changed.value
        )
    } else {
        String::new()
    };
    let evidence = format!(
        "all phases read {gain:.2} ± {sigma:.2} times the current that the motion needs of the commissioned unit{or_magnets}"
    );
    let correction = Correction::Currents {
        offset: [0.0; 3],
        gain: [gain; 3],
    };
    Some(contradiction(Suspect::CurrentGain, &evidence, correction))
}

/// Whether the friction has changed with the torque for each ampere, and not stayed: relative to the inertia both have.
fn is_as_inertia(friction: &Inferred, turns: &Inferred) -> bool {
    let sigma = friction.sigma.hypot(turns.sigma);
    (friction.value - turns.value).abs() < PHASE_SIGMAS * sigma && (friction.value - 1.0).abs() > PHASE_SIGMAS * sigma
}

/// Distance of a temperature from those of commissioning from which on it changes the torque visibly, K.
const TEMPERATURE_OFF_K: f64 = 30.0;

/// Standard deviations of the torque for each ampere that a temperature must explain.
const TORQUE_SIGMAS: f64 = 3.0;

/// A temperature far from those of commissioning, while the strongest phase makes the same torque: a worn winding weakens one.
fn temperature(turns: &[Inferred; 3], read: f64, [low, high]: [f64; 2]) -> Option<Contradiction> {
    let rise = if read < low { read - low } else { (read - high).max(0.0) };
    let [least, most] = TORQUE_PER_KELVIN.map(|per_kelvin| per_kelvin * rise);
    let strongest = turns
        .iter()
        .reduce(|most, x| if x.value > most.value { x } else { most })?;
    let change = strongest.value - 1.0;
    let margin = TORQUE_SIGMAS * strongest.sigma;
    let is_contradicted = if rise < 0.0 {
        change + margin < least
    } else {
        change - margin > least
    };
    (rise.abs() >= TEMPERATURE_OFF_K && is_contradicted).then(|| {
        let evidence = format!(
            "reads {read:.0} °C, which changes the torque for each ampere by {:+.1} to {:+.1} % since commissioning at {:.0} °C; the motion \
             needs {:+.1} ± {:.1} %",
            100.0 * least,
            100.0 * most,
            0.5 * (low + high),
            100.0 * change,
            100.0 * strongest.sigma
        );
        contradiction(Suspect::WindingTemperature, &evidence, Correction::NoTemperature)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turns(values: [f64; 3], sigma: f64) -> [Inferred; 3] {
        values.map(|value| Inferred { value, sigma })
    }

    fn gain_of(found: Option<Contradiction>) -> Option<f64> {
        match found?.correction {
            Correction::Currents { gain, .. } => Some(gain[0]),
            _ => None,
        }
    }

    #[test]
    fn a_gain_changes_all_phases_and_a_short_one() {
        let usual = expected_torque(Some(20.0), Some([18.0, 22.0]));
        assert!(usual[0] > 0.997 && usual[1] < 1.003);
        let shorted = turns([0.7, 1.0, 0.99], 0.004);
        assert_eq!(gain_of(current_gain(&shorted, usual, None)), None);
        let beside_a_short = turns([0.6, 0.875, 0.87], 0.004);
        assert!((gain_of(current_gain(&beside_a_short, usual, None)).unwrap() - 1.0 / 0.875).abs() < 1e-12);
        let low = turns([1.25, 1.26, 1.24], 0.004);
        assert!((gain_of(current_gain(&low, usual, None)).unwrap() - 1.0 / 1.24).abs() < 1e-12);
        // Not shown.
        assert_eq!(gain_of(current_gain(&turns([1.25; 3], 0.1), usual, None)), None);
        // A gain that alone stays unnamed, beside a short.
        let alone = turns([0.95, 0.948, 0.952], 0.004);
        assert_eq!(gain_of(current_gain(&alone, usual, None)), None);
        let small = turns([0.81, 0.948, 0.952], 0.004);
        let found = gain_of(current_gain(&small, usual, None)).unwrap();
        assert!((found - 1.0 / 0.952).abs() < 1e-12);
        // Currents that read too little, beside a short that hides in one of them.
        let found = gain_of(current_gain(&turns([0.89, 1.05, 1.052], 0.004), usual, None)).unwrap();
        assert!((found - 1.0 / 1.05).abs() < 1e-12);
        assert_eq!(
            gain_of(current_gain(&turns([0.95, 1.05, 1.0], 0.004), usual, None)),
            None
        );
        // Two phases are shorted.
        let two = turns([0.81, 0.95, 0.995], 0.004);
        assert_eq!(gain_of(current_gain(&two, usual, None)), None);
    }

    #[test]
    fn an_inertia_changes_friction_and_torque_alike_and_a_gain_the_torque_alone() {
        let usual = expected_torque(Some(20.0), Some([18.0, 22.0]));
        let all = turns([0.91, 0.905, 0.912], 0.004);
        let named = |value: f64| {
            let friction = Some(Inferred { value, sigma: 0.03 });
            current_gain(&all, usual, friction).map(|found| found.suspicion.suspect)
        };
        assert_eq!(named(0.9), Some(Suspect::Inertia));
        assert_eq!(named(1.0), Some(Suspect::CurrentGain));
        assert_eq!(named(1.4), Some(Suspect::CurrentGain));
        let untold = current_gain(&all, usual, None).unwrap();
        assert_eq!(untold.suspicion.suspect, Suspect::CurrentGain);
    }

    #[test]
    fn a_drive_that_applies_less_than_the_link_accuses_no_sensor() {
        let link = |read: f64, value: f64| link_off(read, 380.0, 0.02, Some(Inferred { value, sigma: 12.0 }));
        let corrected = |found: Option<Contradiction>| match found?.correction {
            Correction::Link(voltage) => Some(voltage),
            _ => None,
        };
        // A vector drive where comparators are assumed.
        assert_eq!(link(380.0, 309.0), None);
        assert_eq!(corrected(link(323.0, 385.0)), Some(385.0));
        assert_eq!(corrected(link(456.0, 375.0)), Some(380.0));
        // A supply that is off and read rightly.
        assert_eq!(link(456.0, 450.0), None);
    }

    #[test]
    fn cold_magnets_are_no_gain_and_a_sensor_that_makes_them_cold_is_named() {
        let commissioned = [20.0, 20.0];
        let cold = expected_torque(Some(-40.0), Some(commissioned));
        assert!((cold[0] - 1.024).abs() < 1e-12 && (cold[1] - 1.072).abs() < 1e-12);
        let as_cold = turns([1.06; 3], 0.004);
        assert!(current_gain(&as_cold, cold, None).is_none() && temperature(&as_cold, -40.0, commissioned).is_none());
        // One phase is shorted.
        let as_warm = turns([1.001, 0.999, 0.6], 0.004);
        let found = temperature(&as_warm, -40.0, commissioned).unwrap();
        assert_eq!(found.suspicion.suspect, Suspect::WindingTemperature);
        assert_eq!(
            found.suspicion.sentence,
            "winding temperature: reads -40 °C, which changes the torque for each ampere by +2.4 to +7.2 % since commissioning at 20 °C; \
             the motion needs +0.1 ± 0.4 %"
        );
        // Not shown, and as it was.
        assert!(temperature(&turns([1.0; 3], 0.02), -40.0, commissioned).is_none());
        assert!(temperature(&as_warm, 25.0, commissioned).is_none());
    }
}
