//! Minimisers of a cost over a box: three population searches and a least-squares refinement.
//!
//! | module | content |
//! |---|---|
//! | [`problem`] | [`Objective`], the cost to minimise, and [`Bounds`], the box |
//! | [`search`] | [`Search`], the input of every population search; serial and parallel evaluation |
//! | [`config`] | [`GaConfig`], operators as enums, the defaults of MATLAB's `ga` |
//! | [`stop`] | [`StopRule`] and [`StopReason`] of the population searches |
//! | [`error`] | [`ConfigError`]: why a search rejects its input |
//! | [`storage`] | [`Workspace`]: memory lent by the caller, fixed arrays or vectors |
//! | [`stream`] | one random stream per (seed, generation, individual) |
//! | [`operators`] | selection, crossover, mutation |
//! | [`evolve`](mod@evolve) | the genetic algorithm |
//! | [`differential_evolution`](mod@differential_evolution) | differential evolution |
//! | [`cma_es`](mod@cma_es) | evolution strategy with covariance matrix adaptation |
//! | [`least_squares`] | bounded Levenberg-Marquardt, for sums of squares near the solution |
//! | [`log`] | one typed line per generation |
//!
//! Genes are `[f64; D]`. The core neither allocates nor uses `std`; feature `std` adds `Parallel` evaluation,
//! `OwnedStorage` and the functions that use it. One seed gives the same result, bit for bit, serially and on any number of
//! threads: a worker only fills its own slots of the cost array and never draws a random number.
//!
//! ```
//! use ema_ga::{Bounds, Control, FixedStorage, GaConfig, Objective, Search, Serial, evolve};
//!
//! struct Sphere(Bounds<2>);
//!
//! impl Objective<2> for Sphere {
//!     fn bounds(&self) -> &Bounds<2> {
//!         &self.0
//!     }
//!     fn cost(&self, genes: &[f64; 2]) -> f64 {
//!         genes[0] * genes[0] + genes[1] * genes[1]
//!     }
//! }
//!
//! let sphere = Sphere(Bounds::new([-1.0, -1.0], [3.0, 3.0])?);
//! let search = Search { objective: &sphere, evaluate: Serial, seed: 1, initial: &[] };
//! let mut storage = FixedStorage::<2, 50, 50>::new();
//! let outcome = evolve(&search, &GaConfig::for_dimension(2), storage.workspace(), |_| Control::Continue)?;
//! assert!(outcome.cost < 1e-3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![no_std]
#![warn(clippy::std_instead_of_core, clippy::alloc_instead_of_core)]

#[cfg(any(feature = "std", test))]
extern crate std;

pub mod cma_es;
pub mod config;
pub mod differential_evolution;
pub mod error;
pub mod evolve;
pub mod least_squares;
pub mod log;
pub mod operators;
pub mod problem;
pub mod search;
pub mod stop;
pub mod storage;
pub mod stream;

#[cfg(feature = "std")]
pub use cma_es::cma_es_owned;
pub use cma_es::{CmaConfig, cma_es};
pub use config::{GaConfig, Mutation, Selection};
#[cfg(feature = "std")]
pub use differential_evolution::differential_evolution_owned;
pub use differential_evolution::{DeConfig, differential_evolution};
pub use error::ConfigError;
pub use evolve::evolve;
#[cfg(feature = "std")]
pub use evolve::evolve_owned;
pub use least_squares::{LmConfig, LmOutcome, LmStop, Residuals, levenberg_marquardt};
pub use log::{Control, GenerationLog};
pub use problem::{Bounds, BoundsError, Objective};
#[cfg(feature = "std")]
pub use search::Parallel;
pub use search::{Evaluate, Outcome, Search, Serial};
pub use stop::{StopReason, StopRule};
#[cfg(feature = "std")]
pub use storage::OwnedStorage;
pub use storage::{FixedStorage, Workspace};
