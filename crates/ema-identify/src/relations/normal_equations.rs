//! Normal equations of a linear least-squares problem of fixed size, accumulated row by row.

use nalgebra::{SMatrix, SVector};

/// Information added to each unknown, relative to its own column: keeps what no row shows solvable, at zero with a
/// variance that tells, and changes nothing else.
const RELATIVE_RIDGE: f64 = 1e-10;

/// Sums over the rows `a · x = y`.
#[derive(Clone, Copy, Debug)]
pub(super) struct NormalEquations<const M: usize> {
    /// `Σ a aᵀ`.
    pub(super) ata: SMatrix<f64, M, M>,
    /// `Σ a y`.
    pub(super) aty: SVector<f64, M>,
    /// `Σ y²`.
    pub(super) yy: f64,
    /// Number of rows.
    pub(super) rows: usize,
    /// What [`NormalEquations::without_noise`] has subtracted from the diagonal of `Σ a aᵀ`.
    noise: SVector<f64, M>,
}

/// Solution of a least-squares problem.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solution<const M: usize> {
    /// The unknowns.
    pub(super) x: SVector<f64, M>,
    /// `(Σ a aᵀ)⁻¹`.
    pub(super) inverse: SMatrix<f64, M, M>,
    /// Root-mean-square of `y − a · x` with the columns as they are, their noise included.
    pub(super) residual_rms: f64,
    /// The same without the noise that was subtracted from the columns.
    pub(super) quiet_rms: f64,
}

impl<const M: usize> NormalEquations<M> {
    /// No rows.
    #[must_use]
    pub(super) fn new() -> Self {
        Self {
            ata: SMatrix::zeros(),
            aty: SVector::zeros(),
            yy: 0.0,
            rows: 0,
            noise: SVector::zeros(),
        }
    }

    /// Adds the row `a · x = y`.
    pub(super) fn add(&mut self, a: &[f64; M], y: f64) {
        for column in 0..M {
            for row in column..M {
                self.ata[(row, column)] += a[row] * a[column];
            }
            self.aty[column] += a[column] * y;
        }
        self.yy += y * y;
        self.rows += 1;
    }

    /// Subtracts the expected squares of the noise in each column of a row, at most half of a column's own.
    pub(super) fn without_noise(&mut self, noise: &SVector<f64, M>) {
        for place in 0..M {
            let own = self.ata[(place, place)];
            let noise = (noise[place] * self.rows as f64).min(0.5 * own);
            self.ata[(place, place)] -= noise;
            self.noise[place] += noise;
        }
    }

    /// Adds what [`NormalEquations::without_noise`] has subtracted.
    pub(super) fn restore_noise(&mut self) {
        for place in 0..M {
            self.ata[(place, place)] += self.noise[place];
        }
        self.noise = SVector::zeros();
    }

    /// Subtracts from a group of the rows of `whole` the share of the noise that was subtracted there.
    pub(super) fn without_noise_of(&mut self, whole: &Self) {
        let share = self.rows as f64 / whole.rows.max(1) as f64;
        for place in 0..M {
            self.ata[(place, place)] -= share * whole.noise[place];
            self.noise[place] += share * whole.noise[place];
        }
    }

    /// Puts the other rows of `whole` in the place of a group of them, nothing subtracted from either for noise.
    pub(super) fn leave(&mut self, whole: &Self) {
        self.restore_noise();
        for column in 0..M {
            for row in column..M {
                self.ata[(row, column)] = whole.ata[(row, column)] - self.ata[(row, column)];
            }
            self.ata[(column, column)] += whole.noise[column];
            self.aty[column] = whole.aty[column] - self.aty[column];
        }
        self.yy = whole.yy - self.yy;
        self.rows = whole.rows - self.rows;
    }

    /// The matrix `Σ a aᵀ`, whose upper triangle [`NormalEquations::add`] leaves out.
    #[must_use]
    pub(super) fn symmetric(&self) -> SMatrix<f64, M, M> {
        let mut whole = self.ata;
        whole.fill_upper_triangle_with_lower_triangle();
        whole
    }

