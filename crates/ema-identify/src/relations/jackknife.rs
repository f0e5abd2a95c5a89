//! Variance of a least squares whose errors are neither white nor alike, from the window itself.
//!
//! The rows are cut into consecutive groups, and the equations are solved without each of them in turn. Where errors last longer than
//! a kernel, or stand in the few rows that show an unknown, the solutions differ by more than the covariance of independent errors
//! says. Without group g the solution changes by `δ = (N − N_g)⁻¹ s_g`, to first order by `d = N⁻¹ s_g`, with the score
//! `s_g = Σ a (y − a · x)` of its rows. `Var x = Σ_g d δ`: independent errors of variance σ² have the mean `σ² N⁻¹`, while `Σ d²` is too
//! small and `Σ δ²`, the grouped jackknife, too large by the leverage of the groups, as in a ramp, of which the start alone shows most.
//! Derived here; of one unknown it is Wu's weighted jackknife (Annals of Statistics 14, 1986). One group is held at a time, so the
//! rows stream through it once more after the solution.

use nalgebra::SVector;

use super::normal_equations::{NormalEquations, Solution};

/// Groups of a window: each of 40 ms in half a second, longer than the widest kernel.
const GROUPS: usize = 12;

/// Fewest groups with rows from which a variance is taken.
const MIN_GROUPS: f64 = 4.0;

/// The solutions without each group, `K` quantities of each.
#[derive(Clone, Copy, Debug)]
pub(super) struct Jackknife<'a, const M: usize, const K: usize> {
    whole: &'a NormalEquations<M>,
    solution: &'a Solution<M>,
    samples: usize,
    /// Place of the group whose rows are being summed.
    place: usize,
    group: NormalEquations<M>,
    /// Expected squares of the noise in each column of one row, as they were subtracted from the whole.
    noise: &'a SVector<f64, M>,
    /// Products of both changes, summed over the groups.
    products: SVector<f64, K>,
    count: f64,
}

impl<'a, const M: usize, const K: usize> Jackknife<'a, M, K> {
    /// No rows, in a window of this many samples, whose equations had this noise subtracted.
    #[must_use]
    pub(super) fn new(
        samples: usize,
        whole: &'a NormalEquations<M>,
        solution: &'a Solution<M>,
        noise: &'a SVector<f64, M>,
    ) -> Self {
        Self {
            whole,
            solution,
            samples: samples.max(1),
            place: 0,
            group: NormalEquations::new(),
            noise,
            products: SVector::zeros(),
            count: 0.0,
        }
    }

    /// Adds the row `a · x = y` of a sample; samples in ascending order. `of` are the quantities that follow from a solution.
    pub(super) fn add(
        &mut self,
        sample: usize,
        (a, y): (&[f64; M], f64),
        of: impl Fn(&SVector<f64, M>) -> SVector<f64, K>,
    ) {
        let place = sample * GROUPS / self.samples;
        if place != self.place {
            self.close(of);
            self.place = place;
        }
        self.group.add(a, y);
    }

    /// Variance of each quantity; 0 where the rows stand in too few groups.
    #[must_use]
    pub(super) fn variance(&mut self, of: impl Fn(&SVector<f64, M>) -> SVector<f64, K>) -> SVector<f64, K> {
        self.close(of);
        if self.count < MIN_GROUPS {
            return SVector::zeros();
        }
        self.products.map(|products| products.max(0.0))
    }

    /// Solves without the rows of the group, and begins the next one.
    #[inline(never)]
    fn close(&mut self, of: impl Fn(&SVector<f64, M>) -> SVector<f64, K>) {
        if self.group.rows > 0 {
            let group = &mut self.group;
            // With its share of the whole's noise, so that the scores of all groups sum to zero.
            group.without_noise_of(self.whole);
            let first_order = self.solution.inverse * group.score(&self.solution.x);
            group.leave(self.whole);
            group.without_noise(self.noise);
            // Where the group has nearly all that the window shows of an unknown, what is left may be less than its noise.
            let mut without = group.solve();
            if without.is_none() {
                group.restore_noise();
                without = group.solve();
            }
            if let Some(without) = without {
                let found = of(&self.solution.x);
                let change = found - of(&without.x);
                self.products += change.component_mul(&(found - of(&(self.solution.x - first_order))));
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

    /// Variance of the solution of 240 rows `a x = error`, and `1 / Σ a²`.
    fn variance(a: impl Fn(usize) -> f64, error: impl Fn(usize) -> f64) -> [f64; 2] {
        let mut whole = NormalEquations::<1>::new();
        (0..240).for_each(|n| whole.add(&[a(n)], error(n)));
        let (solution, noise) = (whole.solve().unwrap(), Vector1::zeros());
        let mut jackknife = Jackknife::<1, 1>::new(240, &whole, &solution, &noise);
        for n in 0..240 {
            jackknife.add(n, (&[a(n)], error(n)), SVector::clone);
        }
        [jackknife.variance(SVector::clone)[0], solution.inverse[(0, 0)]]
    }

    #[test]
    fn a_group_that_shows_nearly_all_of_a_noisy_column_counts() {
        // The first of twelve groups says 1.3; the others, in which half of the column is noise, say -1.
        let row = |n: usize| match (n < 20, n.is_multiple_of(2)) {
            (true, _) => (1.0, 1.3),
            (false, true) => (0.2, -0.2),
            (false, false) => (-0.2, 0.2),
        };
        let mut whole = NormalEquations::<1>::new();
        (0..240).for_each(|n| whole.add(&[row(n).0], row(n).1));
        let noise = Vector1::from([0.04]);
        whole.without_noise(&noise);
        let solution = whole.solve().unwrap();
        let mut jackknife = Jackknife::<1, 1>::new(240, &whole, &solution, &noise);
        for n in 0..240 {
            jackknife.add(n, (&[row(n).0], row(n).1), SVector::clone);
        }
        // By hand: 0.46 (first order) times 2.9 of the first group, 0.04 squared of each other.
        let variance = jackknife.variance(SVector::clone)[0];
        assert!((variance - 1.35).abs() < 0.05, "{variance}");
    }

    #[test]
    fn errors_that_last_make_a_mean_more_uncertain() {
        let [white, _] = variance(|_| 1.0, |n| if n % 2 == 0 { 1.0 } else { -1.0 });
        let [lasting, _] = variance(|_| 1.0, |n| if (n / 20) % 2 == 0 { 1.0 } else { -1.0 });
        // Twelve means of twenty rows each: variance 1/12 of theirs.
        assert!(
            (lasting * 12.0 - 1.1).abs() < 0.15 && white < 0.01 * lasting,
            "{white} {lasting}"
        );
    }

    #[test]
    fn a_start_that_shows_nearly_all_leaves_the_variance_of_white_errors_right() {
        // The first of twelve groups has 0.95 of the information. Independent errors of ±1, of a linear congruence.
        let mut state = 1u64;
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            if state >> 63 == 0 { 1.0 } else { -1.0 }
        };
        let draws = 300;
        let mean = (0..draws).fold(0.0, |mean, _| {
            let errors: [f64; 240] = core::array::from_fn(|_| draw());
            let [found, expected] = variance(|n| if n < 20 { 1.0 } else { 0.07 }, |n| errors[n]);
            mean + found / expected / f64::from(draws)
        });
        assert!((mean - 1.0).abs() < 0.25, "{mean}");
    }
}
