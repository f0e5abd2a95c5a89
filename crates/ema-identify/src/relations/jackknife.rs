//! Variance of a least squares whose errors are neither white nor alike, from the window itself.
//!
//! The rows are cut into consecutive groups, and the equations are solved without each of them in turn. Where errors last longer than
//! a kernel, or stand in the few rows that show an unknown, the solutions differ by more than the rows' covariance says:
//! `Var x = (m − 1)/m Σ (x₍₋ᵦ₎ − x̄)²` over the m groups with rows (grouped jackknife, Efron 1982).

use nalgebra::SVector;

use super::normal_equations::NormalEquations;

/// Groups of a window: each of 40 ms in half a second, longer than the widest kernel.
const GROUPS: usize = 12;

/// Fewest groups with rows from which a variance is taken.
const MIN_GROUPS: f64 = 4.0;

/// Sums over the rows of each group.
#[derive(Clone, Copy, Debug)]
pub(super) struct Groups<const M: usize> {
    equations: [NormalEquations<M>; GROUPS],
    samples: usize,
}

impl<const M: usize> Groups<M> {
    /// No rows, in a window of this many samples.
    #[must_use]
    pub(super) fn new(samples: usize) -> Self {
        Self {
            equations: [NormalEquations::new(); GROUPS],
            samples: samples.max(1),
        }
    }

    /// Adds the row `a · x = y` of a sample.
    pub(super) fn add(&mut self, sample: usize, a: &[f64; M], y: f64) {
        let group = sample * GROUPS / self.samples;
        self.equations[group.min(GROUPS - 1)].add(a, y);
    }

    /// Changes the sums of each group.
    pub(super) fn for_each(&mut self, change: impl FnMut(&mut NormalEquations<M>)) {
        self.equations.iter_mut().for_each(change);
    }

    /// The sums over all rows.
    #[must_use]
    pub(super) fn whole(&self) -> NormalEquations<M> {
        let mut whole = NormalEquations::new();
        for group in &self.equations {
            whole.ata += group.ata;
            whole.aty += group.aty;
            whole.yy += group.yy;
            whole.rows += group.rows;
        }
        whole
    }

    /// Variance of quantities that follow from the unknowns; 0 where the rows stand in too few groups.
    #[must_use]
    pub(super) fn variance<const K: usize>(&self, of: impl Fn(&SVector<f64, M>) -> SVector<f64, K>) -> SVector<f64, K> {
        let whole = self.whole();
        let (mut sum, mut squares, mut count) = (SVector::<f64, K>::zeros(), SVector::<f64, K>::zeros(), 0.0);
        for group in self.equations.iter().filter(|group| group.rows > 0) {
            let others = NormalEquations {
                ata: whole.ata - group.ata,
                aty: whole.aty - group.aty,
                yy: whole.yy - group.yy,
                rows: whole.rows - group.rows,
            };
            let Some(solution) = others.solve() else { continue };
            let found = of(&solution.x);
            sum += found;
            squares += found.component_mul(&found);
            count += 1.0;
        }
        if count < MIN_GROUPS {
            return SVector::zeros();
        }
        let mean = sum / count;
        (squares / count - mean.component_mul(&mean)).map(|variance| variance.max(0.0)) * (count - 1.0)
    }
}
