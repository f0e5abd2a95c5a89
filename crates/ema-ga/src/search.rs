//! Input and output of a population search: problem, seed, warm start and evaluation; best individual and stop reason.

use crate::error::ConfigError;
use crate::log::GenerationLog;
use crate::operators::uniform_point;
use crate::problem::Objective;
use crate::stop::StopReason;
use crate::stream::stream;

/// Input of one search.
#[derive(Clone, Copy, Debug)]
pub struct Search<'a, const D: usize, O, E> {
    /// The cost to minimise and its bounds.
    pub objective: &'a O,
    /// Evaluation of costs: [`Serial`], or `Parallel` with feature `std`. Both give the same result.
    pub evaluate: E,
    /// Seed of all random streams. It has no default, so that every caller chooses reproducibility explicitly.
    pub seed: u64,
    /// Individuals of the first population (warm start); the others are drawn uniformly.
    pub initial: &'a [[f64; D]],
}

/// Result of one search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome<const D: usize> {
    /// Best individual.
    pub genes: [f64; D],
    /// Its cost; infinite when no evaluated individual had a finite cost.
    pub cost: f64,
    /// Number of the last generation; 0 is the initial population.
    pub generations: u32,
    /// Costs computed in total.
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

/// Computation of the costs of many individuals, in any order.
pub trait Evaluate {
    /// Writes the cost of `genes[i]` to `costs[i]`, in batches of the objective's size.
    fn evaluate<const D: usize, O: Objective<D>>(&self, objective: &O, genes: &[[f64; D]], costs: &mut [f64]);
}

/// Evaluates one batch after the other on the calling thread.
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

/// Distributes batches over the current rayon pool; `ThreadPool::install` selects another pool.
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
    /// Checks that the warm start lies in the box and fits into the population.
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

    /// Writes the first population: the warm start, completed with uniform points of the box.
    pub(crate) fn populate(&self, genes: &mut [[f64; D]]) {
        for (i, individual) in (0u32..).zip(genes) {
            *individual = match self.initial.get(i as usize) {
                Some(known) => *known,
                None => uniform_point(&mut stream(self.seed, 0, i), self.objective.bounds()),
            };
        }
    }

    /// Evaluates as many of the first individuals as the budget allows and returns their number.
    ///
    /// Non-finite costs become `+inf`, as do the costs of individuals beyond the budget: both rank last.
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
