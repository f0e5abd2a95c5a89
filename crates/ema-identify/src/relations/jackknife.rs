//! Variance of a least squares whose errors are neither white nor alike, from the window itself.
//!
//! The rows are cut into consecutive groups, and the equations are solved without each of them in turn. Where errors last longer than
//! a kernel, or stand in the few rows that show an unknown, the solutions differ by more than the covariance of independent errors
//! says: `Var x = (m − 1)/m Σ (x₍₋ᵦ₎ − x̄)²` over the m groups with rows (grouped jackknife). One group is held at a time, so the rows
//! stream through it once more after the solution.

use nalgebra::SVector;

use super::normal_equations::NormalEquations;

/// Groups of a window: each of 40 ms in half a second, longer than the widest kernel.
const GROUPS: usize = 12;

/// Fewest groups with rows from which a variance is taken.
const MIN_GROUPS: f64 = 4.0;

/// The solutions without each group, `K` quantities of each.
#[derive(Clone, Copy, Debug)]
pub(super) struct Jackknife<const M: usize, const K: usize> {
    samples: usize,
    /// Place of the group whose rows are being summed.
    place: usize,
    group: NormalEquations<M>,
    /// Expected squares of the noise in each column of one row.
    noise: SVector<f64, M>,
    sum: SVector<f64, K>,
    squares: SVector<f64, K>,
    count: f64,
}

impl<const M: usize, const K: usize> Jackknife<M, K> {
    /// No rows, in a window of this many samples, with the noise that was subtracted from the whole.
    #[must_use]
    pub(super) fn new(samples: usize, noise: &SVector<f64, M>) -> Self {
        Self {
            samples: samples.max(1),
            place: 0,
            group: NormalEquations::new(),
            noise: *noise,
            sum: SVector::zeros(),
            squares: SVector::zeros(),
            count: 0.0,
        }
    }

    /// Adds the row `a · x = y` of a sample; samples in ascending order. `of` are the quantities that follow from a solution.
    pub(super) fn add(
        &mut self,
        sample: usize,
        (a, y): (&[f64; M], f64),
        whole: &NormalEquations<M>,
        of: impl Fn(&SVector<f64, M>) -> SVector<f64, K>,
    ) {
        let place = sample * GROUPS / self.samples;
        if place != self.place {
            self.close(whole, of);
            self.place = place;
        }
        self.group.add(a, y);
    }

    /// Variance of each quantity; 0 where the rows stand in too few groups.
    #[must_use]
    pub(super) fn variance(
        &mut self,
        whole: &NormalEquations<M>,
        of: impl Fn(&SVector<f64, M>) -> SVector<f64, K>,
    ) -> SVector<f64, K> {
        self.close(whole, of);
        if self.count < MIN_GROUPS {
            return SVector::zeros();
        }
        let mean = self.sum / self.count;
        let variance = self.squares / self.count - mean.component_mul(&mean);
        variance.map(|variance| variance.max(0.0)) * (self.count - 1.0)
    }

    /// Solves without the rows of the group, and begins the next one.
    #[inline(never)]
    fn close(&mut self, whole: &NormalEquations<M>, of: impl Fn(&SVector<f64, M>) -> SVector<f64, K>) {
        if self.group.rows > 0 {
            self.group.without_noise(&self.noise);
            let group = &mut self.group;
            group.ata = whole.ata - group.ata;
            group.aty = whole.aty - group.aty;
            group.yy = whole.yy - group.yy;
            group.rows = whole.rows - group.rows;
            if let Some(solution) = group.solve() {
                let found = of(&solution.x);
                self.sum += found;
                self.squares += found.component_mul(&found);
                self.count += 1.0;
            }
        }
        self.group = NormalEquations::new();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector1;

    /// Variance of the mean of 240 rows with these errors.
    fn variance(error: impl Fn(usize) -> f64) -> f64 {
        let mut whole = NormalEquations::<1>::new();
        (0..240).for_each(|n| whole.add(&[1.0], error(n)));
        let mut jackknife = Jackknife::<1, 1>::new(240, &Vector1::zeros());
        for n in 0..240 {
            jackknife.add(n, (&[1.0], error(n)), &whole, SVector::clone);
        }
        jackknife.variance(&whole, SVector::clone)[0]
    }

    #[test]
    fn errors_that_last_make_a_mean_more_uncertain() {
        let white = variance(|n| if n % 2 == 0 { 1.0 } else { -1.0 });
        let lasting = variance(|n| if (n / 20) % 2 == 0 { 1.0 } else { -1.0 });
        // Twelve means of twenty rows each: variance 1/12 of theirs.
        assert!(
            (lasting * 12.0 - 1.1).abs() < 0.15 && white < 0.01 * lasting,
            "{white} {lasting}"
        );
    }
}
