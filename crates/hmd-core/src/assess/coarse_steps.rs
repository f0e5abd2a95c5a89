//! Signals that come in wider steps than those of the type's sensors, as in the fields of a drive's frames, for windows that the monitor explains.
//!
//! A step q leaves an error of variance q²/12 in each value. What is more than the type's own steps leave is noise beside the mismatch of the
//! monitor: it belongs into the weights, or a healthy unit is explained by nothing. Derived here:
//!
//! | signal | variance beside | lasting |
//! |---|---|---|
//! | currents | σ_i² = (q² − q₀²)/12 | |
//! | motor angle | σ_m² | σ_m², of the first sample, from which it counts |
//! | motor speed, over d samples | 2 σ_m² (f/d)² | |
//! | output angle | σ_o² | σ_o² |
//! | quadrature current, by the counted control deviation | (G_p K_p σ_o/G_T)² | |

use ema_identify::calibration::{NoiseBeside, TypeCalibration};
use ema_models::{ActuatorParams, Signals};

use crate::dbc::Role;
use crate::log_map::Quantity;
use crate::motion::steps;
use crate::outbox::WindowJob;

/// Steps of the signals of a window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct SignalSteps {
    /// Of the currents, A.
    current: f64,
    /// Of the motor angle, rad.
    motor: f64,
    /// Of the output angle, rad.
    output: f64,
}

/// The calibration of a type as it holds for the steps of the signals in a window.
pub(super) fn with_steps(calibration: TypeCalibration, job: &WindowJob) -> TypeCalibration {
    let found = steps_of(job);
    match noise_beside(&found, &job.params) {
        Some(noise) => calibration.with_noise_beside(&noise, job.params.sensors.sample_rate, job.window.samples.len()),
        None => calibration,
    }
}

/// Steps by the fields of the drive's frames where they are known, and by the values.
fn steps_of(job: &WindowJob) -> SignalSteps {
    let sensors = &job.params.sensors;
    let [current, motor, output] = steps(job);
    let by_drive = |quantity: Quantity| {
        let drive = job.actuator.drive_bus.as_ref();
        drive.and_then(|drive| drive.step(quantity)).unwrap_or(0.0)
    };
    let motor = motor.max(by_drive(Quantity::Of(Role::MotorPosition))) * sensors.motor_lsb();
    let output = if job.actuator.has_output_angle() {
        output.max(by_drive(Quantity::Of(Role::OutputPosition))) * sensors.output_lsb()
    } else {
        motor / job.params.transmission.gear_ratio
    };
    SignalSteps {
        current: current.max(by_drive(Quantity::CurrentQ)),
        motor,
        output,
    }
}

/// Variances that steps leave beside those of the type's sensors; `None` where none is wider.
fn noise_beside(found: &SignalSteps, params: &ActuatorParams) -> Option<NoiseBeside> {
    let (sensors, controller) = (&params.sensors, &params.controller);
    let beside = |step: f64, own: f64| {
        if step > WIDER * own {
            (step * step - own * own) / 12.0
        } else {
            0.0
        }
    };
    let current = beside(found.current, sensors.current_lsb());
    let motor = beside(found.motor, sensors.motor_lsb());
    let output = beside(found.output, sensors.output_lsb());
    if current + motor + output <= 0.0 {
        return None;
    }
    let span = ema_models::speed_span(sensors.sample_rate) as f64;
    let per_span = sensors.sample_rate / span;
    let by_deviation = controller.g_p * controller.k_p / params.motor.torque_gain();
    Some(NoiseBeside {
        white: Signals {
            i_d: current,
            i_q: current + by_deviation * by_deviation * output,
            theta_m: motor,
            omega_m: 2.0 * motor * per_span * per_span,
            theta_out: output,
        },
        lasting: Signals {
            theta_m: motor,
            theta_out: output,
            ..Signals::from_array([0.0; 5])
        },
    })
}

/// Steps that are not wider than this, in the type's own, are those of its sensors.
const WIDER: f64 = 1.5;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_the_type_are_no_noise_beside_and_wider_ones_are() {
        let params = ActuatorParams::servo270();
        let sensors = &params.sensors;
        let own = SignalSteps {
            current: sensors.current_lsb(),
            motor: sensors.motor_lsb(),
            output: sensors.output_lsb(),
        };
        assert!(noise_beside(&own, &params).is_none());
        // Sixteen bits over ±1 rad at the output, behind a gear of 120.
        let motor = 2.0 / 65_535.0 * params.transmission.gear_ratio;
        let noise = noise_beside(&SignalSteps { motor, ..own }, &params).unwrap();
        let sigma = (motor * motor - sensors.motor_lsb() * sensors.motor_lsb()).sqrt() / 12_f64.sqrt();
        assert!((noise.white.theta_m.sqrt() / sigma - 1.0).abs() < 1e-9);
        let per_span = sensors.sample_rate / ema_models::speed_span(sensors.sample_rate) as f64;
        assert!((noise.white.omega_m.sqrt() / (2_f64.sqrt() * sigma * per_span) - 1.0).abs() < 1e-9);
        assert!(noise.white.i_q <= 0.0 && noise.white.theta_out <= 0.0);
    }
}
