//! Whether the set point is logged less often than currents and angles.
//!
//! Its steps then are those of the log, and nothing says whether the drive follows them or what lies between: by half a step the set point is
//! logged late, which in steady motion looks like another gain.

use super::measured::MeasuredWindow;
use crate::monitor_fit::RecordedSample;

/// Samples from one change to the next from which on a set point is held, and the longest time of it, s: a longer one is a rest.
const HELD_SAMPLES: usize = 3;
const HELD_MAX_S: f64 = 0.1;

/// Changes that show it.
const CHANGES_MIN: usize = 5;

/// Whether most changes of the set point come several samples after the one before. Derived here.
pub(super) fn is_setpoint_held<S: RecordedSample>(window: &MeasuredWindow<'_, S>) -> bool {
    let rest = (HELD_MAX_S * window.params().sensors.sample_rate) as usize;
    let (mut held, mut followed) = (0, 0);
    let mut changed_at: Option<usize> = None;
    for n in window.inner().skip(1) {
        if window.sensed(n).setpoint == window.sensed(n - 1).setpoint {
            continue;
        }
        match changed_at.replace(n).map(|before| n - before) {
            Some(samples) if samples < HELD_SAMPLES => followed += 1,
            Some(samples) if samples <= rest => held += 1,
            _ => {}
        }
    }
    held >= CHANGES_MIN && held > followed
}

#[cfg(all(test, feature = "std"))]
mod tests {
    use std::vec::Vec;

    use ema_models::{ActuatorParams, SensedSample, Setpoint};

    use super::*;

    /// A ramp whose set point is logged every so many samples.
    fn is_held(every: u64, ramp: impl Fn(u64) -> f64) -> bool {
        let params = ActuatorParams::bench();
        let samples: Vec<SensedSample> = (0..1000)
            .map(|seq| SensedSample {
                seq,
                currents: [0.0; 3],
                motor_counts: 0,
                output_counts: 0,
                setpoint: Setpoint::Position(ramp(seq / every * every)),
            })
            .collect();
        is_setpoint_held(&MeasuredWindow::new(&params, &samples, &[]))
    }

    #[test]
    fn a_ramp_in_steps_is_held_and_steps_at_rest_are_not() {
        let ramp = |seq: u64| 1e-4 * seq as f64;
        assert!(is_held(20, ramp) && is_held(4, ramp));
        assert!(!is_held(1, ramp) && !is_held(2, ramp));
        assert!(!is_held(1, |seq| (seq / 400) as f64));
    }
}
