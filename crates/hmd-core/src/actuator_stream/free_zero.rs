//! The zero of an output angle that nobody measures.
//!
//! Without an output angle that of the motor stands for it, whose zero has nothing to do with that of the set point. A drive at rest is at its
//! set point: what lies between them before the trigger is the zero.

use ema_models::{ActuatorParams, SensedSample, Setpoint};

use crate::window::Window;

/// Counts of the encoder, or of the resolver where those are wider, within which an actuator is at rest.
const REST_COUNTS: f64 = 2.0;

/// Moves the set point of a window in position mode to the output where the actuator rested before the trigger.
pub(super) fn move_set_point_to_rest(window: &mut Window, params: &ActuatorParams) {
    let before = window.samples.get(..window.trigger).unwrap_or_default();
    if let Some(off) = off_at_rest(before, params) {
        for sample in &mut window.samples {
            if let Setpoint::Position(angle) = &mut sample.setpoint {
                *angle -= off;
            }
        }
    }
}

/// Set point less output of an actuator at rest, rad, mean over the samples; `None` where it moves, or in another mode.
fn off_at_rest(samples: &[SensedSample], params: &ActuatorParams) -> Option<f64> {
    let sensors = &params.sensors;
    let rest = REST_COUNTS
        * sensors
            .output_lsb()
            .max(sensors.motor_lsb() / params.transmission.gear_ratio);
    let output = |sample: &SensedSample| sample.output_counts as f64 * sensors.output_lsb();
    let commanded = |sample: &SensedSample| match sample.setpoint {
        Setpoint::Position(angle) => angle,
        Setpoint::Idle | Setpoint::Speed(_) => f64::NAN,
    };
    let rests = |value: &dyn Fn(&SensedSample) -> f64| {
        let first = value(samples.first()?);
        samples
            .iter()
            .all(|sample| (value(sample) - first).abs() <= rest)
            .then_some(first)
    };
    (rests(&output).is_some() && rests(&commanded).is_some()).then(|| {
        let off = samples.iter().map(|sample| commanded(sample) - output(sample));
        off.sum::<f64>() / samples.len() as f64
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(setpoint: impl Fn(usize) -> Setpoint, output_counts: impl Fn(usize) -> i64) -> Vec<SensedSample> {
        let sample = |n| SensedSample {
            seq: n as u64,
            currents: [0.0; 3],
            motor_counts: 0,
            output_counts: output_counts(n),
            setpoint: setpoint(n),
        };
        (0..40).map(sample).collect()
    }

    #[test]
    fn the_zero_is_what_lies_between_them_at_rest() {
        let params = ActuatorParams::bench();
        let lsb = params.sensors.output_lsb();
        let held = |_| Setpoint::Position(0.35);
        let found = off_at_rest(&samples(held, |n| 40 + (n % 2) as i64), &params).expect("a rest");
        assert!((found - (0.35 - 40.5 * lsb)).abs() < 1e-12, "{found}");
        assert_eq!(off_at_rest(&samples(held, |n| n as i64), &params), None, "it moves");
        let ramp = |n: usize| Setpoint::Position(0.01 * n as f64);
        assert_eq!(
            off_at_rest(&samples(ramp, |_| 0), &params),
            None,
            "it is commanded to move"
        );
        assert_eq!(off_at_rest(&samples(|_| Setpoint::Speed(0.0), |_| 0), &params), None);
        assert_eq!(off_at_rest(&[], &params), None);
    }
}
