//! Searches by many individuals at once over the fault vector, and what they minimise. Host only.

use ema_ga::{
    Bounds, CmaConfig, ConfigError, Control, DeConfig, GaConfig, GenerationLog, Objective, Outcome, Parallel, Search,
    cma_es_owned, differential_evolution_owned, evolve_owned,
};
use ema_models::{
    ActuatorParams, COST_LANES, Comparison, FAULT_COUNT, FaultVector, Feedback, RANK_LANES, Unknowns, Weights,
};

use super::least_squares::constant_box;

/// A search by many individuals at once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Population {
    /// The genetic algorithm.
    Genetic(GaConfig),
    /// Differential evolution.
    Differential(DeConfig),
    /// Evolution strategy with covariance matrix adaptation.
    CmaEs(CmaConfig),
}

impl Population {
    /// Monitor runs that one identification may take; `None` without a limit.
    pub(crate) fn budget(&self) -> Option<u64> {
        match self {
            Self::Genetic(config) => config.stop.max_evaluations,
            Self::Differential(config) => config.stop.max_evaluations,
            Self::CmaEs(config) => config.stop.max_evaluations,
        }
    }

    /// Individuals of a generation, and generations after the first.
    pub(crate) fn extent(&self) -> (u64, u32) {
        let (population, stop) = match self {
            Self::Genetic(config) => (config.population, config.stop),
            Self::Differential(config) => (config.population, config.stop),
            Self::CmaEs(config) => (config.population, config.stop),
        };
        (population as u64, stop.max_generations)
    }

    /// The best of all individuals, one of the first being health. `observe` follows each generation and may end the search.
    pub(crate) fn search(
        &self,
        comparison: Comparison<'_>,
        seed: u64,
        observe: impl FnMut(&GenerationLog<FAULT_COUNT>) -> Control,
    ) -> Result<Outcome<FAULT_COUNT>, ConfigError> {
        let objective = LeastSquares {
            comparison,
            bounds: unit_box(),
        };
        self.minimise(&objective, seed, &[FaultVector::NOMINAL.to_array()], observe)
    }

    /// The best individual by the paper's fitness function on the quadrature current alone, by a monitor that simulates its own
    /// feedback; none of the first is known.
    pub(crate) fn search_by_eq14(
        &self,
        comparison: &Comparison<'_>,
        seed: u64,
        observe: impl FnMut(&GenerationLog<FAULT_COUNT>) -> Control,
    ) -> Result<Outcome<FAULT_COUNT>, ConfigError> {
        let alone = Comparison {
            weights: Weights::CURRENT_ONLY,
            feedback: Feedback::Simulated,
            ..*comparison
        };
        self.minimise(&PaperCost::new(alone, comparison.params), seed, &[], observe)
    }

    fn minimise(
        &self,
        objective: &impl Objective<FAULT_COUNT>,
        seed: u64,
        initial: &[[f64; FAULT_COUNT]],
        observe: impl FnMut(&GenerationLog<FAULT_COUNT>) -> Control,
    ) -> Result<Outcome<FAULT_COUNT>, ConfigError> {
        let search = Search {
            objective,
            evaluate: Parallel,
            seed,
            initial,
        };
        match self {
            Self::Genetic(config) => evolve_owned(&search, config, observe),
            Self::Differential(config) => differential_evolution_owned(&search, config, observe),
            Self::CmaEs(config) => cma_es_owned(&search, config, observe),
        }
    }
}

/// [0, 1] in every component of the fault vector.
fn unit_box() -> Bounds<FAULT_COUNT> {
    constant_box([0.0; FAULT_COUNT], [1.0; FAULT_COUNT])
}

/// The unknowns of a batch; lanes that a short last one leaves over run the first individual again.
fn in_lanes<const N: usize>(comparison: &Comparison<'_>, genes: &[[f64; FAULT_COUNT]]) -> [Unknowns; N] {
    let genes_of = |lane: usize| genes.get(lane).or(genes.first()).copied().unwrap_or([0.0; FAULT_COUNT]);
    core::array::from_fn(|lane| comparison.unknowns_with_fault(FaultVector::from_array(genes_of(lane))))
}

struct LeastSquares<'a> {
    comparison: Comparison<'a>,
    bounds: Bounds<FAULT_COUNT>,
}

impl Objective<FAULT_COUNT> for LeastSquares<'_> {
    fn bounds(&self) -> &Bounds<FAULT_COUNT> {
        &self.bounds
    }

    fn cost(&self, genes: &[f64; FAULT_COUNT]) -> f64 {
        let mut cost = [0.0];
        self.cost_batch(&[*genes], &mut cost);
        cost[0]
    }

    fn cost_batch(&self, genes: &[[f64; FAULT_COUNT]], costs: &mut [f64]) {
        let unknowns = in_lanes(&self.comparison, genes);
        for (slot, cost) in costs.iter_mut().zip(self.comparison.rank(&unknowns)) {
            *slot = cost;
        }
    }

    fn batch_size(&self) -> usize {
        RANK_LANES
    }
}

/// The paper's fitness function.
struct PaperCost<'a> {
    comparison: Comparison<'a>,
    bounds: Bounds<FAULT_COUNT>,
    time_scale: f64,
}

impl<'a> PaperCost<'a> {
    /// The derivative is made dimensionless by the electrical time constant over the rated current.
    fn new(comparison: Comparison<'a>, params: &ActuatorParams) -> Self {
        let time_scale = params.motor.l_s / params.motor.r_s / params.motor.i_max;
        Self {
            comparison,
            bounds: unit_box(),
            time_scale,
        }
    }
}

impl Objective<FAULT_COUNT> for PaperCost<'_> {
    fn bounds(&self) -> &Bounds<FAULT_COUNT> {
        &self.bounds
    }

    fn cost(&self, genes: &[f64; FAULT_COUNT]) -> f64 {
        let mut cost = [0.0];
        self.cost_batch(&[*genes], &mut cost);
        cost[0]
    }

    fn cost_batch(&self, genes: &[[f64; FAULT_COUNT]], costs: &mut [f64]) {
        let unknowns = in_lanes(&self.comparison, genes);
        let all = self.comparison.modified_total_least_squares(&unknowns, self.time_scale);
        for (slot, cost) in costs.iter_mut().zip(all) {
            *slot = cost;
        }
    }

    fn batch_size(&self) -> usize {
        COST_LANES
    }
}
