//! What every population search shares: the problem, the seed, the warm start and the way costs are evaluated.

use crate::config::ConfigError;
use crate::log::GenerationLog;
use crate::operators::uniform;
use crate::problem::Objective;
use crate::stop::StopReason;
use crate::stream::stream;

/// One search, said by name: what is minimised, how it is evaluated, from which seed and from which known individuals.
#[derive(Clone, Copy, Debug)]
pub struct Search<'a, const D: usize, O, E> {
    /// What is minimised.
    pub objective: &'a O,
    /// How costs are computed: [`Serial`], or `Parallel` with feature `std`. It does not change the result.
    pub evaluate: E,
    /// Seed of all randomness. There is no default: a result that matters must be repeatable by intent.
    pub seed: u64,
    /// Individuals put into the first population as they are (warm start); the others are drawn uniformly.
    pub initial: &'a [[f64; D]],
}

/// What a search found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome<const D: usize> {
    /// Best individual.
    pub genes: [f64; D],
    /// Its cost; infinite when no evaluated individual had a finite cost.
    pub cost: f64,
    /// Last generation, 0 being the initial population.
    pub generations: u32,
    /// Costs computed.
    pub evaluations: u64,
    /// Why the search ended.
    pub stop: StopReason,
}

impl<const D: usize> Outcome<D> {
    pub(crate) fn new(last: &GenerationLog<D>, stop: StopReason) -> Self {
        Self {
            genes: last.best_genes,
            cost: last.best_cost,
            generations: last.generation,
            evaluations: last.evaluations,
            stop,
        }
    }
}

/// Computes costs of many individuals, in whatever order, each into the slot of its own index.
pub trait Evaluate {
    /// Fills `costs[i]` with the cost of `genes[i]`, in batches of the objective's size.
    fn evaluate<const D: usize, O: Objective<D>>(&self, objective: &O, genes: &[[f64; D]], costs: &mut [f64]);
}

/// One batch after the other, on the calling thread.
#[derive(Clone, Copy, Debug)]
pub struct Serial;

impl Evaluate for Serial {
    fn evaluate<const D: usize, O: Objective<D>>(&self, objective: &O, genes: &[[f64; D]], costs: &mut [f64]) {
        let batch = objective.batch_size().max(1);
        for (genes, costs) in genes.chunks(batch).zip(costs.chunks_mut(batch)) {
            objective.cost_batch(genes, costs);
        }
    }
}

/// Batches spread over the current rayon pool; choose another with `ThreadPool::install`.
#[cfg(feature = "std")]
#[derive(Clone, Copy, Debug)]
pub struct Parallel;

#[cfg(feature = "std")]
impl Evaluate for Parallel {
    fn evaluate<const D: usize, O: Objective<D>>(&self, objective: &O, genes: &[[f64; D]], costs: &mut [f64]) {
        use rayon::prelude::*;
        let batch = objective.batch_size().max(1);
        genes
            .par_chunks(batch)
            .zip(costs.par_chunks_mut(batch))
            .for_each(|(genes, costs)| objective.cost_batch(genes, costs));
    }
}

impl<const D: usize, O: Objective<D>, E: Evaluate> Search<'_, D, O, E> {
    /// Refuses a warm start that leaves the box or does not fit into the population.
    pub(crate) fn check_initial(&self, population: usize) -> Result<(), ConfigError> {
        if self.initial.len() > population {
            return Err(ConfigError::TooManyInitial {
                got: self.initial.len(),
                population,
            });
        }
        let outside = |genes: &[f64; D]| !self.objective.bounds().contains(genes);
        match self.initial.iter().position(outside) {
            Some(individual) => Err(ConfigError::InitialOutside { individual }),
            None => Ok(()),
        }
    }

    /// The first population: the warm start, filled up with uniform points of the box.
    pub(crate) fn populate(&self, genes: &mut [[f64; D]]) {
        for (i, individual) in (0u32..).zip(genes) {
            *individual = match self.initial.get(i as usize) {
                Some(known) => *known,
                None => uniform(&mut stream(self.seed, 0, i), self.objective.bounds()),
            };
        }
    }

    /// Evaluates the first individuals that the budget still allows and returns how many.
    ///
    /// Non-finite costs become `+inf`, as do the costs of individuals that were not evaluated: both rank last.
    pub(crate) fn evaluate(&self, budget: u64, genes: &[[f64; D]], costs: &mut [f64]) -> usize {
        let count = usize::try_from(budget).unwrap_or(usize::MAX).min(genes.len());
        self.evaluate
            .evaluate(self.objective, &genes[..count], &mut costs[..count]);
        costs[count..].fill(f64::INFINITY);
        for cost in &mut costs[..count] {
            if !cost.is_finite() {
                *cost = f64::INFINITY;
            }
        }
        count
    }
}
