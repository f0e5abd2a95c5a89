//! Set points and currents in a unit smaller than the configured one says: they read many times less than what they cause.

use ema_models::ActuatorParams;

use super::least_squares::fit;
use super::signals::{Signals, commanded_angle};
use super::torque::Balance;

/// Ratio of an effect and what is read of its cause that another unit explains, and nothing that wears or is adjusted: gains of the loops, of
/// sensors and of magnets stay below 2.
pub(super) const UNIT_MIN: f64 = 8.0;

/// Share of ω_max below which the drive asks for the speed that the deviation gives.
const UNSATURATED: f64 = 0.8;

/// Share of the largest acceleration of the motor alone below which the speed is the one that is asked for, and half the time over which it is
/// measured, s.
const STEADY: f64 = 0.2;
const HALF_WIDTH_S: f64 = 2.5e-3;

/// Share of the reference's variance that a line over the set point may leave: lags, and a gain of the position loop that is not known well.
const LEFT: f64 = 0.1;

/// Counts of the output by which the reference moves at least.
const COUNTS_MIN: f64 = 40.0;

/// Times as far as the set point that the reference of the position loop moves, where that is [`UNIT_MIN`] and more.
///
/// A position loop asks for the speed `ω = g_p (r − y)` of the motor, up to ω_max. Below it the reference is `r = y + ω / g_p`, whatever the
/// set point reads: at rest the output itself, and in motion ahead of it, while the motor does not accelerate towards that speed. It is a line over the set point, of slope 1 where the unit is right.
/// Derived here.
pub(super) fn reference_over_setpoint(signals: &Signals, params: &ActuatorParams) -> Option<f64> {
    let (g_p, omega_max) = (params.controller.g_p, params.controller.omega_max);
    let first = signals.rows.first()?;
    let (first_setpoint, first_output) = (commanded_angle(first.setpoint)?, first.theta_out);
    let motor = &params.motor;
    let quick = STEADY * motor.torque_gain() * motor.i_max / motor.j;
    let half = ((HALF_WIDTH_S * signals.rate_hz).round() as usize).max(1);
    let rows: Vec<(f64, f64)> = signals
        .rows
        .windows(2 * half + 1)
        .filter_map(|around| {
            let (row, change) = (&around[half], around[2 * half].omega_m - around[0].omega_m);
            let acceleration = change * signals.rate_hz / (2 * half) as f64;
            let is_followed = row.omega_m.abs() < UNSATURATED * omega_max && acceleration.abs() < quick;
            let moved = commanded_angle(row.setpoint)? - first_setpoint;
            let reference = row.theta_out - first_output + row.omega_m / g_p;
            (is_followed && !row.is_filled).then_some((moved, reference))
        })
        .collect();
    let count = rows.len().max(1) as f64;
    let mean = rows.iter().map(|(_, reference)| reference).sum::<f64>() / count;
    let variance = rows
        .iter()
        .map(|(_, reference)| (reference - mean).powi(2))
        .sum::<f64>()
        / count;
    let free = (0.0, f64::INFINITY);
    let line = fit(rows.iter().map(|&(moved, y)| ([1.0, moved], y)), [free; 2], 1.0)?;
    let is_moved = variance.sqrt() > COUNTS_MIN * params.sensors.output_lsb();
    (is_moved && line.value[1] > UNIT_MIN && line.mean_square < LEFT * variance).then_some(line.value[1])
}

/// Standard deviations of a torque ratio beyond [`UNIT_MIN`].
const SIGMAS: f64 = 5.0;

/// Torque that the motion needs over that of the currents, where that is [`UNIT_MIN`] and more.
pub(super) fn motion_over_currents(balance: &Balance) -> Option<f64> {
    let (gain, sigma) = balance.gain;
    (gain > UNIT_MIN + SIGMAS * sigma).then_some(gain)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ema_models::{SensedSample, Setpoint};

    /// The slope that is found where the output follows this reference, rad, of the time, s, by the law of the position loop, and the set
    /// point reads `unit` times it; the loop's gain is `gain` times the configured one.
    fn found(reference: impl Fn(f64) -> f64, unit: f64, gain: f64) -> Option<f64> {
        let params = ActuatorParams::bench();
        let rate_hz = params.sensors.sample_rate;
        let (mut output, gear_ratio) = (reference(0.0), params.transmission.gear_ratio);
        let samples = (0..1000_u64).map(|seq| {
            let r = reference(seq as f64 / rate_hz);
            let omega = (gain * params.controller.g_p * (r - output))
                .clamp(-params.controller.omega_max, params.controller.omega_max);
            output += omega / gear_ratio / rate_hz;
            SensedSample {
                seq,
                currents: [0.0; 3],
                motor_counts: (output * gear_ratio / params.sensors.motor_lsb()) as i64,
                output_counts: (output / params.sensors.output_lsb()) as i64,
                setpoint: Setpoint::Position(unit * r),
            }
        });
        let samples: Vec<SensedSample> = samples.collect();
        reference_over_setpoint(&Signals::new(&params, &samples, &[]), &params)
    }

    fn step(t: f64) -> f64 {
        if t < 0.05 { 0.1 } else { 0.2 }
    }

    fn ramp(t: f64) -> f64 {
        -0.3 + 0.5 * t
    }

    fn oscillation(t: f64) -> f64 {
        0.1 * (20.0 * t).sin()
    }

    #[test]
    fn a_set_point_in_a_smaller_unit_is_found_and_another_gain_is_none() {
        for reference in [step, ramp, oscillation] {
            for unit in [core::f64::consts::PI / 180.0, 1e-3] {
                for gain in [0.7, 1.0, 1.5] {
                    let found = found(reference, unit, gain).expect("a unit");
                    assert!((found * unit - 1.0).abs() < 0.3, "{unit} {gain}: {found}");
                }
            }
            for gain in [0.5, 1.0, 2.0] {
                assert_eq!(found(reference, 1.0, gain), None, "gain {gain}");
            }
            assert_eq!(found(reference, 0.5, 1.0), None);
        }
    }

    #[test]
    fn torque_that_no_gain_explains_is_of_another_unit() {
        let of = |gain| motion_over_currents(&Balance { gain, load: None });
        assert_eq!(of((1000.0, 30.0)), Some(1000.0));
        assert_eq!(of((2.0, 0.1)), None);
        assert_eq!(of((1000.0, 500.0)), None);
    }
}
