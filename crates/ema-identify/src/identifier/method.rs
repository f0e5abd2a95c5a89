//! How the fault vector is searched.

use ema_ga::GaConfig;
use ema_models::FAULT_COUNT;

use crate::monitor_fit::Population;

/// How the fault vector is searched. `docs/search.md` compares them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// A population search on the paper's cost (eq. 14), quadrature current only; the paper's own is the genetic algorithm.
    Eq14(Population),
    /// A population search over all signals.
    Population(Population),
    /// Levenberg–Marquardt from health alone, over all signals.
    LeastSquares,
    /// A short population search, then Levenberg–Marquardt from its best and from health.
    Hybrid(Population),
}

impl Method {
    /// The default search: a genetic algorithm of 32 individuals and 5 generations, then refinement.
    #[must_use]
    pub fn hybrid() -> Self {
        let mut config = GaConfig::for_dimension(FAULT_COUNT as u32);
        config.population = 32;
        config.elite_count = 2;
        config.stop.max_generations = 5;
        Self::Hybrid(Population::Genetic(config))
    }

    /// The paper's search with the toolbox's defaults for eight bounded genes.
    #[must_use]
    pub fn paper_ga() -> Self {
        Self::Eq14(Population::Genetic(GaConfig::for_dimension(FAULT_COUNT as u32)))
    }
}
