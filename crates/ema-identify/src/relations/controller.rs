//! Position gain of one window from the differentiated PI law of the speed loop.
//!
//! `T = K_p e + K_i ∫e`, `e = G_p g (θ_cmd − θ_out) − ω_m`, differentiated once, so that the integral's start is no unknown:
//! `T' = g (K_p e₁' + K_i e₁) − h (K_p ω' + K_i ω)` with `e₁ = G_p (θ_cmd − θ_out)`. T is `G_T i_q` as measured. The ratio
//! `g/h` is the gain factor `0.5 + k8`, whatever the scale of the torque. The current follows its reference late, more so in fast motion:
//! `τ T''` on the left is the third unknown, without which the ratio of one motion differs from that of another. A set point that takes
//! effect δ after it is logged adds `−g δ G_p (K_p θ_cmd'' + K_i θ_cmd')`, which in steady motion looks like another gain: `setpoint_delay`
//! has it as the fourth unknown. Derived here from the control law.

use ema_models::dq_from_abc;
use nalgebra::{Vector1, Vector3};

use super::compliance::Compliance;
use super::elements::{Needed, Reading};
use super::jackknife::Jackknife;
use super::kernel::Kernel;
use super::measured::MeasuredWindow;
use super::normal_equations::NormalEquations;
use super::overlap::Overlap;
use super::residual::Residual;
use super::sliding::Sliding;
use crate::monitor_fit::RecordedSample;

/// Largest speed reference at the nominal gain, as a share of ω_max: with the largest gain factor of 1.5 it stays below the
/// limit.
const SPEED_SHARE: f64 = 0.65;

/// Unknowns: g, h and the lag τ.
pub(super) const LAW_COUNT: usize = 3;

/// The same and g δ, of a set point that takes effect δ after it is logged.
pub(super) const DELAYED_COUNT: usize = LAW_COUNT + 1;

/// Ratio `g/h` of a window and residual of the law, Nm/s, with a kernel of this half width, s.
#[inline(never)]
pub(super) fn gain_ratio<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    half_width_s: f64,
) -> Result<(Reading, Residual), Needed> {
    let kernel = Kernel::new(half_width_s, window.params().sensors.sample_rate, &Compliance::RIGID);
    if !window.inner().any(|n| window.position_error(n).is_some()) {
        return Err(Needed::PositionMode);
    }
    let mut equations = NormalEquations::new();
    for (row, d_torque) in law_rows(window, &kernel).flatten() {
        equations.add(&row, d_torque);
    }
    ratio(window, &equations, &kernel).ok_or(Needed::UnsaturatedControl)
}

/// Rows of the law, one per inner sample: factors of g, h and τ, and T', Nm/s; `None` unless neither speed nor torque is at its limit
/// under the kernel that ends there.
pub(super) fn law_rows<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    kernel: &Kernel,
) -> impl Iterator<Item = Option<([f64; LAW_COUNT], f64)>> {
    delayed_law_rows(window, kernel, 1).map(|row| row.map(|([g, h, lag, _], d_torque)| ([g, h, lag], d_torque)))
}

/// The same with the factor of g δ, one row for each block of so many inner samples, whose means the kernel smooths.
pub(super) fn delayed_law_rows<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    kernel: &Kernel,
    block: usize,
) -> impl Iterator<Item = Option<([f64; DELAYED_COUNT], f64)>> {
    let window = *window;
    let controller = &window.params().controller;
    let mut ring = Sliding::<4>::new(kernel.span);
    let (begin, blocks) = (window.inner().start, window.inner().len() / block);
    (0..blocks).map(move |place| {
        let mut mean = [0.0; 4];
        for n in (begin + place * block..).take(block) {
            let Some(measured) = law_quantities(&window, n) else {
                ring.clear();
                return None;
            };
            for (mean, measured) in mean.iter_mut().zip(measured) {
                *mean += measured / block as f64;
            }
        }
        ring.push(mean);
        if !ring.is_full() {
            return None;
        }
        let [reference, omega, ..] = ring.sums(&kernel.smooth);
        let [d_reference, d_omega, d_torque, d_command] = ring.sums(&kernel.first);
        let [_, _, dd_torque, dd_command] = ring.sums(&kernel.second);
        let law = |d: f64, value: f64| controller.k_p * d + controller.k_i * value;
        Some((
            [
                law(d_reference, reference),
                -law(d_omega, omega),
                -dd_torque,
                -law(dd_command, d_command),
            ],
            d_torque,
        ))
    })
}

/// Speed reference, speed, both rad/s, torque that the controller asks for, whatever the motor makes of it, Nm, and what the set point
/// has of the reference since the first sample, rad/s; `None` where speed or torque is at its limit or the sample was not measured.
fn law_quantities<S: RecordedSample>(window: &MeasuredWindow<'_, S>, n: usize) -> Option<[f64; 4]> {
    let params = window.params();
    let g_p = params.controller.g_p;
    let reference = g_p * window.position_error(n)?;
    let command = g_p * (window.commanded_angle(n)? - window.commanded_angle(0)?);
    let now = window.quantities(n);
    let [_, quadrature] = dq_from_abc(now.i, now.sin_cos_e);
    let limited = now.speed_reference >= SPEED_SHARE || window.is_current_limited(quadrature);
    if limited || !window.is_measured(n) {
        return None;
    }
    let torque = params.motor.torque_gain() * quadrature;
    Some([reference, window.central_speed(n), torque, command])
}

/// Kernels whose rows do not overlap, at least, for a ratio.
pub(super) const MIN_INDEPENDENT: usize = 4;

/// Ratio of the first two unknowns and its standard deviation; `None` where the rows do not show it.
#[inline(never)]
fn ratio<S: RecordedSample>(
    window: &MeasuredWindow<'_, S>,
    equations: &NormalEquations<LAW_COUNT>,
    kernel: &Kernel,
) -> Option<(Reading, Residual)> {
    if equations.rows < MIN_INDEPENDENT * kernel.span {
        return None;
    }
    let solution = equations.solve()?;
    let mut overlap = Overlap::<LAW_COUNT>::new(&kernel.first, kernel.span);
    let no_noise = Vector3::zeros();
    let mut groups = Jackknife::<LAW_COUNT, 1>::new(window.len(), equations, &solution, &no_noise);
    let of = |x: &Vector3<f64>| Vector1::new(x[0] / x[1]);
    for (n, row) in law_rows(window, kernel).enumerate() {
        overlap.add(row.as_ref().map(|(row, _)| row));
        if let Some((row, d_torque)) = &row {
            groups.add(n, (row, *d_torque), of);
        }
    }
    let covariance = overlap.covariance(equations, &solution);
    let (g, h) = (solution.x[0], solution.x[1]);
    // Gradient of g/h.
    let gradient = Vector3::new(1.0 / h, -g / (h * h), 0.0);
    let variance = gradient.dot(&(covariance * gradient)).max(groups.variance(of)[0]);
    let reading = Reading {
        value: g / h,
        sigma: libm::sqrt(variance),
    };
    let residual = Residual {
        rms: solution.residual_rms,
        independent: (equations.rows / kernel.span) as f64,
    };
    (reading.value.is_finite() && reading.sigma.is_finite()).then_some((reading, residual))
}
