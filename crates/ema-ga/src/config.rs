//! Settings of the genetic algorithm, checked before use; defaults are those of MATLAB's `ga` for a bounded problem.

use core::fmt;

use crate::stop::StopRule;

/// Settings of the genetic algorithm.
///
/// Two choices are fixed, because nothing here needs another: fitness is scaled by rank, `1/sqrt(rank)`, and crossover
/// is scattered. There is no seed: it is an argument of the search.
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
    /// Best individuals that live on unchanged; at least 1, so that the best cost never rises, and below `population`.
    pub elite_count: usize,
    /// Share of the other individuals that crossover makes, 0 to 1; mutation makes the rest.
    pub crossover_fraction: f64,
    /// How parents are chosen.
    pub selection: Selection,
    /// How mutants are made.
    pub mutation: Mutation,
    /// When to stop.
    pub stop: StopRule,
}

/// How parents are chosen.
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

/// How mutants are made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mutation {
    /// Normal steps in every gene, with a standard deviation that falls linearly over the generations.
    Gaussian {
        /// Standard deviation in the first generation relative to the width of the box, above 0.
        scale: f64,
        /// Share of `scale` that is gone in the last generation, 0 to 1.
        shrink: f64,
    },
    /// Random directions with one step length for all, which follows the success of the last generation.
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

    /// Children by crossover in each generation, `round(crossover_fraction (population - elite_count))`.
    #[must_use]
    pub fn crossover_children(&self) -> usize {
        libm::round(self.crossover_fraction * self.population.saturating_sub(self.elite_count) as f64) as usize
    }

    /// Refuses settings with which the algorithm is not defined.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] naming the first bad value.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let population = self.population;
        // The random streams address individuals by 32 bits, the last one being reserved.
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

/// Why a search was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ConfigError {
    /// Too few or too many individuals.
    Population {
        /// Configured value.
        got: usize,
        /// Smallest possible value.
        min: usize,
    },
    /// Elite not in `1..population`.
    EliteCount {
        /// Configured value.
        got: usize,
        /// Individuals per generation.
        population: usize,
    },
    /// Crossover fraction not in 0 to 1.
    CrossoverFraction {
        /// Configured value.
        got: f64,
    },
    /// Tournament of nobody.
    TournamentSize,
    /// Gaussian mutation with `scale` not above 0 or `shrink` not in 0 to 1.
    Gaussian {
        /// Configured value.
        scale: f64,
        /// Configured value.
        shrink: f64,
    },
    /// First step of CMA-ES not above 0 or not finite.
    Step {
        /// Configured value.
        got: f64,
    },
    /// Stall window of no generation.
    StallWindow,
    /// Function tolerance negative or not finite.
    FunctionTolerance {
        /// Configured value.
        got: f64,
    },
    /// Cost limit is NaN.
    CostLimit,
    /// Evaluation budget of zero.
    NoEvaluations,
    /// More warm-start individuals than the population holds.
    TooManyInitial {
        /// Individuals given.
        got: usize,
        /// Individuals per generation.
        population: usize,
    },
    /// A warm-start individual lies outside the box or is NaN.
    InitialOutside {
        /// Its index.
        individual: usize,
    },
    /// The workspace is too small for the population or for the stall window.
    Storage {
        /// Slots needed.
        expected: usize,
        /// Slots lent.
        got: usize,
    },
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Population { got, min } => write!(f, "population {got}, expected at least {min}"),
            Self::EliteCount { got, population } => write!(f, "elite count {got}, expected 1 to {population} - 1"),
            Self::CrossoverFraction { got } => write!(f, "crossover fraction {got}, expected 0 to 1"),
            Self::TournamentSize => write!(f, "tournament size 0, expected at least 1"),
            Self::Gaussian { scale, shrink } => {
                write!(
                    f,
                    "mutation scale {scale}, shrink {shrink}, expected scale above 0 and shrink 0 to 1"
                )
            }
            Self::Step { got } => write!(f, "first step {got}, expected finite and above 0"),
            Self::StallWindow => write!(f, "stall window 0, expected at least 1 generation"),
            Self::FunctionTolerance { got } => write!(f, "function tolerance {got}, expected finite and not negative"),
            Self::CostLimit => write!(f, "cost limit is NaN"),
            Self::NoEvaluations => write!(f, "evaluation budget 0, expected at least 1"),
            Self::TooManyInitial { got, population } => {
                write!(f, "{got} initial individuals, expected at most {population}")
            }
            Self::InitialOutside { individual } => write!(f, "initial individual {individual} outside the bounds"),
            Self::Storage { expected, got } => write!(f, "workspace holds {got}, expected at least {expected}"),
        }
    }
}

impl core::error::Error for ConfigError {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_out_of_range_is_named() {
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
