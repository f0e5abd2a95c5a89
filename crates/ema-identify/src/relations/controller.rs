//! Position gain of one window from the differentiated PI law of the speed loop.
//!
//! `T = K_p e + K_i ∫e`, `e = G_p g (θ_cmd − θ_out) − ω_m`, differentiated once, so that the integral's start is no unknown:
//! `T' = g (K_p e₁' + K_i e₁) − h (K_p ω' + K_i ω)` with `e₁ = G_p (θ_cmd − θ_out)`. T is `G_T i_q` as measured. The ratio
//! `g/h` is the gain factor `0.5 + k8`, whatever the scale of the torque. Derived here from the control law.

use ema_models::dq_from_abc;

use super::elements::{Needed, Reading};
use super::kernel::Kernel;
use super::measured::MeasuredWindow;
use super::normal_equations::NormalEquations;
use super::sliding::Sliding;
use crate::monitor_fit::RecordedSample;

/// Largest speed reference at the nominal gain, as a share of ω_max: with the largest gain factor of 1.5 it stays below the
/// limit.
const SPEED_SHARE: f64 = 0.65;

/// Largest torque, as a share of `G_T I_max`.
const TORQUE_SHARE: f64 = 0.9;

/// Ratio `g/h` of a window.
pub(super) fn gain_ratio<S: RecordedSample>(window: &MeasuredWindow<'_, S>) -> Result<Reading, Needed> {
    let params = window.params();
    let (controller, rate) = (&params.controller, params.sensors.sample_rate);
    let kernel = Kernel::new(rate);
    let torque_gain = params.motor.torque_gain();
    let torque_limit = TORQUE_SHARE * torque_gain * params.motor.i_max;
    let speed_limit = SPEED_SHARE * controller.omega_max;
    let mut ring = Sliding::<3>::new(kernel.span);
    let mut equations = NormalEquations::<2>::new();
    let mut in_position_mode = false;
    for n in window.inner() {
        let Some(error) = window.position_error(n) else {
            ring.clear();
            continue;
        };
        in_position_mode = true;
        let now = window.quantities(n);
        let reference = controller.g_p * error;
        let torque = torque_gain * dq_from_abc(now.i, now.sin_cos_e)[1];
        let limited = libm::fabs(reference) >= speed_limit || libm::fabs(torque) >= torque_limit;
        if limited || !window.is_measured(n) {
            ring.clear();
            continue;
        }
        let before = window.sensed(n - 1).motor_counts;
        let turned = window.sensed(n + 1).motor_counts - before;
        let omega = 0.5 * turned as f64 * params.sensors.motor_lsb() * rate;
        ring.push([reference, omega, torque]);
        if ring.is_full() {
            let [reference, omega, _] = ring.sums(&kernel.smooth);
            let [d_reference, d_omega, d_torque] = ring.sums(&kernel.first);
            let law = |d: f64, value: f64| controller.k_p * d + controller.k_i * value;
            equations.add(&[law(d_reference, reference), -law(d_omega, omega)], d_torque);
        }
    }
    if !in_position_mode {
        return Err(Needed::PositionMode);
    }
    ratio(&equations, kernel.span).ok_or(Needed::UnsaturatedControl)
}

/// Ratio of both unknowns and its standard deviation; `None` where the rows do not show it.
fn ratio(equations: &NormalEquations<2>, span: usize) -> Option<Reading> {
    if equations.rows < 4 * span {
        return None;
    }
    let solution = equations.solve()?;
    let (g, h) = (solution.x[0], solution.x[1]);
    let variance = solution.residual_rms * solution.residual_rms * span as f64;
    // Gradient (1/h, −g/h²) of the ratio; the correlation of both unknowns is left out, which widens a ratio of equal signs.
    let relative = solution.inverse_diagonal[0] + solution.inverse_diagonal[1] * (g / h) * (g / h);
    let reading = Reading {
        value: g / h,
        sigma: libm::sqrt(variance * relative) / libm::fabs(h),
    };
    (reading.value.is_finite() && reading.sigma.is_finite()).then_some(reading)
}
