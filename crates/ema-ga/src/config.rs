//! Settings of the genetic algorithm, checked before use. The defaults are those of MATLAB's `ga` for a bounded problem.

use crate::error::ConfigError;
use crate::stop::StopRule;

/// Settings of the genetic algorithm.
///
/// Two choices are fixed: fitness is scaled by rank, `1/sqrt(rank)`, and crossover is scattered. The seed is an argument of
/// the search, not a setting.
///
/// ```
/// use ema_ga::{GaConfig, Mutation, Selection};
///
/// let config = GaConfig::for_dimension(8);
/// assert_eq!((config.population, config.elite_count, config.stop.max_generations), (200, 10, 800));
/// assert_eq!(config.crossover_children(), 152); // round(0.8 * 190); the other 38 are mutants
/// assert_eq!((config.selection, config.mutation), (Selection::StochasticUniform, Mutation::AdaptiveFeasible));
/// assert_eq!(GaConfig::for_dimension(5).population, 50);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaConfig {
    /// Individuals per generation, at least 2.
    pub population: usize,
    /// Number of best individuals copied unchanged into the next generation; at least 1, so that the best cost never rises,
    /// and below `population`.
    pub elite_count: usize,
    /// Share of the other individuals that crossover produces, 0 to 1; mutation produces the rest.
    pub crossover_fraction: f64,
    /// Selection of parents.
    pub selection: Selection,
    /// Mutation of a parent.
    pub mutation: Mutation,
    /// Conditions that end the search.
    pub stop: StopRule,
}

/// Selection of parents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Selection {
    /// Stochastic universal sampling; MATLAB calls it "stochastic uniform".
    StochasticUniform,
    /// The best of `size` individuals drawn with replacement, at least 1.
    Tournament {
        /// Individuals per tournament.
        size: usize,
    },
}

/// Mutation of a parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mutation {
    /// Normal steps in every gene, with a standard deviation that falls linearly over the generations.
    Gaussian {
        /// Standard deviation in the first generation, relative to the width of the box; above 0.
        scale: f64,
        /// Share of `scale` by which the standard deviation has fallen in the last generation, 0 to 1.
        shrink: f64,
    },
    /// Steps in random directions, of one length for all individuals, which adapts to the success of the last generation.
    AdaptiveFeasible,
}

impl GaConfig {
    /// MATLAB's defaults for `dimension` bounded genes.
    #[must_use]
    pub fn for_dimension(dimension: u32) -> Self {
        let population: usize = if dimension <= 5 { 50 } else { 200 };
        Self {
            population,
            elite_count: population.div_ceil(20),
            crossover_fraction: 0.8,
            selection: Selection::StochasticUniform,
            mutation: Mutation::AdaptiveFeasible,
            stop: StopRule::for_dimension(dimension),
        }
    }

    /// Number of children that crossover produces in each generation, `round(crossover_fraction (population - elite_count))`.
    #[must_use]
    pub fn crossover_children(&self) -> usize {
        libm::round(self.crossover_fraction * self.population.saturating_sub(self.elite_count) as f64) as usize
    }

    /// Checks that the algorithm is defined for these settings.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] with the first value out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let population = self.population;
        // Random streams address an individual by 32 bits; the largest index is reserved.
        if !(2..u32::MAX as usize).contains(&population) {
            return Err(ConfigError::Population {
                got: population,
                min: 2,
            });
        }
        if !(1..population).contains(&self.elite_count) {
            return Err(ConfigError::EliteCount {
                got: self.elite_count,
                population,
            });
        }
        if !(0.0..=1.0).contains(&self.crossover_fraction) {
            return Err(ConfigError::CrossoverFraction {
                got: self.crossover_fraction,
            });
        }
        if self.selection == (Selection::Tournament { size: 0 }) {
            return Err(ConfigError::TournamentSize);
        }
        if let Mutation::Gaussian { scale, shrink } = self.mutation
            && !(scale > 0.0 && scale.is_finite() && (0.0..=1.0).contains(&shrink))
        {
            return Err(ConfigError::Gaussian { scale, shrink });
        }
        self.stop.validate()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_names_the_setting_out_of_range() {
        let good = GaConfig::for_dimension(8);
        assert_eq!(good.validate(), Ok(()));
        let stop = good.stop;
        for (bad, expected) in [
            (
                GaConfig { population: 1, ..good },
                ConfigError::Population { got: 1, min: 2 },
            ),
            (
                GaConfig { elite_count: 0, ..good },
                ConfigError::EliteCount {
                    got: 0,
                    population: 200,
                },
            ),
            (
                GaConfig {
                    elite_count: 200,
                    ..good
                },
                ConfigError::EliteCount {
                    got: 200,
                    population: 200,
                },
            ),
            (
                GaConfig {
                    crossover_fraction: 1.1,
                    ..good
                },
                ConfigError::CrossoverFraction { got: 1.1 },
            ),
            (
                GaConfig {
                    selection: Selection::Tournament { size: 0 },
                    ..good
                },
                ConfigError::TournamentSize,
            ),
            (
                GaConfig {
                    mutation: Mutation::Gaussian {
                        scale: 1.0,
                        shrink: 2.0,
                    },
                    ..good
                },
                ConfigError::Gaussian {
                    scale: 1.0,
                    shrink: 2.0,
                },
            ),
            (
                GaConfig {
                    stop: StopRule {
                        max_stall_generations: 0,
                        ..stop
                    },
                    ..good
                },
                ConfigError::StallWindow,
            ),
            (
                GaConfig {
                    stop: StopRule {
                        function_tolerance: -1.0,
                        ..stop
                    },
                    ..good
                },
                ConfigError::FunctionTolerance { got: -1.0 },
            ),
            (
                GaConfig {
                    stop: StopRule {
                        cost_limit: Some(f64::NAN),
                        ..stop
                    },
                    ..good
                },
                ConfigError::CostLimit,
            ),
            (
                GaConfig {
                    stop: StopRule {
                        max_evaluations: Some(0),
                        ..stop
                    },
                    ..good
                },
                ConfigError::NoEvaluations,
            ),
        ] {
            assert_eq!(bad.validate(), Err(expected));
        }
        assert!(
            GaConfig {
                crossover_fraction: f64::NAN,
                ..good
            }
            .validate()
            .is_err()
        );
    }
}
