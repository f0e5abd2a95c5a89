//! The genetic algorithm: from a [`Search`] and a [`GaConfig`] to an [`Outcome`].

use rand::seq::SliceRandom;

use crate::config::{GaConfig, Mutation, Selection};
use crate::error::ConfigError;
use crate::log::{Control, GenerationLog};
use crate::operators::{
    INITIAL_STEP, adapt_step, adaptive_feasible_mutation, gaussian_deviation, gaussian_mutation, rank_expectation,
    scattered_crossover, stochastic_uniform, tournament,
};
use crate::problem::{Bounds, Objective};
use crate::search::{Evaluate, Outcome, Search};
use crate::stop::Progress;
#[cfg(feature = "std")]
use crate::storage::OwnedStorage;
use crate::storage::Workspace;
use crate::stream::{WHOLE_GENERATION, stream};

/// Minimises by a genetic algorithm.
///
/// 1. The first population is the warm start, completed with uniform points of the box.
/// 2. The new individuals are evaluated, as far as the budget allows; non-finite costs count as infinite.
/// 3. `observe` receives the line of the generation, and the stop rule is tested.
/// 4. The mutation step adapts to whether the generation has improved the best cost.
/// 5. The individuals are ranked by cost, equal costs by index. Parents are selected by rank and shuffled.
/// 6. The elite is copied. Crossover and then mutation produce the other children, each with its own random stream.
/// 7. The children replace the population. Continue with 2.
///
/// The elite is not evaluated again. Individuals beyond the evaluation budget rank last.
///
/// # Errors
///
/// [`ConfigError`] when a setting is out of range, the warm start lies outside the box or exceeds the population, or the
/// workspace is too small.
pub fn evolve<const D: usize, O: Objective<D>, E: Evaluate>(
    search: &Search<'_, D, O, E>,
    config: &GaConfig,
    workspace: Workspace<'_, D>,
    mut observe: impl FnMut(&GenerationLog<D>) -> Control,
) -> Result<Outcome<D>, ConfigError> {
    config.validate()?;
    search.check_initial(config.population)?;
    let mut space = workspace.limited_to(config.population, config.stop.history())?;
    let mut progress = Progress::new(config.stop, core::mem::take(&mut space.best_costs));
    let breeder = Breeder {
        config,
        bounds: search.objective.bounds(),
        seed: search.seed,
    };
    rank_expectation(breeder.parent_count(), space.expectation);

    search.populate(space.genes);
    let (mut generation, mut kept) = (0, 0);
    let (mut step, mut last_best) = (INITIAL_STEP, f64::INFINITY);
    loop {
        progress.count_evaluations(search.evaluate(
            progress.remaining_budget(),
            &space.genes[kept..],
            &mut space.costs[kept..],
        ));

        let line = GenerationLog::new(
            generation,
            progress.evaluations(),
            breeder.bounds,
            space.genes,
            space.costs,
        );
        if let Some(stop) = progress.end_generation(&line, &mut observe) {
            return Ok(Outcome::new(&line, stop));
        }

        if generation > 0 {
            step = adapt_step(step, line.best_cost < last_best);
        }
        last_best = line.best_cost;

        generation += 1;
        rank_by_cost(space.costs, space.order);
        breeder.select_parents(generation, &mut space);
        breeder.breed(generation, step, &mut space);

        core::mem::swap(&mut space.genes, &mut space.offspring);
        core::mem::swap(&mut space.costs, &mut space.offspring_costs);
        kept = config.elite_count;
    }
}

/// [`evolve`] with memory allocated for this search.
///
/// # Errors
///
/// [`ConfigError`] when a setting is out of range, or the warm start lies outside the box or exceeds the population.
#[cfg(feature = "std")]
pub fn evolve_owned<const D: usize, O: Objective<D>, E: Evaluate>(
    search: &Search<'_, D, O, E>,
    config: &GaConfig,
    observe: impl FnMut(&GenerationLog<D>) -> Control,
) -> Result<Outcome<D>, ConfigError> {
    config.validate()?;
    let mut storage = OwnedStorage::new(config.population, config.stop.history());
    evolve(search, config, storage.workspace(), observe)
}

/// Writes the indices of the individuals in ascending order of cost, equal costs by index.
fn rank_by_cost(costs: &[f64], order: &mut [usize]) {
    for (i, individual) in order.iter_mut().enumerate() {
        *individual = i;
    }
    order.sort_unstable_by(|&a, &b| costs[a].total_cmp(&costs[b]).then(a.cmp(&b)));
}

/// Produces the children of a generation from ranked parents.
struct Breeder<'a, const D: usize> {
    config: &'a GaConfig,
    bounds: &'a Bounds<D>,
    seed: u64,
}

impl<const D: usize> Breeder<'_, D> {
    /// Number of parents of a generation: two for each child of crossover and one for each mutant.
    fn parent_count(&self) -> usize {
        self.config.population - self.config.elite_count + self.config.crossover_children()
    }

    /// Selects the parents of a generation by rank, in random order.
    fn select_parents(&self, generation: u32, space: &mut Workspace<'_, D>) {
        let rng = &mut stream(self.seed, generation, WHOLE_GENERATION);
        let parents = &mut space.parents.as_flattened_mut()[..self.parent_count()];
        match self.config.selection {
            Selection::StochasticUniform => stochastic_uniform(rng, space.expectation, parents),
            Selection::Tournament { size } => tournament(rng, self.config.population, size, parents),
        }
        parents.shuffle(rng);
    }

    /// Writes elite, children of crossover and mutants, in this order, to the offspring.
    fn breed(&self, generation: u32, step: f64, space: &mut Workspace<'_, D>) {
        let elite = self.config.elite_count;
        for (slot, &individual) in space.order[..elite].iter().enumerate() {
            space.offspring[slot] = space.genes[individual];
            space.offspring_costs[slot] = space.costs[individual];
        }

        let parent = |rank: usize| &space.genes[space.order[rank]];
        let (pairs, singles) =
            space.parents.as_flattened()[..self.parent_count()].split_at(2 * self.config.crossover_children());
        let (crossed, mutants) = space.offspring[elite..].split_at_mut(self.config.crossover_children());
        let mut individual = elite as u32..;
        let mut own_stream = || stream(self.seed, generation, individual.next().unwrap_or(WHOLE_GENERATION));
        for (child, pair) in crossed.iter_mut().zip(pairs.chunks_exact(2)) {
            *child = scattered_crossover(&mut own_stream(), parent(pair[0]), parent(pair[1]));
        }
        for (child, &rank) in mutants.iter_mut().zip(singles) {
            *child = self.mutate(&mut own_stream(), generation, step, parent(rank));
        }
    }

    fn mutate(&self, rng: &mut impl rand::Rng, generation: u32, step: f64, parent: &[f64; D]) -> [f64; D] {
        match self.config.mutation {
            Mutation::Gaussian { scale, shrink } => {
                // Generation 1 has the first children, which get the full scale.
                let deviation = gaussian_deviation(scale, shrink, generation - 1, self.config.stop.max_generations);
                gaussian_mutation(rng, parent, self.bounds, deviation)
            }
            Mutation::AdaptiveFeasible => adaptive_feasible_mutation(rng, parent, self.bounds, step),
        }
    }
}
