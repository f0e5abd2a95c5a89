//! The kernel that turns differential equations into equations between samples.
//!
//! An equation is multiplied by the kernel f around every sample and summed. Derivatives move onto the kernel, where they are
//! its exact differences on the grid of the samples: analytic derivatives, sampled, do not sum to zero and would leak the
//! angle itself into its acceleration. Derived here.

use super::compliance::Compliance;

/// Largest half width W, samples: 12 ms at 2 kHz, 3 ms at 8 kHz.
const MAX_HALF_WIDTH: usize = 24;

/// Samples under the widest kernel.
pub(super) const MAX_SPAN: usize = 2 * MAX_HALF_WIDTH + 1;

/// Smallest half width W, samples: the difference of two neighbours and of three.
const MIN_HALF_WIDTH: usize = 1;

/// Half widths of which one is chosen for a unit, s. A wide kernel attenuates what a derivative makes of a jittering sample
/// instant and of a resonance, and the motion itself.
pub(super) const HALF_WIDTHS_S: [f64; 3] = [3e-3, 6e-3, 12e-3];

/// Rows per half width that are used, at least: those between are nearly sums of their neighbours.
const ROWS_PER_HALF_WIDTH: usize = 6;

/// Weights of one half width; sample `n + m − W` has the weights at place `m`, places beyond the span are zero.
#[derive(Clone, Copy, Debug)]
pub struct Kernel {
    /// Samples under the kernel, `2 W + 1`.
    pub(super) span: usize,
    /// Samples from one used row to the next.
    pub(super) stride: usize,
    /// `f_m ∝ (1 − (m/W)²)⁴`, of unit sum, zero at both ends.
    pub(super) smooth: [f64; MAX_SPAN],
    /// `f + Δ²f / 12`: for what is not differentiated, beside the second difference of an angle. That difference is the
    /// acceleration smoothed by f and by a triangle of one sample, whose second moment is `Δ²/12` of f.
    pub(super) average: [f64; MAX_SPAN],
    /// First derivative, 1/s: `Σ first_m x_m` is x' smoothed by f, from the central difference of the kernel.
    pub(super) first: [f64; MAX_SPAN],
    /// Second derivative, 1/s²: `Σ second_m x_m` is x'' smoothed by f, from the second difference of the kernel.
    pub(super) second: [f64; MAX_SPAN],
}

impl Kernel {
    /// The kernel of a motor shaft before a stiff transmission: half width, s, at a sample rate, Hz; 1 to 24 samples on either side.
    #[must_use]
    pub fn rigid(half_width_s: f64, sample_rate: f64) -> Self {
        Self::new(half_width_s, sample_rate, &Compliance::RIGID)
    }

    /// Samples on either side.
    #[must_use]
    pub fn half_width(&self) -> usize {
        self.span / 2
    }

    /// Weights of what is not differentiated: `f + Δ²f / 12`.
    #[must_use]
    pub fn average(&self) -> &[f64] {
        &self.average[..self.span]
    }

    /// Weights of the second derivative, 1/s².
    #[must_use]
    pub fn second(&self) -> &[f64] {
        &self.second[..self.span]
    }