    /// `Σ a (y − a · x)`.
    #[must_use]
    pub(super) fn score(&self, x: &SVector<f64, M>) -> SVector<f64, M> {
        SVector::from_fn(|row, _| {
            let products = (0..M).map(|column| self.ata[(row.max(column), row.min(column))] * x[column]);
            self.aty[row] - products.sum::<f64>()
        })
    }

    /// The unknowns with the least sum of squares; `None` when a sum is not finite.
    #[must_use]
    #[inline(never)]
    pub(super) fn solve(&self) -> Option<Solution<M>> {
        let matrix = self.symmetric();
        let scale = SVector::<f64, M>::from_fn(|m, _| {
            let length = libm::sqrt(matrix[(m, m)]);
            if length > 0.0 { 1.0 / length } else { 1.0 }
        });
        let mut scaled =
            SMatrix::<f64, M, M>::from_fn(|row, column| matrix[(row, column)] * scale[row] * scale[column]);
        for m in 0..M {
            scaled[(m, m)] += RELATIVE_RIDGE;
        }
        let factor = scaled.cholesky()?;
        let inverse = factor.inverse();
        let x = factor.solve(&self.aty.component_mul(&scale)).component_mul(&scale);
        let quiet = self.yy - 2.0 * x.dot(&self.aty) + x.dot(&(matrix * x));
        let squares = quiet + x.component_mul(&x).dot(&self.noise);
        let rms = |squares: f64| libm::sqrt(squares.max(0.0) / (self.rows.max(1) as f64));
        let solution = Solution {
            x,
            inverse: SMatrix::from_fn(|row, column| inverse[(row, column)] * scale[row] * scale[column]),
            residual_rms: rms(squares),
            quiet_rms: rms(quiet),
        };
        (solution.x.iter().all(|x| x.is_finite()) && solution.residual_rms.is_finite()).then_some(solution)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_found_and_an_empty_column_is_uncertain() {
        let mut equations = NormalEquations::<3>::new();
        for n in 0..20 {
            let t = f64::from(n);
            equations.add(&[1.0, t, 0.0], 2.0 - 0.5 * t);
        }
        let solution = equations.solve().unwrap();
        assert!((solution.x[0] - 2.0).abs() < 1e-6 && (solution.x[1] + 0.5).abs() < 1e-6);
        assert!(solution.x[2].abs() < 1e-12 && solution.inverse[(2, 2)] > 1e9);
        assert!(solution.residual_rms < 1e-6);
    }

    #[test]
    fn noise_in_a_column_is_taken_from_the_matrix_and_left_in_the_residual() {
        // y = 2 a, the column with an error of ±0.5: independent of it, and of mean square 0.25.
        let mut equations = NormalEquations::<1>::new();
        for n in 0..400 {
            let (a, error) = (if n % 4 < 2 { 1.0 } else { -1.0 }, if n % 2 == 0 { 0.5 } else { -0.5 });
            equations.add(&[a + error], 2.0 * a);
        }
        equations.without_noise(&SVector::from([0.25]));
        let solution = equations.solve().unwrap();
        assert!((solution.x[0] - 2.0).abs() < 1e-6, "{}", solution.x[0]);
        assert!((solution.residual_rms - 1.0).abs() < 1e-6 && solution.quiet_rms < 1e-4);
        // Half of the rows have half of the noise, and what they leave the rest.
        let mut group = NormalEquations::<1>::new();
        for _ in 0..200 {
            group.add(&[1.5], 2.0);
        }
        group.without_noise_of(&equations);
        assert!((group.ata[(0, 0)] - 200.0 * (2.25 - 0.25)).abs() < 1e-9);
        group.leave(&equations);
        assert!((group.ata[(0, 0)] - (400.0 * 1.25 - 200.0 * 2.25)).abs() < 1e-9 && group.rows == 200);
    }

    #[test]
    fn a_sum_that_is_not_finite_has_no_solution() {
        let mut equations = NormalEquations::<1>::new();
        equations.add(&[f64::NAN], 1.0);
        assert!(equations.solve().is_none());
    }
}
