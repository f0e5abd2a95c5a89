//! Offsets of the currents that came since commissioning and that only the torque shows.
//!
//! A drive that controls its currents by the sensors that have the offsets holds the *read* direct current at zero, and answers them by true
//! currents. Where the third current follows from two sensors, where a drive sends `i_d` and `i_q`, and of offsets that cancel, no sum shows
//! them. What is left is their torque: constant amperes once per electrical turn, `k 3/2 (o_β cos θ_e − o_α sin θ_e)`, whereas that of shorts and
//! of an eccentric rotor goes with the current. Derived here.

use ema_models::abc_from_alpha_beta;

use super::correction::Correction;
use super::currents::offset_limit;
use super::findings::{Finding, tolerances_of_sensors};
use super::readings::Reading;
use super::signals::Signals;
use super::suspect::Suspect;
use crate::outbox::WindowJob;

/// Length along α and β of an offset of one phase of three, as a share of it: that of the limit of one is off.
const OF_ONE_PHASE: f64 = 2.0 / 3.0;

/// Standard deviations of a change that no motion makes.
const SIGMAS: f64 = 6.0;

/// The offsets along α and β that a window has beyond those of the commissioned unit, A, each with its standard deviation, where they are
/// clear and no tolerance.
#[must_use]
pub fn offset_by_torque(job: &WindowJob, change: [Reading; 2]) -> Option<Finding> {
    let signals = Signals::new(&job.params, &job.window.samples, &job.window.filled);
    let limit = offset_limit(&signals, tolerances_of_sensors(&job.actuator.tolerances));
    of_change(change, limit)
}

/// The same with the limit of the offset of one phase, A; 0 is none.
fn of_change([alpha, beta]: [Reading; 2], limit: f64) -> Option<Finding> {
    let sigmas = (alpha.0 / alpha.1).hypot(beta.0 / beta.1);
    let is_off = limit > 0.0 && alpha.0.hypot(beta.0) > OF_ONE_PHASE * limit && sigmas > SIGMAS;
    is_off.then(|| {
        let offset = abc_from_alpha_beta([alpha.0, beta.0]);
        let [a, b, c] = offset.map(|offset| 1e3 * offset);
        let evidence = format!(
            "a {a:+.0} mA, b {b:+.0} mA, c {c:+.0} mA more than at commissioning, by the torque; no sum of the phases tells which sensor it is"
        );
        let correction = Correction::Currents { offset, gain: [1.0; 3] };
        Finding::new(Suspect::CurrentOffset, &evidence, Some(correction))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_clear_and_no_tolerance_is_taken_out_of_all_phases_without_a_sum() {
        let of = |alpha: f64, beta: f64, sigma: f64| of_change([(alpha, sigma), (beta, sigma)], 0.1);
        assert!(of(0.05, 0.02, 0.005).is_none() && of(0.1, 0.0, 0.02).is_none());
        let found = of(0.1, 0.1 / 3_f64.sqrt(), 0.01).expect("an offset of phase A, of two sensors");
        let Some(Correction::Currents { offset: [a, b, c], .. }) = found.correction else {
            panic!("{found:?}")
        };
        assert!((a - 0.1).abs() < 1e-12 && b.abs() < 1e-12 && (c + 0.1).abs() < 1e-12);
        assert!(
            found.suspicions[0]
                .sentence
                .starts_with("current offset: a +100 mA, b +0 mA, c -100 mA more than at commissioning")
        );
    }
}
