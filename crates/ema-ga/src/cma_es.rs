//! Evolution strategy with covariance matrix adaptation (CMA-ES): settings and search.

use nalgebra::{SMatrix, SVector};

use crate::error::ConfigError;
use crate::log::{Control, GenerationLog};
use crate::operators::standard_normal;
use crate::problem::{Bounds, Objective};
use crate::search::{Evaluate, Outcome, Search};
use crate::stop::{Progress, StopRule};
#[cfg(feature = "std")]
use crate::storage::OwnedStorage;
use crate::storage::Workspace;
use crate::stream::stream;

/// Settings of CMA-ES; all other constants follow from dimension and population.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CmaConfig {
    /// Individuals drawn per generation, at least 4.
    pub population: usize,
    /// Standard deviation of every gene in the first generation, in widths of the box; above 0.
    pub step: f64,
    /// Conditions that end the search.
    pub stop: StopRule,
}

impl CmaConfig {
    /// `4 + 3 ln D` individuals rounded down, a step of 0.3, and the stop rule of the genetic algorithm.
    ///
    /// ```
    /// assert_eq!(ema_ga::CmaConfig::for_dimension(8).population, 10);
    /// ```
    #[must_use]
    pub fn for_dimension(dimension: u32) -> Self {
        Self {
            population: 4 + (3.0 * libm::log(f64::from(dimension.max(1)))) as usize,
            step: 0.3,
            stop: StopRule::for_dimension(dimension),
        }
    }

    /// Checks that the algorithm is defined for these settings.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] with the first value out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        if !(4..u32::MAX as usize).contains(&self.population) {
            return Err(ConfigError::Population {
                got: self.population,
                min: 4,
            });
        }
        if !(self.step > 0.0 && self.step.is_finite()) {
            return Err(ConfigError::Step { got: self.step });
        }
        self.stop.validate()
    }
}

/// Minimises by CMA-ES with weighted recombination, rank-one and rank-μ update.
///
/// The algorithm works in the unit box: the width of each gene is 1.
///
/// 1. The mean is the first individual of the warm start, or the middle of the box; `C = I`, `σ` the first step.
/// 2. `λ` individuals are drawn, `x = m + σ A z` with `C = A Aᵀ` and `z` normal, and clamped into the box.
/// 3. The individuals are evaluated; non-finite costs count as infinite. `observe` receives the line of the generation,
///    which has the best individual so far, and the stop rule is tested.
/// 4. The better half of the individuals moves the mean, with logarithmic weights. The two evolution paths are updated, that
///    of the step size in the coordinates of `A⁻¹`. Rank-one and rank-μ updates change `C`; the length of the path of the
///    step size changes `σ`. Continue with 2.
///
/// Source: N. Hansen, "The CMA Evolution Strategy: A Tutorial", arXiv:1604.00772, with its default constants. The Cholesky
/// factor in place of the symmetric root follows O. Krause et al., "CMA-ES with Optimal Covariance Update and Storage
/// Complexity", NIPS 2016. Clamping is chosen here: it lets the search end on a face of the box.
///
/// # Errors
///
/// [`ConfigError`] when a setting is out of range, the warm start lies outside the box or exceeds the population, or the
/// workspace is too small.
pub fn cma_es<const D: usize, O: Objective<D>, E: Evaluate>(
    search: &Search<'_, D, O, E>,
    config: &CmaConfig,
    workspace: Workspace<'_, D>,
    mut observe: impl FnMut(&GenerationLog<D>) -> Control,
) -> Result<Outcome<D>, ConfigError> {
    config.validate()?;
    search.check_initial(config.population)?;
    let space = workspace.limited_to(config.population, config.stop.history())?;
    let mut progress = Progress::new(config.stop, space.best_costs);
    let bounds = search.objective.bounds();

    let constants = Constants::new(D, config.population);
    let mut state = State::<D>::new(search.initial.first(), bounds, config.step);
    let mut best = ([0.0; D], f64::INFINITY);
    let mut generation = 0;
    loop {
        state.factorise();
        for (i, genes) in space.genes.iter_mut().enumerate() {
            *genes = state.draw(search.seed, generation, i as u32, bounds);
        }
        progress.count_evaluations(search.evaluate(progress.remaining_budget(), space.genes, space.costs));
        for (i, rank) in space.order.iter_mut().enumerate() {
            *rank = i;
        }
        let costs = &space.costs;
        space
            .order
            .sort_unstable_by(|&a, &b| costs[a].total_cmp(&costs[b]).then(a.cmp(&b)));

        let leader = space.order[0];
        if costs[leader] < best.1 || generation == 0 {
            best = (space.genes[leader], costs[leader]);
        }
        let mut line = GenerationLog::new(generation, progress.evaluations(), bounds, space.genes, costs);
        (line.best_genes, line.best_cost) = best;
        if let Some(stop) = progress.end_generation(&line, &mut observe) {
            return Ok(Outcome::new(&line, stop));
        }
        state.adapt(&constants, space.genes, space.order, bounds, generation);
        generation += 1;
    }
}

