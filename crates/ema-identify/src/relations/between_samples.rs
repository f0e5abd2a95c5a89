//! Angle and currents between the samples.
//!
//! At 400 Hz a fast motor makes half an electrical turn and more from one sample to the next: products of samples, such as those of a
//! current and the shape of its phase, then alias. In the rotor's frame the currents are slow, so angle and currents are interpolated
//! there, by a cubic through four samples less the steps that new set points make at samples, before anything is multiplied. The mean
//! of a product over both neighbouring intervals, weighted by the triangle that reaches from the sample before to the sample behind,
//! belongs exactly to the second difference of the angle. Derived here.

use ema_models::{ActuatorParams, Real, abc_from_alpha_beta, alpha_beta_from_dq, dq_from_abc};

use super::measured::{Instant, MeasuredWindow};
use crate::recorded_sample::RecordedSample;

/// Electrical angle from sample to sample at ω_max, rad, from which the products need instants between the samples: they have twice the
/// frequency, which from π on aliases.
const FAST_ANGLE: f64 = 1.0;

/// Largest electrical angle from one instant to the next, rad.
const STEP_ANGLE: f64 = 0.4;

/// Most instants of an interval.
const MAX_INSTANTS: f64 = 40.0;

/// The interval from one sample to the next.
#[derive(Clone, Copy)]
pub(super) struct Interval {
    angle_in_turn: f64,
    pole_pairs: f64,
    /// Motor angle since the interval's first sample and currents i_d, i_q, at the four samples around it.
    angle: [f64; 4],
    direct: [f64; 4],
    quadrature: [f64; 4],
}

/// Instants of an interval of an actuator; 0 where the samples themselves suffice.
pub(super) fn instants(params: &ActuatorParams) -> usize {
    let angle = params.motor.pole_pairs * params.controller.omega_max / params.sensors.sample_rate;
    if angle < FAST_ANGLE {
        0
    } else {
        libm::ceil(angle / STEP_ANGLE).min(MAX_INSTANTS) as usize
    }
}

/// Whether the motor makes so much of a turn from sample to sample that angle and currents are interpolated between them: what that leaves
/// repeats with the rotor's angle.
#[must_use]
pub fn is_coarsely_sampled(params: &ActuatorParams) -> bool {
    instants(params) > 0
}

/// Error of the torque by what is not seen between the samples of a coarsely sampled window, Nm at the motor shaft; 0 elsewhere. It grows with
/// the time between samples, and is 2.5 % of the largest torque at 400 Hz: healthy units of `servo270` at that rate, all dead times of the
/// usual range, show a damping of up to 6 % at ω_max. Derived here.
#[must_use]
pub fn coarse_torque_error(params: &ActuatorParams) -> f64 {
    if !is_coarsely_sampled(params) {
        return 0.0;
    }
    COARSE_ERROR_HZ / params.sensors.sample_rate * params.motor.torque_gain() * params.motor.i_max
}

/// Error of the torque as a share of the largest, times the sample rate, Hz.
const COARSE_ERROR_HZ: f64 = 10.0;

impl Interval {
    /// The interval that begins at sample `n`; needs one sample before it and two behind. `jump` gives the step of the quadrature
    /// current, A, with which a set point takes effect behind its sample.
    pub(super) fn new<S: RecordedSample>(
        window: &MeasuredWindow<'_, S>,
        n: usize,
        jump: impl Fn(usize, [f64; 2]) -> f64,
    ) -> Self {
        let params: &ActuatorParams = window.params();
        let (motor_lsb, per_turn) = (params.sensors.motor_lsb(), params.sensors.motor_counts_per_rev as i64);
        let pole_pairs = params.motor.pole_pairs;
        let samples = [n - 1, n, n + 1, n + 2].map(|n| window.sensed(n));
        let in_turn = |counts: i64| (counts.rem_euclid(per_turn) as f64 + 0.5) * motor_lsb;
        let dq = samples.map(|sample| {
            let sin_cos = (pole_pairs * in_turn(sample.motor_counts)).sin_cos_poly();
            dq_from_abc(sample.currents, sin_cos)
        });
        // Without the steps at the samples the current is smooth.
        let [before, at, behind] = [0, 1, 2].map(|place| jump(n + place - 1, dq[place]));
        let mut quadrature = dq.map(|[_, quadrature]| quadrature);
        quadrature[0] += before + at;
        quadrature[1] += at;
        quadrature[3] -= behind;
        Self {
            angle_in_turn: in_turn(samples[1].motor_counts),
            pole_pairs,
            angle: samples.map(|sample| (sample.motor_counts - samples[1].motor_counts) as f64 * motor_lsb),
            direct: dq.map(|[direct, _]| direct),
            quadrature,
        }
    }

    /// Motor angle within its turn at a share of the interval, rad.
    pub(super) fn angle_in_turn_at(&self, share: f64) -> f64 {
        self.angle_in_turn + weighted(&cubic(share), &self.angle)
    }

    /// The instant at a share of the interval.
    pub(super) fn at(&self, share: f64) -> Instant {
        let weights = cubic(share);
        let of = |values| weighted(&weights, values);
        let angle_in_turn = self.angle_in_turn + of(&self.angle);
        let sin_cos_e = (self.pole_pairs * angle_in_turn).sin_cos_poly();
        Instant {
            angle_in_turn,
            sin_cos_e,
            i: abc_from_alpha_beta(alpha_beta_from_dq([of(&self.direct), of(&self.quadrature)], sin_cos_e)),
        }
    }
}

fn weighted(weights: &[f64; 4], values: &[f64; 4]) -> f64 {
    weights.iter().zip(values).map(|(weight, value)| weight * value).sum()
}

/// Weights of values at −1, 0, 1 and 2 in the cubic through them, at `x`.
fn cubic(x: f64) -> [f64; 4] {
    let (before, behind, two) = (x + 1.0, x - 1.0, x - 2.0);
    [
        -x * behind * two / 6.0,
        0.5 * before * behind * two,
        -0.5 * before * x * two,
        before * x * behind / 6.0,
    ]
}

#[cfg(test)]
mod tests {
    use super::cubic;

    #[test]
    fn a_cubic_is_interpolated_exactly() {
        let polynomial = |x: f64| 1.0 + x * (2.0 + x * (3.0 - 4.0 * x));
        for x in [0.0, 0.3, 0.5, 1.0] {
            let weights = cubic(x);
            let found: f64 = (0..4).map(|m| weights[m] * polynomial(m as f64 - 1.0)).sum();
            assert!((found - polynomial(x)).abs() < 1e-12, "{x}");
        }
    }
}
