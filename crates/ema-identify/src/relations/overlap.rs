//! Covariance of a least squares whose rows share samples.
//!
//! A row's error is `Σ_m w_m ε_{n+m}`, with the kernel w and independent errors ε of the samples. The solution's error is then
//! `N⁻¹ Σ_n ε_n b_n`, `b_n = Σ_m w_m a_{n−m}`: the rows a, smoothed by the kernel once more. Its covariance is
//! `σ_ε² N⁻¹ (Σ b bᵀ) N⁻¹` with `N = Σ a aᵀ` and `σ_ε² = σ_row² / Σ w²`. Derived here. For slow rows under a smoothing kernel it
//! counts one row in `1 / Σ w²` as independent; under a differentiating one nearly all of a slow error cancels.

use nalgebra::SMatrix;

use super::kernel::MAX_SPAN;
use super::normal_equations::{NormalEquations, Solution};
use super::sliding::Sliding;

/// Sums `Σ b bᵀ` of the rows of consecutive samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Overlap<'a, const M: usize> {
    weights: &'a [f64; MAX_SPAN],
    span: usize,
    rows: Sliding<M>,
    sums: SMatrix<f64, M, M>,
}

impl<'a, const M: usize> Overlap<'a, M> {
    /// No rows, for rows with errors of these kernel weights.
    #[must_use]
    pub(super) fn new(weights: &'a [f64; MAX_SPAN], span: usize) -> Self {
        Self {
            weights,
            span,
            rows: Sliding::new(span),
            sums: SMatrix::zeros(),
        }
    }

    /// Adds the row of a sample; `None` where it has none.
    pub(super) fn add(&mut self, row: Option<&[f64; M]>) {
        self.rows.push(row.copied().unwrap_or([0.0; M]));
        let b = self.rows.sums(self.weights);
        for column in 0..M {
            for row in column..M {
                self.sums[(row, column)] += b[row] * b[column];
            }
        }
    }

    /// Covariance of the solution of the equations of these rows.
    #[must_use]
    #[inline(never)]
    pub(super) fn covariance(&mut self, equations: &NormalEquations<M>, solution: &Solution<M>) -> SMatrix<f64, M, M> {
        for _ in 1..self.span {
            self.add(None);
        }
        self.sums.fill_upper_triangle_with_lower_triangle();
        let freedom = equations.rows.saturating_sub(M).max(1) as f64;
        let row_variance = solution.residual_rms * solution.residual_rms * equations.rows as f64 / freedom;
        let squares: f64 = self.weights.iter().map(|weight| weight * weight).sum();
        solution.inverse * self.sums * solution.inverse * (row_variance / squares)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::relations::compliance::Compliance;
    use crate::relations::kernel::{HALF_WIDTHS_S, Kernel};

    #[test]
    fn a_mean_of_smoothed_errors_is_as_uncertain_as_one_of_the_errors() {
        // A constant of 400 rows: variance σ_ε² / 400, up to the ends; the rows alone would say σ_row² / 400.
        let kernel = Kernel::new(HALF_WIDTHS_S[0], 2000.0, &Compliance::RIGID);
        let mut equations = NormalEquations::<1>::new();
        let mut overlap = Overlap::new(&kernel.smooth, kernel.span);
        for n in 0..400 {
            equations.add(&[1.0], if n % 2 == 0 { 1.0 } else { -1.0 });
            overlap.add(Some(&[1.0]));
        }
        let solution = equations.solve().unwrap();
        let squares: f64 = kernel.smooth.iter().map(|weight| weight * weight).sum();
        let variance = overlap.covariance(&equations, &solution)[(0, 0)];
        assert!((variance * 400.0 * squares - 1.0).abs() < 0.02, "{variance}");
    }
}
