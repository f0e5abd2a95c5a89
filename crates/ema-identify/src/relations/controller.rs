//! Position gain of one window from the differentiated PI law of the speed loop.
//!
//! `T = K_p e + K_i ∫e`, `e = G_p g (θ_cmd − θ_out) − ω_m`, differentiated once, so that the integral's start is no unknown:
//! `T' = g (K_p e₁' + K_i e₁) − h (K_p ω' + K_i ω)` with `e₁ = G_p (θ_cmd − θ_out)`. T is `G_T i_q` as measured. The ratio
//! `g/h` is the gain factor `0.5 + k8`, whatever the scale of the torque. The current follows its reference late, more so in fast motion:
//! `τ T''` on the left is the third unknown, without which the ratio of one motion differs from that of another. Derived here from the
//! control law.

use ema_models::dq_from_abc;
use nalgebra::{Vector1, Vector3};

use super::elements::{Needed, Reading};
use super::jackknife::Groups;
use super::kernel::Kernel;
use super::measured::MeasuredWindow;
use super::overlap::Overlap;
use super::residual::Residual;
use super::sliding::Sliding;
use crate::monitor_fit::RecordedSample;

/// Largest speed reference at the nominal gain, as a share of ω_max: with the largest gain factor of 1.5 it stays below the
/// limit.
const SPEED_SHARE: f64 = 0.65;

/// Unknowns: g, h and the lag.
const UNKNOWNS: usize = 3;

/// Ratio `g/h` of a window and residual of the law, Nm/s, with a kernel of this half width, s.
pub(super) fn gain_ratio<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    half_width_s: f64,
) -> Result<(Reading, Residual), Needed> {
    let params = window.params();
    let (controller, rate) = (&params.controller, params.sensors.sample_rate);
    let kernel = Kernel::new(half_width_s, rate);
    let torque_gain = params.motor.torque_gain();
    let mut ring = Sliding::<3>::new(kernel.span);
    let mut groups = Groups::<UNKNOWNS>::new(window.len());
    let mut overlap = Overlap::<UNKNOWNS>::new(&kernel.first, kernel.span);
    let mut in_position_mode = false;
    for n in window.inner() {
        let error = window.position_error(n);
        in_position_mode |= error.is_some();
        let now = window.quantities(n);
        let reference = error.map(|error| controller.g_p * error);
        let torque = torque_gain * dq_from_abc(now.i, now.sin_cos_e)[1];
        let limited = now.speed_reference >= SPEED_SHARE || window.is_torque_limited(torque);
        let usable = reference.filter(|_| !limited && window.is_measured(n));
        let Some(reference) = usable else {
            ring.clear();
            overlap.add(None);
            continue;
        };
        ring.push([reference, window.central_speed(n), torque]);
        if !ring.is_full() {
            overlap.add(None);
            continue;
        }
        let [reference, omega, _] = ring.sums(&kernel.smooth);
        let [d_reference, d_omega, d_torque] = ring.sums(&kernel.first);
        let law = |d: f64, value: f64| controller.k_p * d + controller.k_i * value;
        let [_, _, dd_torque] = ring.sums(&kernel.second);
        let row = [law(d_reference, reference), -law(d_omega, omega), -dd_torque];
        groups.add(n, &row, d_torque);
        overlap.add(Some(&row));
    }
    if !in_position_mode {
        return Err(Needed::PositionMode);
    }
    ratio(&groups, overlap, kernel.span).ok_or(Needed::UnsaturatedControl)
}

/// Kernels whose rows do not overlap, at least, for a ratio.
const MIN_INDEPENDENT: usize = 4;

/// Ratio of both unknowns and its standard deviation; `None` where the rows do not show it.
fn ratio(groups: &Groups<UNKNOWNS>, overlap: Overlap<UNKNOWNS>, span: usize) -> Option<(Reading, Residual)> {
    let equations = groups.whole();
    if equations.rows < MIN_INDEPENDENT * span {
        return None;
    }
    let solution = equations.solve()?;
    let covariance = overlap.covariance(&equations, &solution);
    let (g, h) = (solution.x[0], solution.x[1]);
    // Gradient of g/h.
    let gradient = Vector3::new(1.0 / h, -g / (h * h), 0.0);
    let of_groups = groups.variance(|x| Vector1::new(x[0] / x[1]))[0];
    let reading = Reading {
        value: g / h,
        sigma: libm::sqrt(gradient.dot(&(covariance * gradient)).max(of_groups)),
    };
    let residual = Residual {
        rms: solution.residual_rms,
        independent: (equations.rows / span) as f64,
    };
    (reading.value.is_finite() && reading.sigma.is_finite()).then_some((reading, residual))
}
