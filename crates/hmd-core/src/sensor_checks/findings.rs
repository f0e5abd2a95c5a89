//! What the signals of a window show by themselves, before any estimate.

use ema_models::{ActuatorParams, DriveKind, Tolerances};

use super::angles::{
    FrozenOutput, SetpointError, SuddenStop, followed_to_rest, frozen_output, output_over_motor, output_over_setpoint,
    setpoint_error, sudden_stop,
};
use super::control_law::{gain_at_limit, link_by_law};
use super::correction::Correction;
use super::current_limit::gain_beyond_limit;
use super::currents::{CurrentError, ZERO_MIN, current_errors, gain_of_a_phase, offset_limit};
use super::gear_ratio::precise_ratio;
use super::motor_time::motor_time;
use super::offset_of_sum::{SumOffset, offset_of_sum};
use super::signals::Signals;
use super::suspect::{Suspect, Suspicion};
use super::torque::{Balance, balance};
use super::wiring::{FAR, FarZero, OnTorqueAxis, Wiring, far_zero, other_wiring};
use crate::outbox::WindowJob;
use crate::window::{Defect, Invalidity, WindowQuality};

/// One mistake that a window shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// What it is; several where the window does not tell them apart.
    pub suspicions: Vec<Suspicion>,
    /// How it is taken out; `None` where the window is of no use.
    pub correction: Option<Correction>,
    /// Whether a worn part explains the signals alike: only the estimate tells.
    pub or_part: bool,
}

impl Finding {
    pub(super) fn new(suspect: Suspect, evidence: &str, correction: Option<Correction>) -> Self {
        Self {
            suspicions: vec![suspicion(suspect, evidence)],
            correction,
            or_part: false,
        }
    }
}

fn suspicion(suspect: Suspect, evidence: &str) -> Suspicion {
    Suspicion {
        suspect,
        sentence: format!("{suspect}: {evidence}"),
    }
}

/// Names of the phases.
const PHASES: [char; 3] = ['a', 'b', 'c'];

/// The mistakes that the signals of a window show; of an invalid one only those that make it so.
#[must_use]
pub fn examine(job: &WindowJob) -> Vec<Finding> {
    let (params, samples) = (&job.params, &job.window.samples);
    let signals = Signals::new(params, samples, &job.window.filled);
    if let Some(stop) = sudden_stop(&signals, params) {
        return vec![of_stop(&stop)];
    }
    if let Some(frozen) = frozen_output(&signals, params) {
        return vec![of_frozen(&frozen)];
    }
    let ratio = output_over_motor(&signals, params);
    if job.actuator.has_output_angle()
        && let Some(time) = motor_time(&signals, params)
    {
        return vec![time.into()];
    }
    if let Some(far) = far_zero(&signals, params) {
        return vec![of_far_zero(params, &far)];
    }
    if let Some((found, configured)) = other_wiring(&signals, params, ratio) {
        return vec![of_wiring(params, &found, configured)];
    }
    let mut findings: Vec<Finding> = Vec::new();
    findings.extend(ratio.and_then(|ratio| of_ratio(params, ratio, &signals)));
    // Where the output lies in its play, and so the flank of a motion that has begun before, is not known.
    let is_in_motion = matches!(
        job.window.quality,
        WindowQuality::Invalid(Invalidity::StartInMotion { .. })
    );
    if findings.is_empty() && !is_in_motion {
        findings.extend(precise_ratio(&signals, params).map(|ratio| of_precise_ratio(params, ratio, &signals)));
    }
    if findings.is_empty() {
        // Without an encoder no zero of one is wrong.
        let error = setpoint_error(&signals, params, job.window.trigger)
            .filter(|error| job.actuator.has_output_angle() || !is_of_zero(error));
        findings.extend(error.map(|error| of_setpoint(params, error)));
    }
    let tolerances = tolerances_of_sensors(&job.actuator.tolerances);
    if let WindowQuality::Invalid(invalidity) = &job.window.quality {
        let is_by_currents = matches!(
            invalidity,
            Invalidity::TooManyFlawed {
                defect: Defect::CurrentSum,
                ..
            }
        );
        if is_by_currents {
            findings.extend(gain_of_a_phase(&signals, tolerances).map(|error| of_currents(params, &error)));
        }
        return findings;
    }
    for error in current_errors(&signals, tolerances) {
        findings.extend(match error {
            CurrentError::Sum(sum) => of_sum(&signals, params, sum, offset_limit(&signals, tolerances)),
            error => Some(of_currents(params, &error)),
        });
    }
    if findings.is_empty() {
        findings.extend(of_link(job, &signals, tolerances));
    }
    if findings.is_empty() {
        let balance = balance(&signals, params);
        findings.extend(balance.and_then(|balance| of_torque(job, &balance)));
        if findings.is_empty() {
            let by_law = gain_at_limit(&signals, params, tolerances, job.window.trigger);
            findings.extend(by_law.and_then(|gain| of_law(gain, balance.as_ref())));
        }
    }
    if findings.is_empty() {
        findings.extend(gain_beyond_limit(&signals, tolerances).map(|gain| of_limit(params, gain)));
    }
    findings
}

