//! The genetic algorithm.

use rand::seq::SliceRandom;

use crate::config::{ConfigError, GaConfig, Mutation, Selection};
use crate::log::{Control, GenerationLog};
use crate::operators::{
    INITIAL_STEP, adapt_step, adaptive_feasible_mutation, gaussian_deviation, gaussian_mutation, rank_expectation,
    scattered_crossover, stochastic_uniform, tournament,
};
use crate::problem::{Bounds, Objective};
use crate::search::{Evaluate, Outcome, Search};
use crate::stop::Course;
#[cfg(feature = "std")]
use crate::storage::OwnedStorage;
use crate::storage::Workspace;
use crate::stream::{WHOLE_GENERATION, stream};

/// Minimises by a genetic algorithm.
///
/// 1. The first population is the warm start, filled up with uniform points of the box.
/// 2. The new individuals are evaluated, as far as the budget allows; non-finite costs count as infinite.
/// 3. The line of the generation goes to `observe`, and the stop rule is tested.
/// 4. The mutation step adapts to whether the generation has improved the best cost.
/// 5. The individuals are ranked by cost, the lower index first among equals; parents are selected by rank and shuffled.
/// 6. The elite is copied; crossover and then mutation make the other children, each from its own random stream.
/// 7. The children replace the population; on with 2.
///
/// The elite is not evaluated again. Individuals left over when the budget ends rank last.
///
/// # Errors
///
/// [`ConfigError`] when the settings, the warm start or the size of the workspace do not fit.
pub fn evolve<const D: usize, O: Objective<D>, E: Evaluate>(
    search: &Search<'_, D, O, E>,
    config: &GaConfig,
    workspace: Workspace<'_, D>,
    mut observe: impl FnMut(&GenerationLog<D>) -> Control,
) -> Result<Outcome<D>, ConfigError> {
    config.validate()?;
    search.check_initial(config.population)?;
    let mut space = workspace.fit(config.population, config.stop.history())?;
    let mut course = Course::new(config.stop, core::mem::take(&mut space.best_costs));
    let breeder = Breeder {
        config,
        bounds: search.objective.bounds(),
        seed: search.seed,
    };
    rank_expectation(breeder.parents(), space.expectation);

    search.populate(space.genes);
    let (mut generation, mut kept) = (0, 0);
    let (mut step, mut last_best) = (INITIAL_STEP, f64::INFINITY);
    loop {
        course.spend(search.evaluate(course.budget(), &space.genes[kept..], &mut space.costs[kept..]));

        let line = GenerationLog::new(
            generation,
            course.evaluations(),
            breeder.bounds,
            space.genes,
            space.costs,
        );
        if let Some(stop) = course.end_generation(&line, &mut observe) {
            return Ok(Outcome::new(&line, stop));
        }

        if generation > 0 {
            step = adapt_step(step, line.best_cost < last_best);
        }
        last_best = line.best_cost;

        generation += 1;
        rank(space.costs, space.order);
        breeder.select(generation, &mut space);
        breeder.breed(generation, step, &mut space);

        core::mem::swap(&mut space.genes, &mut space.offspring);
        core::mem::swap(&mut space.costs, &mut space.offspring_costs);
        kept = config.elite_count;
    }
}

/// [`evolve`] with memory of its own.
///
/// # Errors
///
/// [`ConfigError`] when the settings or the warm start do not fit.
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

/// Individuals in ascending order of cost, the lower index first among equals.
fn rank(costs: &[f64], order: &mut [usize]) {
    for (i, individual) in order.iter_mut().enumerate() {
        *individual = i;
    }
    order.sort_unstable_by(|&a, &b| costs[a].total_cmp(&costs[b]).then(a.cmp(&b)));
}

/// Makes the children of a generation from ranked parents.
struct Breeder<'a, const D: usize> {
    config: &'a GaConfig,
    bounds: &'a Bounds<D>,
    seed: u64,
}

impl<const D: usize> Breeder<'_, D> {
    /// Two parents for each child of crossover and one for each mutant.
    fn parents(&self) -> usize {
        self.config.population - self.config.elite_count + self.config.crossover_children()
    }

    fn select(&self, generation: u32, space: &mut Workspace<'_, D>) {
        let rng = &mut stream(self.seed, generation, WHOLE_GENERATION);
        let parents = &mut space.parents.as_flattened_mut()[..self.parents()];
        match self.config.selection {
            Selection::StochasticUniform => stochastic_uniform(rng, space.expectation, parents),
            Selection::Tournament { size } => tournament(rng, self.config.population, size, parents),
        }
        parents.shuffle(rng);
    }

    fn breed(&self, generation: u32, step: f64, space: &mut Workspace<'_, D>) {
        let elite = self.config.elite_count;
        for (slot, &individual) in space.order[..elite].iter().enumerate() {
            space.offspring[slot] = space.genes[individual];
            space.offspring_costs[slot] = space.costs[individual];
        }

        let parent = |rank: usize| &space.genes[space.order[rank]];
        let (pairs, singles) =
            space.parents.as_flattened()[..self.parents()].split_at(2 * self.config.crossover_children());
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
                // The first children, of generation 1, get the full scale.
                let deviation = gaussian_deviation(scale, shrink, generation - 1, self.config.stop.max_generations);
                gaussian_mutation(rng, parent, self.bounds, deviation)
            }
            Mutation::AdaptiveFeasible => adaptive_feasible_mutation(rng, parent, self.bounds, step),
        }
    }
}
