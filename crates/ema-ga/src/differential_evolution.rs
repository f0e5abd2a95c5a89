//! Differential evolution with self-adapting parameters (jDE): settings and search.

use rand::{Rng, RngExt};

use crate::error::ConfigError;
use crate::log::{Control, GenerationLog};
use crate::problem::{Bounds, Objective};
use crate::search::{Evaluate, Outcome, Search};
use crate::stop::{Progress, StopRule};
#[cfg(feature = "std")]
use crate::storage::OwnedStorage;
use crate::storage::Workspace;
use crate::stream::stream;

/// Settings of differential evolution; scale and crossover rate adapt by themselves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeConfig {
    /// Individuals per generation, at least 4: a trial needs three others.
    pub population: usize,
    /// Conditions that end the search.
    pub stop: StopRule,
}

impl DeConfig {
    /// `10 D` individuals, the usual rule of thumb, and the stop rule of the genetic algorithm.
    ///
    /// ```
    /// assert_eq!(ema_ga::DeConfig::for_dimension(8).population, 80);
    /// ```
    #[must_use]
    pub fn for_dimension(dimension: u32) -> Self {
        Self {
            population: 10 * dimension as usize,
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
        self.stop.validate()
    }
}

/// Minimises by differential evolution, strategy rand/1/bin.
///
/// 1. The first population is the warm start, completed with uniform points of the box; `F = 0.5`, `C = 0.9` for all.
/// 2. The population is evaluated; non-finite costs count as infinite.
/// 3. `observe` receives the line of the generation, and the stop rule is tested.
/// 4. Every individual gets a trial. With probability 0.1 each, the trial draws a new scale `F` from 0.1 to 1 and a new
///    crossover rate `C` from 0 to 1. Three other individuals give `v = x_1 + F (x_2 - x_3)`, clamped into the box. The trial
///    takes each gene from `v` with probability `C`, one random gene always, and the other genes from the individual.
/// 5. The trials are evaluated, as far as the budget allows.
/// 6. A trial whose cost is not higher replaces its individual, and its `F` and `C` replace the individual's. Continue with
///    3.
///
/// Source: J. Brest et al., "Self-adapting control parameters in differential evolution", IEEE Trans. Evol. Comput.
/// 10(6), 2006. Clamping is chosen here: it lets the search end on a face of the box.
///
/// # Errors
///
/// [`ConfigError`] when a setting is out of range, the warm start lies outside the box or exceeds the population, or the
/// workspace is too small.
pub fn differential_evolution<const D: usize, O: Objective<D>, E: Evaluate>(
    search: &Search<'_, D, O, E>,
    config: &DeConfig,
    workspace: Workspace<'_, D>,
    mut observe: impl FnMut(&GenerationLog<D>) -> Control,
) -> Result<Outcome<D>, ConfigError> {
    config.validate()?;
    search.check_initial(config.population)?;
    let space = workspace.limited_to(config.population, config.stop.history())?;
    let mut progress = Progress::new(config.stop, space.best_costs);
    let bounds = search.objective.bounds();

    search.populate(space.genes);
    space.controls.fill([[0.5, 0.9]; 2]);
    progress.count_evaluations(search.evaluate(progress.remaining_budget(), space.genes, space.costs));
    let mut generation = 0;
    loop {
        let line = GenerationLog::new(generation, progress.evaluations(), bounds, space.genes, space.costs);
        if let Some(stop) = progress.end_generation(&line, &mut observe) {
            return Ok(Outcome::new(&line, stop));
        }

        generation += 1;
        for (i, [own, of_trial]) in space.controls.iter_mut().enumerate() {
            let rng = &mut stream(search.seed, generation, i as u32);
            *of_trial = adapt_controls(rng, *own);
            space.offspring[i] = trial(rng, space.genes, i, *of_trial, bounds);
        }

        let evaluated = search.evaluate(progress.remaining_budget(), space.offspring, space.offspring_costs);
        progress.count_evaluations(evaluated);
        for i in 0..evaluated {
            if space.offspring_costs[i] <= space.costs[i] {
                space.genes[i] = space.offspring[i];
                space.costs[i] = space.offspring_costs[i];
                space.controls[i][0] = space.controls[i][1];
            }
        }
    }
}

/// [`differential_evolution`] with memory allocated for this search.
///
/// # Errors
///
/// [`ConfigError`] when a setting is out of range, or the warm start lies outside the box or exceeds the population.
#[cfg(feature = "std")]
pub fn differential_evolution_owned<const D: usize, O: Objective<D>, E: Evaluate>(
    search: &Search<'_, D, O, E>,
    config: &DeConfig,
    observe: impl FnMut(&GenerationLog<D>) -> Control,
) -> Result<Outcome<D>, ConfigError> {
    config.validate()?;
    let mut storage = OwnedStorage::new(config.population, config.stop.history());
    differential_evolution(search, config, storage.workspace(), observe)
}

/// Scale and crossover rate of a trial, given those of its individual.
fn adapt_controls(rng: &mut impl Rng, [scale, rate]: [f64; 2]) -> [f64; 2] {
    [
        if rng.random::<f64>() < 0.1 {
            0.1 + 0.9 * rng.random::<f64>()
        } else {
            scale
        },
        if rng.random::<f64>() < 0.1 { rng.random() } else { rate },
    ]
}

/// Trial of individual `own`: its genes crossed with the difference vector of three others.
fn trial<const D: usize>(
    rng: &mut impl Rng,
    genes: &[[f64; D]],
    own: usize,
    [scale, rate]: [f64; 2],
    bounds: &Bounds<D>,
) -> [f64; D] {
    let others = three_others(rng, genes.len(), own);
    let [a, b, c] = others.map(|i| &genes[i]);
    let certain = rng.random_range(0..D);
    bounds.clamp(core::array::from_fn(|i| {
        let crosses = rng.random::<f64>() < rate;
        if crosses || i == certain {
            a[i] + scale * (b[i] - c[i])
        } else {
            genes[own][i]
        }
    }))
}

/// Three indices below `count`, different from each other and from `own`.
fn three_others(rng: &mut impl Rng, count: usize, own: usize) -> [usize; 3] {
    let mut taken = [own; 4];
    for k in 1..4 {
        taken[k] = loop {
            let candidate = rng.random_range(0..count);
            if !taken[..k].contains(&candidate) {
                break candidate;
            }
        };
    }
    [taken[1], taken[2], taken[3]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_population_of_four_has_three_others() {
        for generation in 0..100 {
            let mut others = three_others(&mut stream(1, generation, 0), 4, 2);
            others.sort_unstable();
            assert_eq!(others, [0, 1, 3]);
        }
    }
}
