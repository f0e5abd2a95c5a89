//! Noise of the phase currents of one window, and what it takes from the coefficients of small currents.
//!
//! Noise in the columns of a least squares draws their coefficients towards zero: in a slow ramp, whose current is a tenth of an
//! ampere, phases would seem to lack a tenth of their turns. The expected products of the noise are subtracted from the normal
//! equations. Derived here.

use ema_models::dq_from_abc;

use super::kernel::Kernel;
use super::measured::MeasuredWindow;
use crate::recorded_sample::RecordedSample;

/// `−E ln x²` of a standard normal x: Euler's constant plus ln 2.
const LOG_OF_SQUARE: f64 = 1.270_362_845_461_478;

/// Smallest square that counts, A², so that equal samples have a logarithm.
const LEAST_SQUARE: f64 = 1e-12;

/// Variance of the noise of a phase current, A², from the second differences of `i_d`, which carries no torque: their mean logarithm
/// is little moved by the few large ones of a transient. `Var Δ²x = 6 Var x`, `Var i_d = 2/3 Var i`. What the current ripples between
/// samples counts as noise as well.
pub(super) fn current_noise<S: RecordedSample>(window: &MeasuredWindow<'_, S>) -> f64 {
    let (mut logarithms, mut count) = (0.0, 0.0);
    let mut last = [0.0; 2];
    for (place, n) in window.inner().enumerate() {
        let now = window.instant(n);
        let direct = dq_from_abc(now.i, now.sin_cos_e)[0];
        let difference = direct - 2.0 * last[1] + last[0];
        if place >= 2 && window.is_measured(n) && difference.is_finite() {
            logarithms += libm::log((difference * difference).max(LEAST_SQUARE));
            count += 1.0;
        }
        last = [last[1], direct];
    }
    if count > 0.0 {
        0.25 * libm::exp(logarithms / count + LOG_OF_SQUARE)
    } else {
        0.0
    }
}

/// Mean over the electrical angle of the squared factors of the phase currents in the terms of the turns, `s_j²`, and of the
/// eccentricity, `Σ_j s_j² cos²(θ_e + 2πj/3)`.
const MEAN_SQUARES: [f64; 5] = [0.5, 0.5, 0.5, 0.75, 0.75];

/// Expected squares of the noise in one row of the torque balance: turns, then eccentricity.
pub(super) fn noise_of_columns(variance: f64, k: f64, kernel: &Kernel) -> [f64; 5] {
    let squares: f64 = kernel.average.iter().map(|weight| weight * weight).sum();
    MEAN_SQUARES.map(|mean| mean * squares * k * k * variance)
}