    /// The kernel for a half width, s, at a sample rate, Hz: 1 to 24 samples on either side; of the motor shaft before this transmission.
    #[must_use]
    pub(super) fn new(half_width_s: f64, sample_rate: f64, compliance: &Compliance) -> Self {
        // The fourth difference of f reaches one sample further than f.
        let beyond = usize::from(!compliance.is_rigid());
        let most = MAX_HALF_WIDTH - beyond;
        let half = (libm::round(half_width_s * sample_rate) as usize).clamp(MIN_HALF_WIDTH, most);
        let span = 2 * (half + beyond) + 1;
        let raw = |m: usize| {
            let x = (m as f64 - (half + beyond) as f64) / half as f64;
            let quadratic = (1.0 - x * x).max(0.0);
            let square = quadratic * quadratic;
            square * square
        };
        let sum: f64 = (0..span).map(raw).sum();
        let weights = |weight: &dyn Fn(usize) -> f64| {
            let mut weights = [0.0; MAX_SPAN];
            for (m, slot) in weights.iter_mut().enumerate().take(span) {
                *slot = weight(m);
            }
            weights
        };
        // Zero outside, so that the differences at both ends are exact.
        let at = |weights: &[f64; MAX_SPAN], m: usize, shift: isize| {
            let place = m.checked_add_signed(shift).filter(|&m| m < span);
            place.map_or(0.0, |place| weights[place])
        };
        let difference = |of: &[f64; MAX_SPAN]| weights(&|m| 0.5 * (at(of, m, 1) - at(of, m, -1)));
        let curvature = |of: &[f64; MAX_SPAN]| weights(&|m| at(of, m, 1) - 2.0 * at(of, m, 0) + at(of, m, -1));
        let f = weights(&|m| raw(m) / sum);
        let (f_difference, f_curvature) = (difference(&f), curvature(&f));
        let mut kernel = Self {
            span,
            stride: (half / ROWS_PER_HALF_WIDTH).max(1),
            smooth: f,
            average: weights(&|m| f[m] + f_curvature[m] / 12.0),
            first: weights(&|m| -f_difference[m] * sample_rate),
            second: weights(&|m| f_curvature[m] * sample_rate * sample_rate),
        };
        if !compliance.is_rigid() {
            let with = |of: &[f64; MAX_SPAN], inverse_square: f64| {
                let (first, second) = (difference(of), curvature(of));
                let (by_first, by_second) = (
                    -compliance.lag * sample_rate,
                    inverse_square * sample_rate * sample_rate,
                );
                weights(&|m| of[m] + by_first * first[m] + by_second * second[m])
            };
            // f is the average of a second derivative.
            let (average, smooth) = (with(&kernel.average, 0.0), with(&f, compliance.locked));
            let by_second = compliance.locked * sample_rate * sample_rate;
            kernel.average = weights(&|m| average[m] + by_second * f_curvature[m]);
            kernel.smooth = smooth;
            kernel.first = with(&kernel.first, compliance.locked);
            kernel.second = with(&kernel.second, compliance.free);
        }
        kernel
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Weighted sum of `x` at sample times around zero.
    fn applied(weights: &[f64; MAX_SPAN], kernel: &Kernel, rate: f64, x: impl Fn(f64) -> f64) -> f64 {
        let half = kernel.half_width() as f64;
        (0..kernel.span).map(|m| weights[m] * x((m as f64 - half) / rate)).sum()
    }

    #[test]
    fn differences_are_exact_on_polynomials() {
        for rate in [400.0, 2000.0] {
            let kernel = Kernel::rigid(HALF_WIDTHS_S[0], rate);
            let close =
                |a: f64, b: f64| assert!((a - b).abs() < 1e-7 * (1.0 + b.abs()), "{rate} Hz: {a} instead of {b}");
            close(applied(&kernel.smooth, &kernel, rate, |_| 1.0), 1.0);
            close(applied(&kernel.average, &kernel, rate, |_| 1.0), 1.0);
            for (weights, expected) in [(&kernel.first, [0.0, 1.0, 0.0]), (&kernel.second, [0.0, 0.0, 2.0])] {
                for (degree, expected) in expected.into_iter().enumerate() {
                    close(
                        applied(weights, &kernel, rate, |t| libm::pow(t, degree as f64)),
                        expected,
                    );
                }
            }
        }
    }

    #[test]
    fn average_and_second_difference_smooth_an_oscillation_alike() {
        // x = cos ωt: x'' = −ω² x, so the ratio of both sums is −ω², up to the fourth order of ωΔt.
        let (rate, omega) = (2000.0, core::f64::consts::TAU * 50.0);
        let kernel = Kernel::rigid(HALF_WIDTHS_S[0], rate);
        let x = |t: f64| libm::cos(omega * t);
        let ratio = applied(&kernel.second, &kernel, rate, x) / applied(&kernel.average, &kernel, rate, x);
        assert!((ratio / (-omega * omega) - 1.0).abs() < 1e-5, "{ratio}");
    }

    #[test]
    fn the_half_width_follows_the_sample_rate() {
        let widths = [400.0, 1000.0, 2000.0, 5000.0].map(|rate| Kernel::rigid(HALF_WIDTHS_S[0], rate).half_width());
        assert_eq!(widths, [1, 3, 6, 15]);
    }
}
