//! Findings of the two angles and the set point: gear ratio, encoder, unit and delay of the set point.

use ema_models::ActuatorParams;

use super::{Finding, suspicion};
use crate::sensor_checks::angles::{SetpointError, followed_to_rest, output_over_setpoint, setpoint_error};
use crate::sensor_checks::correction::Correction;
use crate::sensor_checks::motor_time::MotorTime;
use crate::sensor_checks::signals::Signals;
use crate::sensor_checks::suspect::Suspect;

pub(super) fn of_motor_time(time: MotorTime) -> Finding {
    let age = if time.late_s > 0.0 { "older" } else { "newer" };
    let evidence = format!(
        "the motor angle seems to be {:.2} ms {age} than currents and output angle",
        1e3 * time.late_s.abs()
    );
    let correction = Correction::MotorAngle {
        late: time.late,
        turns_currents: time.in_rotor_frame,
    };
    Finding::new(Suspect::SampleOrder, &evidence, Some(correction))
}

/// Deviation of the ratio of output and motor from 1 that is no play.
const RATIO_OFF: f64 = 0.08;

pub(super) fn of_ratio(params: &ActuatorParams, ratio: f64, signals: &Signals) -> Option<Finding> {
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
pub(super) fn of_precise_ratio(params: &ActuatorParams, (ratio, sigma): (f64, f64), signals: &Signals) -> Finding {
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

pub(super) fn of_setpoint(params: &ActuatorParams, error: SetpointError) -> Finding {
    match error {
        SetpointError::Unit(times) if times < 1.0 => Finding::new(
            Suspect::SetpointUnit,
            &format!("the output follows {:.1} times what it reads", 1.0 / times),
            None,
        ),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_output_beyond_its_set_point_has_another_scale_and_one_at_it_another_gear() {
        assert!(is_of_encoder(1.9, 2.0) && is_of_encoder(0.2, 0.25));
        assert!(!is_of_encoder(1.0, 2.0) && !is_of_encoder(0.5, 0.5) && !is_of_encoder(1.2, 1.25));
    }
}
