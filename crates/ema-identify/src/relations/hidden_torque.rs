//! Torque that acts between the samples and stands in no sampled current.
//!
//! A new set point changes the currents right behind the sample with which it is latched, so a sample shows the torque before the step.
//! [`Term::SetpointHold`](super::Term::SetpointHold) is its mean over the phases of a healthy motor. In a damaged phase it is smaller as the torque of
//! the phase is, by a part of the interval that depends on the drive: how fast the currents follow, and when they are latched.

use ema_models::dq_from_abc;

use super::between_samples::instants;
use super::measured::MeasuredWindow;
use crate::recorded_sample::RecordedSample;

/// Standard deviation of the part of an interval for which the step of a set point acts unseen.
const UNSEEN_PART: f64 = 0.5;

/// Standard deviation of the change of a phase's torque as a share of the change: `½ |Σ T Δ| / Σ T²` with the sampled torque T and the
/// steps Δ of the set points, both of which a phase carries by the square of its shape. 0 where the currents are interpolated, because the steps are
/// then a part of each phase's current. Derived here.
#[inline(never)]
pub(super) fn unseen_share<S: RecordedSample>(window: &MeasuredWindow<'_, S>) -> f64 {
    let params = window.params();
    if instants(params) > 0 {
        return 0.0;
    }
    let (torque_gain, k_p) = (params.motor.torque_gain(), params.controller.k_p);
    let (mut mixed, mut squares) = (0.0, 0.0);
    for n in window.inner() {
        let now = window.instant(n);
        let [_, quadrature] = dq_from_abc(now.i, now.sin_cos_e);
        let torque = torque_gain * quadrature;
        squares += torque * torque;
        if window.speed_reference(n) < 1.0 && !window.is_current_limited(quadrature) {
            mixed += torque * k_p * window.mean_reference_step(n);
        }
    }
    UNSEEN_PART * libm::fabs(mixed) / f64::max(squares, f64::MIN_POSITIVE)
}