/// Whether an encoder's zero would show so.
fn is_of_zero(error: &SetpointError) -> bool {
    matches!(error, SetpointError::Zero(_) | SetpointError::ZeroOrScale(_))
}

/// The link, where a vector drive lacks voltage that is read; comparators are in the monitor.
fn of_link(job: &WindowJob, signals: &Signals, tolerances: &Tolerances) -> Option<Finding> {
    let read = job
        .conditions
        .dc_link_v
        .filter(|_| job.actuator.drive.kind == DriveKind::Vector)?;
    let (shown, sigma) = link_by_law(signals, &job.params, tolerances, job.window.trigger, read)?;
    let evidence = format!(
        "reads {read:.0} V, the motor gets no more than {shown:.0} ± {sigma:.0} V when the drive asks for more"
    );
    Some(Finding::new(Suspect::DcLink, &evidence, Some(Correction::Link(shown))))
}

/// Margin by which the torque of the currents must speak for another number of the law, as a share of it: worn windings.
const LAW_WRONG: f64 = 0.1;

/// The gain by the law of the drive, unless the torque balance says that the currents are right and the law is not.
fn of_law((gain, sigma): (f64, f64), balance: Option<&Balance>) -> Option<Finding> {
    if let Some((torque, torque_sigma)) = balance.map(|balance| balance.gain) {
        let is_known = torque_sigma < 0.5 * LAW_WRONG;
        if is_known && (torque - 1.0).abs() + LAW_WRONG < (torque * gain - 1.0).abs() {
            return None;
        }
    }
    let evidence = format!("all phases read {gain:.2} ± {sigma:.2} times the current that the drive asks for");
    let correction = Correction::Currents {
        offset: [0.0; 3],
        gain: [gain; 3],
    };
    Some(Finding::new(Suspect::CurrentGain, &evidence, Some(correction)))
}

fn of_stop(stop: &SuddenStop) -> Finding {
    let evidence = format!(
        "the counts stand from one sample to the next at {:.0} rad/s, which takes {:.0} times the largest torque",
        stop.speed, stop.torque_share
    );
    Finding::new(Suspect::ResolverFrozen, &evidence, None)
}

fn of_frozen(frozen: &FrozenOutput) -> Finding {
    let evidence = format!(
        "the counts stand while the motor turns the output by {:.2} mrad, behind a play of {:.2} mrad before",
        1e3 * frozen.turned,
        1e3 * frozen.play
    );
    Finding::new(Suspect::EncoderFrozen, &evidence, None)
}

/// Tolerances of the sensors; where the configuration calls every number exact, the usual ones: no sensor is exact.
fn tolerances_of_sensors(tolerances: &Tolerances) -> &Tolerances {
    if tolerances.current_offset > 0.0 {
        tolerances
    } else {
        &Tolerances::USUAL
    }
}

