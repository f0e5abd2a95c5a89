//! Memory of a population search. The caller lends it, so the core does not allocate.

use crate::error::ConfigError;

/// Borrowed memory for one search; its previous content does not matter.
#[derive(Debug)]
pub struct Workspace<'a, const D: usize> {
    pub(crate) genes: &'a mut [[f64; D]],
    pub(crate) costs: &'a mut [f64],
    pub(crate) offspring: &'a mut [[f64; D]],
    pub(crate) offspring_costs: &'a mut [f64],
    /// Individuals in order of rank (genetic algorithm and CMA-ES).
    pub(crate) order: &'a mut [usize],
    /// Expected number of children by rank (genetic algorithm).
    pub(crate) expectation: &'a mut [f64],
    /// Two parents for each child (genetic algorithm).
    pub(crate) parents: &'a mut [[usize; 2]],
    /// Scale and crossover rate of each individual and of its trial (differential evolution).
    pub(crate) controls: &'a mut [[[f64; 2]; 2]],
    /// Best costs of the last `StopRule::history` generations.
    pub(crate) best_costs: &'a mut [f64],
}

impl<'a, const D: usize> Workspace<'a, D> {
    /// Limits the memory to this population and history; an error when it is too small.
    pub(crate) fn limited_to(self, population: usize, history: u32) -> Result<Self, ConfigError> {
        let history = history as usize;
        for (got, expected) in [(self.genes.len(), population), (self.best_costs.len(), history)] {
            if got < expected {
                return Err(ConfigError::Storage { expected, got });
            }
        }
        Ok(Self {
            genes: &mut self.genes[..population],
            costs: &mut self.costs[..population],
            offspring: &mut self.offspring[..population],
            offspring_costs: &mut self.offspring_costs[..population],
            order: &mut self.order[..population],
            expectation: &mut self.expectation[..population],
            parents: &mut self.parents[..population],
            controls: &mut self.controls[..population],
            best_costs: &mut self.best_costs[..history],
        })
    }
}

/// Memory for up to `N` individuals and a [`StopRule::history`](crate::StopRule::history) of up to `W`, without
/// allocation.
#[derive(Clone, Debug)]
pub struct FixedStorage<const D: usize, const N: usize, const W: usize> {
    genes: [[[f64; D]; N]; 2],
    costs: [[f64; N]; 2],
    order: [usize; N],
    expectation: [f64; N],
    parents: [[usize; 2]; N],
    controls: [[[f64; 2]; 2]; N],
    best_costs: [f64; W],
}

impl<const D: usize, const N: usize, const W: usize> FixedStorage<D, N, W> {
    /// Zeroed memory; `const`, so that it can be a `static`.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            genes: [[[0.0; D]; N]; 2],
            costs: [[0.0; N]; 2],
            order: [0; N],
            expectation: [0.0; N],
            parents: [[0; 2]; N],
            controls: [[[0.0; 2]; 2]; N],
            best_costs: [0.0; W],
        }
    }

    /// Lends the memory to one search.
    pub fn workspace(&mut self) -> Workspace<'_, D> {
        let [genes, offspring] = &mut self.genes;
        let [costs, offspring_costs] = &mut self.costs;
        Workspace {
            genes,
            costs,
            offspring,
            offspring_costs,
            order: &mut self.order,
            expectation: &mut self.expectation,
            parents: &mut self.parents,
            controls: &mut self.controls,
            best_costs: &mut self.best_costs,
        }
    }
}

impl<const D: usize, const N: usize, const W: usize> Default for FixedStorage<D, N, W> {
    fn default() -> Self {
        Self::new()
    }
}

/// Memory on the heap, for a population known only at run time. Several searches may use it one after the other.
#[cfg(feature = "std")]
#[derive(Clone, Debug)]
pub struct OwnedStorage<const D: usize> {
    genes: [std::vec::Vec<[f64; D]>; 2],
    costs: [std::vec::Vec<f64>; 2],
    order: std::vec::Vec<usize>,
    expectation: std::vec::Vec<f64>,
    parents: std::vec::Vec<[usize; 2]>,
    controls: std::vec::Vec<[[f64; 2]; 2]>,
    best_costs: std::vec::Vec<f64>,
}

#[cfg(feature = "std")]
impl<const D: usize> OwnedStorage<D> {
    /// Memory for `population` individuals and a [`StopRule::history`](crate::StopRule::history) of `history`.
    #[must_use]
    pub fn new(population: usize, history: u32) -> Self {
        use std::vec;
        Self {
            genes: [vec![[0.0; D]; population], vec![[0.0; D]; population]],
            costs: [vec![0.0; population], vec![0.0; population]],
            order: vec![0; population],
            expectation: vec![0.0; population],
            parents: vec![[0; 2]; population],
            controls: vec![[[0.0; 2]; 2]; population],
            best_costs: vec![0.0; history as usize],
        }
    }

    /// Lends the memory to one search.
    pub fn workspace(&mut self) -> Workspace<'_, D> {
        let [genes, offspring] = &mut self.genes;
        let [costs, offspring_costs] = &mut self.costs;
        Workspace {
            genes,
            costs,
            offspring,
            offspring_costs,
            order: &mut self.order,
            expectation: &mut self.expectation,
            parents: &mut self.parents,
            controls: &mut self.controls,
            best_costs: &mut self.best_costs,
        }
    }
}
