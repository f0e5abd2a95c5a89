//! Shorts, eccentricity, friction and load of one window by the torque balance of its type: where a search by the monitor begins.
//!
//! The balance takes the type's k, J, C and T_d as they are, so the result is as far off as the unit is off its type. It is linear,
//! whereas the current of a monitor follows the turns as `1/N`: from health, a descent to shorts of half the turns takes three times as
//! many steps.

use ema_models::{ActuatorParams, FaultVector};

use super::balance_coefficients::BalanceCoefficients;
use super::balance_shape::BalanceShape;
use super::controller::{LawKnowledge, gain_ratio};
use super::measured::MeasuredWindow;
use super::terms::{TERM_COUNT, Term};
use super::torque_balance::free_coefficients;
use crate::recorded_sample::RecordedSample;

/// Half width of the kernel, s: of jittering samples, too.
const HALF_WIDTH_S: f64 = 6e-3;

/// What the balance says of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ByTypeBalance {
    /// Friction, shorts and eccentricity; the other faults are those of health.
    pub(crate) fault: FaultVector,
    /// Load torque at the output, Nm.
    pub(crate) load_torque: f64,
}

/// The faults of a window by the balance of its type; `None` where the motion is too short.
pub(crate) fn by_type_balance<S: RecordedSample>(
    params: &ActuatorParams,
    samples: &[S],
    filled: &[usize],
    backlash: f64,
) -> Option<ByTypeBalance> {
    let window = MeasuredWindow::new(params, samples, filled);
    let gain = gain(&window);
    let mut found = balance(&window, params)?;
    found.fault = FaultVector {
        gain: gain.unwrap_or(found.fault.gain),
        backlash,
        ..found.fault
    };
    Some(found)
}

/// Gain by the control law, where the window shows it.
#[inline(never)]
fn gain<S: RecordedSample>(window: &MeasuredWindow<'_, S>) -> Option<f64> {
    let known = LawKnowledge {
        scale: Some(1.0),
        delay_s: None,
    };
    let (ratio, _) = gain_ratio(window, HALF_WIDTH_S, known).ok()?;
    Some((ratio.value - 0.5).clamp(0.0, 1.0))
}

/// The faults that the torque balance shows.
fn balance<S: RecordedSample>(window: &MeasuredWindow<'_, S>, params: &ActuatorParams) -> Option<ByTypeBalance> {
    let found = free_coefficients(window, &of_type(params))?;
    let [short_a, short_b, short_c] = found.turns.map(|turns| (1.0 - turns).clamp(0.0, SHORT_MAX));
    let [cos, sin] = found.eccentricity;
    Some(ByTypeBalance {
        fault: FaultVector {
            // T_d (1 + 2 k1).
            friction: found
                .friction
                .map_or(0.0, |scale| (0.5 * (scale - 1.0)).clamp(0.0, 1.0)),
            short_a,
            short_b,
            short_c,
            eccentricity: libm::hypot(cos, sin).min(ECCENTRICITY_MAX),
            eccentricity_phase: 0.5 * (libm::atan2(sin, cos) / core::f64::consts::PI + 1.0),
            ..FaultVector::NOMINAL
        },
        load_torque: found.load.constant,
    })
}

/// Largest damage that a search begins at.
const SHORT_MAX: f64 = 0.9;
const ECCENTRICITY_MAX: f64 = 0.9;

/// The balance of a type.
fn of_type(params: &ActuatorParams) -> BalanceCoefficients {
    let mut values = [0.0; TERM_COUNT];
    for (term, value) in [
        (Term::TurnsA, 1.0),
        (Term::TurnsB, 1.0),
        (Term::TurnsC, 1.0),
        (Term::Inertia, params.motor.j),
        (Term::Damping, params.motor.c),
        (Term::DryFriction, params.transmission.friction_dynamic),
        (Term::SetpointHold, 0.5),
        (Term::GearLoss, 1.0),
    ] {
        values[term as usize] = value;
    }
    BalanceCoefficients {
        values,
        shape: BalanceShape::usual(params),
        residual_rms: f64::INFINITY,
        half_width_s: HALF_WIDTH_S,
        angle_errors: false,
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::TAU;
    use std::vec::Vec;

    use super::*;
    use ema_models::{Real, SensedSample, Setpoint, phase_shapes};

    const SAMPLES: usize = 1000;

    /// A shaft that swings by 30 rad at 4 Hz under the currents that its turns need for that.
    fn swinging(params: &ActuatorParams, turns: [f64; 3]) -> Vec<SensedSample> {
        let (motor, sensors) = (&params.motor, &params.sensors);
        let per_second = TAU * 4.0;
        let sample = |n: usize| {
            let t = n as f64 / sensors.sample_rate;
            let angle = 30.0 * libm::sin(per_second * t);
            let speed = 30.0 * per_second * libm::cos(per_second * t);
            let friction = params.transmission.friction_dynamic.copysign(speed);
            let torque = friction + motor.c * speed - motor.j * per_second * per_second * angle;
            let shapes = phase_shapes((motor.pole_pairs * angle).sin_cos_poly());
            let per_amp: f64 = turns.iter().zip(shapes).map(|(turns, s)| motor.k * turns * s * s).sum();
            SensedSample {
                seq: n as u64,
                currents: shapes.map(|s| torque / per_amp * s),
                motor_counts: libm::round(angle / sensors.motor_lsb()) as i64,
                output_counts: libm::round(angle / params.transmission.gear_ratio / sensors.output_lsb()) as i64,
                setpoint: Setpoint::Idle,
            }
        };
        (0..SAMPLES).map(sample).collect()
    }

    #[test]
    fn missing_turns_of_a_unit_like_its_type_are_found() {
        let params = ActuatorParams::bench();
        for shorts in [[0.0, 0.0, 0.0], [0.4, 0.0, 0.1], [0.2, 0.6, 0.3]] {
            let samples = swinging(&params, shorts.map(|short| 1.0 - short));
            let found = by_type_balance(&params, &samples, &[], 0.0).unwrap();
            let read = [found.fault.short_a, found.fault.short_b, found.fault.short_c];
            for (read, short) in read.into_iter().zip(shorts) {
                assert!((read - short).abs() < 0.02, "{found:?}");
            }
            assert!(
                found.fault.friction < 0.1 && found.fault.eccentricity < 0.02,
                "{found:?}"
            );
        }
    }

    #[test]
    fn a_motor_at_rest_has_no_balance() {
        let params = ActuatorParams::bench();
        let mut samples = swinging(&params, [1.0; 3]);
        for sample in &mut samples {
            sample.motor_counts = 0;
        }
        assert_eq!(by_type_balance(&params, &samples, &[], 0.0), None);
    }
}