fn of_wiring(params: &ActuatorParams, found: &OnTorqueAxis, configured: f64) -> Finding {
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
fn of_far_zero(params: &ActuatorParams, far: &FarZero) -> Finding {
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

/// Deviation of the ratio of output and motor from 1 that is no play.
const RATIO_OFF: f64 = 0.08;

fn of_ratio(params: &ActuatorParams, ratio: f64, signals: &Signals) -> Option<Finding> {
    if (ratio - 1.0).abs() < RATIO_OFF {
        return None;
    }
    if ratio < 0.0 {
        let evidence = format!("the output turns {ratio:.2} times as far as the motor, across the gear");
        return Some(Finding::new(
            Suspect::EncoderDirection,
            &evidence,
            Some(Correction::EncoderReversed),
        ));
    }
    let configured = params.transmission.gear_ratio;
    if let Some(scale) = output_over_setpoint(signals).filter(|scale| is_of_encoder(*scale, ratio)) {
        let evidence = format!(
            "the output seems to turn {scale:.2} times as far as commanded, and {ratio:.2} times as far as the motor"
        );
        return Some(Finding::new(Suspect::EncoderCounts, &evidence, None));
    }
    Some(match setpoint_error(signals, params, 2) {
        Some(SetpointError::Scale(scale)) => {
            let evidence = format!(
                "the output seems to turn {scale:.2} times as far as commanded, and {ratio:.2} times as far as the motor"
            );
            Finding::new(Suspect::EncoderCounts, &evidence, None)
        }
        _ => {
            let real = configured / ratio;
            let evidence = format!(
                "it seems to be {real:.1}, not {configured:.1}: the output turns {ratio:.2} times as far as the motor"
            );
            Finding::new(Suspect::GearRatio, &evidence, Some(Correction::GearRatio(real)))
        }
    })
}

/// Share of an error of the ratio by which an output with right counts may miss its set point at the end of a motion.
const AT_SETPOINT: f64 = 0.3;

/// The gear ratio, or the encoder's counts where the output does not come to rest at the set point.
fn of_precise_ratio(params: &ActuatorParams, (ratio, sigma): (f64, f64), signals: &Signals) -> Finding {
    let configured = params.transmission.gear_ratio;
    let (real, counts) = (configured / ratio, params.sensors.output_counts_per_rev);
    let evidence = format!(
        "it seems to be {real:.1} ± {:.1}, not {configured:.1}: the output turns {ratio:.3} times as far as the motor",
        real * sigma
    );
    let mut finding = Finding::new(Suspect::GearRatio, &evidence, Some(Correction::GearRatio(real)));
    let is_at_setpoint =
        followed_to_rest(signals).is_some_and(|followed| (followed - 1.0).abs() < AT_SETPOINT * (ratio - 1.0).abs());
    if !is_at_setpoint {
        let evidence = format!("they seem to be {:.0}, not {counts:.0}", counts * ratio);
        finding.suspicions.push(suspicion(Suspect::EncoderCounts, &evidence));
    }
    finding
}

/// Whether the output is so far from the set point, and from the motor, that only its own scale explains both: the ratio to the set point
/// is beyond what a lag or an overshoot leaves and nearer to that to the motor than to 1.
fn is_of_encoder(to_setpoint: f64, to_motor: f64) -> bool {
    !(1.0 / LAG..=OVERSHOOT).contains(&to_setpoint) && (to_setpoint / to_motor).ln().abs() < to_setpoint.ln().abs()
}

/// Factor by which an overshoot exceeds the set point.
const OVERSHOOT: f64 = 1.3;

/// Factor by which a lag reduces what the output makes of the set point.
const LAG: f64 = 3.0;

fn of_setpoint(params: &ActuatorParams, error: SetpointError) -> Finding {
    match error {
        SetpointError::Unit(times) => Finding::new(
            Suspect::SetpointUnit,
            &format!("it moves {times:.1} times as far as the output that follows it"),
            None,
        ),
        SetpointError::Reversed => Finding::new(
            Suspect::EncoderDirection,
            "the output follows the set point in the other direction",
            None,
        ),
        SetpointError::Scale(scale) => Finding::new(
            Suspect::EncoderCounts,
            &format!("the output comes to rest after {scale:.2} times what is commanded"),
            None,
        ),
        SetpointError::Late(speed) => Finding::new(
            Suspect::SetpointDelay,
            &format!("the motor turns at {speed:.0} rad/s before the set point moves"),
            None,
        ),
        SetpointError::SetpointScale(scale) => Finding::new(
            Suspect::SetpointUnit,
            &format!(
                "it moves {scale:.3} times as far as the output, from rest to rest, and the drive makes no torque"
            ),
            Some(Correction::Setpoint(scale)),
        ),
        SetpointError::ZeroOrScale(error) => {
            let mut finding = of_setpoint(params, SetpointError::Zero(error));
            let evidence = "another scale of it looks the same where no rest follows";
            finding.suspicions.push(suspicion(Suspect::SetpointUnit, evidence));
            finding
        }
        SetpointError::Zero(error) => {
            let counts = (-error / params.sensors.output_lsb()).round() as i64;
            let evidence = format!(
                "at rest the output is {:.4} rad from its set point, and the drive makes no torque",
                -error
            );
            Finding::new(Suspect::EncoderZero, &evidence, Some(Correction::EncoderZero(counts)))
        }
    }
}

fn of_currents(params: &ActuatorParams, error: &CurrentError) -> Finding {
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
fn of_sum(signals: &Signals, params: &ActuatorParams, sum: f64, limit: f64) -> Option<Finding> {
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

fn of_limit(params: &ActuatorParams, gain: f64) -> Finding {
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

/// Standard deviations of a load that its sensor reads otherwise.
const LOAD_SIGMAS: f64 = 3.0;

/// Standard deviations of the gain of currents that are reversed.
const FIT_SIGMAS: f64 = 5.0;

/// Share of a load, and of the friction at the output, by which the balance errs: efficiencies of the gear.
const LOAD_SHARE: f64 = 0.25;
const FRICTION_SHARE: f64 = 0.15;

fn of_torque(job: &WindowJob, balance: &Balance) -> Option<Finding> {
    let (gain, sigma) = balance.gain;
    if gain < -FIT_SIGMAS * sigma {
        let evidence = format!("all seem reversed: the motion needs {gain:.2} times the torque of the currents");
        let correction = Correction::Currents {
            offset: [0.0; 3],
            gain: [-1.0; 3],
        };
        let mut finding = Finding::new(Suspect::CurrentSign, &evidence, Some(correction));
        let half_turn = "180° electrical ahead of the rotor";
        finding.suspicions.push(suspicion(Suspect::ResolverZero, half_turn));
        return Some(finding);
    }
    let (needed, sigma) = balance.load?;
    let measured = job.conditions.load_torque_nm?;
    let transmission = &job.params.transmission;
    let friction = transmission.friction_dynamic * transmission.gear_ratio;
    let own = (LOAD_SHARE * needed.abs().max(measured.abs())).hypot(FRICTION_SHARE * friction);
    let sigma = sigma.hypot(own);
    ((needed - measured).abs() > LOAD_SIGMAS * sigma).then(|| {
        let evidence = format!("reads {measured:.1} N m, the motion needs {needed:.1} ± {sigma:.1} N m");
        Finding::new(Suspect::LoadSensor, &evidence, Some(Correction::NoLoad))
    })
}

/// Torque by the motion over torque by the currents of a window, with its standard deviation.
#[must_use]
pub(super) fn torque_ratio(job: &WindowJob) -> Option<(f64, f64)> {
    let signals = Signals::new(&job.params, &job.window.samples, &job.window.filled);
    Some(balance(&signals, &job.params)?.gain)
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

    #[test]
    fn an_output_beyond_its_set_point_has_another_scale_and_one_at_it_another_gear() {
        assert!(is_of_encoder(1.9, 2.0) && is_of_encoder(0.2, 0.25));
        assert!(!is_of_encoder(1.0, 2.0) && !is_of_encoder(0.5, 0.5) && !is_of_encoder(1.2, 1.25));
    }
}
