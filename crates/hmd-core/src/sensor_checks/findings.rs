//! What the signals of a window show by themselves, before any estimate.

mod of_angles;
mod of_currents;

use ema_models::{ActuatorParams, DriveKind, Tolerances};

use super::angles::{
    FrozenOutput, SetpointError, SuddenStop, frozen_output, output_over_motor, setpoint_error, sudden_stop,
};
use super::control_law::{gain_at_limit, link_by_law};
use super::correction::Correction;
use super::current_limit::gain_beyond_limit;
use super::currents::{CurrentError, current_errors, gain_of_a_phase, offset_limit};
use super::gear_ratio::precise_ratio;
use super::motor_time::motor_time;
use super::other_unit::motion_over_currents;
use super::signals::Signals;
use super::suspect::{Suspect, Suspicion};
use super::torque::{Balance, balance};
use super::wiring::{far_zero, other_wiring};
use crate::outbox::WindowJob;
use crate::window::{Defect, Invalidity, WindowQuality};
use of_angles::{of_motor_time, of_precise_ratio, of_ratio, of_setpoint};
use of_currents::{of_currents, of_far_zero, of_limit, of_sum, of_wiring};

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
        return vec![of_motor_time(time)];
    }
    if let Some(far) = far_zero(&signals, params) {
        return vec![of_far_zero(params, &far)];
    }
    if let Some((found, configured)) = other_wiring(&signals, params, ratio) {
        return vec![of_wiring(params, &found, configured)];
    }
    if let Some(unit) = of_current_unit(&signals, params) {
        return vec![unit];
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

/// The unit of the currents, where they make far less torque than the motion needs.
#[must_use]
pub fn current_unit(job: &WindowJob) -> Option<Finding> {
    let signals = Signals::new(&job.params, &job.window.samples, &job.window.filled);
    of_current_unit(&signals, &job.params)
}

fn of_current_unit(signals: &Signals, params: &ActuatorParams) -> Option<Finding> {
    let times = motion_over_currents(&balance(signals, params)?)?;
    let evidence = format!(
        "the motion needs {times:.0} times the torque of the currents: their unit, or inertia and torque constant, are \
         others than configured"
    );
    Some(Finding::new(Suspect::CurrentUnit, &evidence, None))
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
pub(super) fn tolerances_of_sensors(tolerances: &Tolerances) -> &Tolerances {
    if tolerances.current_offset > 0.0 {
        tolerances
    } else {
        &Tolerances::USUAL
    }
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