/// [`cma_es`] with memory allocated for this search.
///
/// # Errors
///
/// [`ConfigError`] when a setting is out of range, or the warm start lies outside the box or exceeds the population.
#[cfg(feature = "std")]
pub fn cma_es_owned<const D: usize, O: Objective<D>, E: Evaluate>(
    search: &Search<'_, D, O, E>,
    config: &CmaConfig,
    observe: impl FnMut(&GenerationLog<D>) -> Control,
) -> Result<Outcome<D>, ConfigError> {
    config.validate()?;
    let mut storage = OwnedStorage::new(config.population, config.stop.history());
    cma_es(search, config, storage.workspace(), observe)
}

/// Default constants from table 1 of the tutorial, without negative weights.
struct Constants {
    parents: usize,
    mu_eff: f64,
    c_sigma: f64,
    d_sigma: f64,
    c_c: f64,
    c_1: f64,
    c_mu: f64,
    /// Expected length of a standard normal vector.
    chi: f64,
}

impl Constants {
    fn new(dimension: usize, population: usize) -> Self {
        let n = dimension as f64;
        let parents = population / 2;
        let (mut sum, mut squares) = (0.0, 0.0);
        for rank in 0..parents {
            let w = raw_weight(rank, parents);
            sum += w;
            squares += w * w;
        }
        let mu_eff = sum * sum / squares;
        let c_sigma = (mu_eff + 2.0) / (n + mu_eff + 5.0);
        let c_1 = 2.0 / ((n + 1.3) * (n + 1.3) + mu_eff);
        Self {
            parents,
            mu_eff,
            c_sigma,
            d_sigma: 1.0 + c_sigma + 2.0 * (libm::sqrt((mu_eff - 1.0) / (n + 1.0)) - 1.0).max(0.0),
            c_c: (4.0 + mu_eff / n) / (n + 4.0 + 2.0 * mu_eff / n),
            c_1,
            c_mu: (2.0 * (mu_eff - 2.0 + 1.0 / mu_eff) / ((n + 2.0) * (n + 2.0) + mu_eff)).clamp(0.0, 1.0 - c_1),
            chi: libm::sqrt(n) * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n)),
        }
    }

    fn weight(&self, rank: usize) -> f64 {
        let sum: f64 = (0..self.parents).map(|r| raw_weight(r, self.parents)).sum();
        raw_weight(rank, self.parents) / sum
    }
}

/// `ln(μ + ½) − ln(rank)`, ranks from 1.
fn raw_weight(rank: usize, parents: usize) -> f64 {
    libm::log(parents as f64 + 0.5) - libm::log(rank as f64 + 1.0)
}

/// Sampling distribution `m + σ A z` and its evolution paths, in the unit box.
struct State<const D: usize> {
    mean: SVector<f64, D>,
    step: f64,
    covariance: SMatrix<f64, D, D>,
    factor: SMatrix<f64, D, D>,
    path_sigma: SVector<f64, D>,
    path_c: SVector<f64, D>,
}

