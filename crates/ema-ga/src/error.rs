//! Why a population search rejects its settings, its warm start or its memory.

use core::fmt;

/// Why a population search rejects its settings, its warm start or its memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ConfigError {
    /// The population is too small, or does not fit into 32 bits.
    Population {
        /// Configured value.
        got: usize,
        /// Smallest possible value.
        min: usize,
    },
    /// The elite count is not in `1..population`.
    EliteCount {
        /// Configured value.
        got: usize,
        /// Individuals per generation.
        population: usize,
    },
    /// The crossover fraction is not in 0 to 1.
    CrossoverFraction {
        /// Configured value.
        got: f64,
    },
    /// The tournament size is 0.
    TournamentSize,
    /// The Gaussian mutation has a `scale` that is not above 0, or a `shrink` that is not in 0 to 1.
    Gaussian {
        /// Configured value.
        scale: f64,
        /// Configured value.
        shrink: f64,
    },
    /// The first step of CMA-ES is not above 0 or not finite.
    Step {
        /// Configured value.
        got: f64,
    },
    /// The stall window has no generation.
    StallWindow,
    /// The function tolerance is negative or not finite.
    FunctionTolerance {
        /// Configured value.
        got: f64,
    },
    /// The cost limit is NaN.
    CostLimit,
    /// The evaluation budget is zero.
    NoEvaluations,
    /// There are more warm-start individuals than the population holds.
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
