//! The search of a configuration.

use ema_ga::{CmaConfig, DeConfig, GaConfig, StopRule};
use ema_identify::{Method, Population};
use ema_models::FAULT_COUNT;

use crate::config::{IdentificationConfig, SearchMethod, SearchObjective};

/// The search that a configuration asks for.
#[must_use]
pub fn method(section: &IdentificationConfig) -> Method {
    let dimension = FAULT_COUNT as u32;
    let population = section.population as usize;
    let mut stop = StopRule::for_dimension(dimension);
    stop.max_generations = section.generations;
    stop.max_evaluations = Some(u64::from(section.evaluations_max));
    let genetic = Population::Genetic(GaConfig {
        population,
        elite_count: population.div_ceil(20),
        stop,
        ..GaConfig::for_dimension(dimension)
    });
    let population = match section.method {
        SearchMethod::Hybrid => return Method::Hybrid(genetic),
        // Where the relations are not asked (commissioning, doubtful readings), the monitor needs no population either.
        SearchMethod::LeastSquares | SearchMethod::Relations => return Method::LeastSquares,
        SearchMethod::Ga => genetic,
        SearchMethod::De => Population::Differential(DeConfig { population, stop }),
        SearchMethod::Cmaes => Population::CmaEs(CmaConfig {
            population,
            stop,
            ..CmaConfig::for_dimension(dimension)
        }),
    };
    match section.objective {
        SearchObjective::Residual => Method::Population(population),
        SearchObjective::Eq14 => Method::Eq14(population),
    }
}