impl<const D: usize> State<D> {
    fn new(initial: Option<&[f64; D]>, bounds: &Bounds<D>, step: f64) -> Self {
        Self {
            mean: initial.map_or(SVector::repeat(0.5), |genes| to_unit(genes, bounds)),
            step,
            covariance: SMatrix::identity(),
            factor: SMatrix::identity(),
            path_sigma: SVector::zeros(),
            path_c: SVector::zeros(),
        }
    }

    /// Computes `A` of `C = A Aᵀ`. A covariance that rounding has made indefinite is reset to the identity.
    fn factorise(&mut self) {
        match self.covariance.cholesky() {
            Some(found) => self.factor = found.l(),
            None => {
                self.covariance = SMatrix::identity();
                self.factor = SMatrix::identity();
            }
        }
    }

    /// Draws one individual, clamped into the box.
    fn draw(&self, seed: u64, generation: u32, individual: u32, bounds: &Bounds<D>) -> [f64; D] {
        let rng = &mut stream(seed, generation, individual);
        let z = SVector::from_fn(|_, _| standard_normal(rng));
        let x = self.mean + self.factor * z * self.step;
        bounds.clamp(core::array::from_fn(|i| bounds.lower()[i] + bounds.width(i) * x[i]))
    }

    /// Updates mean, paths, covariance and step size from the ranked individuals of a generation.
    fn adapt(
        &mut self,
        constants: &Constants,
        genes: &[[f64; D]],
        order: &[usize],
        bounds: &Bounds<D>,
        generation: u32,
    ) {
        let Constants {
            c_sigma,
            c_c,
            c_1,
            c_mu,
            ..
        } = *constants;
        let old = self.mean;
        let step_of = |individual: usize| (to_unit(&genes[individual], bounds) - old) / self.step;
        let mut shift = SVector::<f64, D>::zeros();
        let mut spread = SMatrix::<f64, D, D>::zeros();
        for rank in 0..constants.parents {
            let y = step_of(order[rank]);
            let w = constants.weight(rank);
            shift += y * w;
            spread += y * y.transpose() * w;
        }
        self.mean += shift * self.step;

        let whitened = self.factor.solve_lower_triangular(&shift).unwrap_or(shift);
        self.path_sigma *= 1.0 - c_sigma;
        self.path_sigma += whitened * libm::sqrt(c_sigma * (2.0 - c_sigma) * constants.mu_eff);
        let length = self.path_sigma.norm();
        // The path of C is not updated while the step size grows fast.
        let settled = 1.0 - libm::pow(1.0 - c_sigma, 2.0 * f64::from(generation + 1));
        let bound = (1.4 + 2.0 / (D as f64 + 1.0)) * constants.chi;
        let moving = if length / libm::sqrt(settled) < bound { 1.0 } else { 0.0 };
        self.path_c *= 1.0 - c_c;
        self.path_c += shift * (moving * libm::sqrt(c_c * (2.0 - c_c) * constants.mu_eff));

        let forgotten = c_1 + c_mu - c_1 * (1.0 - moving) * c_c * (2.0 - c_c);
        self.covariance *= 1.0 - forgotten;
        self.covariance += self.path_c * self.path_c.transpose() * c_1 + spread * c_mu;
        self.step *= libm::exp((c_sigma / constants.d_sigma * (length / constants.chi - 1.0)).min(1.0));
    }
}

fn to_unit<const D: usize>(genes: &[f64; D], bounds: &Bounds<D>) -> SVector<f64, D> {
    SVector::from_fn(|i, _| (genes[i] - bounds.lower()[i]) / bounds.width(i))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_for_ten_dimensions_match_the_tutorial() {
        // λ = 10: μ = 5; the other values follow from the table's formulas by hand.
        let c = Constants::new(10, 10);
        assert_eq!(c.parents, 5);
        assert!((c.mu_eff - 3.167).abs() < 1e-3, "{}", c.mu_eff);
        assert!(
            (c.c_sigma - 0.2844).abs() < 1e-4 && (c.chi - 3.0847).abs() < 1e-3,
            "{} {}",
            c.c_sigma,
            c.chi
        );
        let sum: f64 = (0..5).map(|rank| c.weight(rank)).sum();
        assert!((sum - 1.0).abs() < 1e-12);
    }
}
