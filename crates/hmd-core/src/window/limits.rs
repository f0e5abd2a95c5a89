//! What the signals of one type of actuator can do: the limits by which samples are refused and windows are invalid.

use super::config::{Lengths, SPEED_MAX_FACTOR, WindowConfig};
use super::counters::CounterLimits;
use super::fill::Rotor;
use super::quality::{Defect, Part};
use super::trigger::Thresholds;
use ema_models::{ActuatorParams, FaultVector};

/// What the signals of one type of actuator can do at its sample rate.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    pub(super) lengths: Lengths,
    pub(super) sample_rate: f64,
    pub(super) full_scale_a: f64,
    pub(super) current_lsb_a: f64,
    /// Whether the currents are those of a quadrature current alone.
    pub(super) is_quadrature_alone: bool,
    /// Largest magnitude of a quadrature current without a direct one that a drive's frames hold, A.
    pub(super) quadrature_max_a: Option<f64>,
    pub(super) rotor: Rotor,
    pub(super) output_lsb: f64,
    pub(super) gear_ratio: f64,
    /// Largest difference of the two angles by play and wear, rad at the output.
    pub(super) play_max_rad: f64,
    pub(super) motor: CounterLimits,
    pub(super) output: CounterLimits,
    pub(super) thresholds: Thresholds,
    /// Whether the sample rate is only assumed, so that the stamps are the only evidence against it.
    pub(super) rate_is_unconfirmed: bool,
    /// Whether samples are numbered by their stamps, not by a counter.
    pub(super) is_numbered_by_time: bool,
    pub(super) unsteady_rad_s: f64,
    /// Motor angle by which a setpoint that trembles within the trigger's threshold moves the shaft, rad.
    pub(super) still_rad: f64,
}

impl Limits {
    /// From checked settings and the type's parameters.
    pub(super) fn new(config: &WindowConfig, params: &ActuatorParams) -> Self {
        let sensors = &params.sensors;
        let period = 1.0 / sensors.sample_rate;
        let (motor_lsb, output_lsb) = (sensors.motor_lsb(), sensors.output_lsb());
        let gear_ratio = params.transmission.gear_ratio;
        let speed = SPEED_MAX_FACTOR * params.controller.omega_max * period;
        let acceleration = params.motor.torque_gain() * params.motor.i_max / params.motor.j * period * period;
        let worn_out = FaultVector {
            backlash: 1.0,
            ..FaultVector::NOMINAL
        };
        let play_worn_out = params.transmission.backlash * worn_out.backlash_factor();
        Self {
            lengths: Lengths::new(config, sensors.sample_rate),
            sample_rate: sensors.sample_rate,
            full_scale_a: sensors.current_full_scale,
            current_lsb_a: sensors.current_lsb(),
            is_quadrature_alone: false,
            quadrature_max_a: None,
            rotor: Rotor::new(params.motor.pole_pairs, sensors),
            output_lsb,
            gear_ratio,
            // Three times the play at the end of its scale: a unit beyond that scale is still assessed, and found worn.
            play_max_rad: 3.0 * play_worn_out + 8.0 * output_lsb,
            motor: CounterLimits {
                part: Part::Motor,
                defect: Defect::MotorSpike,
                speed: speed / motor_lsb,
                acceleration: acceleration / motor_lsb,
                jitter: 0.0,
            },
            output: CounterLimits {
                part: Part::Output,
                defect: Defect::OutputSpike,
                speed: speed / gear_ratio / output_lsb,
                acceleration: acceleration / gear_ratio / output_lsb,
                jitter: 0.0,
            },
            thresholds: Thresholds::new(config),
            rate_is_unconfirmed: true,
            is_numbered_by_time: false,
            unsteady_rad_s: 0.2 * params.controller.omega_max,
            still_rad: config.trigger_position_rad * gear_ratio,
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::window::bench_slots::limits;

    /// The bench: at most 200 rad/s, 14.4 Nm on 10⁻³ kg·m²; 65 536 counts in a turn of the motor, 20 000 in one of the output, a hundred
    /// of the motor.
    #[test]
    fn a_counter_moves_no_further_than_three_times_the_top_speed_and_the_largest_torque_let_it() {
        let is_near = |found: f64, expected: f64| (found - expected).abs() < 1e-4 * expected;
        // Angles of the motor in one period, and by which they may differ from one to the next.
        for (rate_hz, speed_rad, acceleration_rad) in [(2000.0, 0.3, 3.611_25e-3), (400.0, 1.5, 90.281_25e-3)] {
            let limits = limits(rate_hz);
            let (motor, output) = (10_430.378, 31.830_989);
            assert!(is_near(limits.motor.speed, motor * speed_rad), "{limits:?}");
            assert!(
                is_near(limits.motor.acceleration, motor * acceleration_rad),
                "{limits:?}"
            );
            assert!(is_near(limits.output.speed, output * speed_rad), "{limits:?}");
            assert!(
                is_near(limits.output.acceleration, output * acceleration_rad),
                "{limits:?}"
            );
        }
    }
}
