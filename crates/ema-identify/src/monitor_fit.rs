//! Fits the monitor to one window: the unknowns with the least squares of measured minus modelled.
//!
//! 1. `least_squares`: Levenberg–Marquardt descents from each start, coarse differences and then fine ones; each ends in a
//!    local optimum. The host adds a start found by a population search (`population`).
//! 2. `conclusion`: the signals are weighted by the window's own noise, the best optimum is refined once more, and the
//!    other explanations are looked at: `competing_optima`, `weak_magnet`.
//! 3. `uncertainty`: the sigma of each parameter from the curvature of the cost, for friction from `friction_bound` where
//!    the curvature is unreliable, together with the monitor's own mismatch; `locked` says whether the motor moved at all.
//! 4. `tolerance` takes the place of 2 and 3 on the host where the actuator's numbers are known within tolerances only.
//!
//! All of it is generic over [`MonitoredWindow`]; `recorded_window` and `streamed` are the firmware's.

mod coarse_time;
pub use coarse_time::Time;
#[cfg(feature = "std")]
pub(crate) use coarse_time::coarse_in_time;
mod competing_optima;
mod conclusion;
mod friction_bound;
mod least_squares;
mod locked;
#[cfg(feature = "std")]
pub(crate) use locked::is_locked;
#[cfg(feature = "std")]
mod population;
mod recorded_window;
#[cfg(feature = "std")]
mod residuals_at;
mod streamed;
#[cfg(feature = "std")]
mod timed;
#[cfg(feature = "std")]
pub(crate) use timed::{FineResiduals, Timed};
#[cfg(feature = "std")]
mod tolerance;
mod uncertainty;
mod variance;
mod weak_magnet;
mod window;

pub use conclusion::identify_recorded;
#[cfg(feature = "std")]
pub(crate) use conclusion::{Search, conclude};
#[cfg(feature = "std")]
pub(crate) use least_squares::{
    Descent, LocalOptimum, MAX_STARTS, RUNS_OF_DESCENT, RUNS_OF_STEP, Starts, UNLIMITED, best_first, descend_from_each,
    descend_side_by_side, start_by_balance, starts,
};
pub use least_squares::{estimator_bias, refined_from};
#[cfg(feature = "std")]
pub use population::Population;
pub use recorded_window::{MAX_CONTROLS, RecordedWindow, SampleDrive};
pub use streamed::StreamedWindow;
#[cfg(feature = "std")]
pub(crate) use tolerance::{conclude_with_tolerances, residuals_with_tolerances};
pub use uncertainty::cramer_rao_bound;
#[cfg(feature = "std")]
pub(crate) use uncertainty::{Optimum, RUNS_OF_ASSESSMENT, assess};
#[cfg(feature = "std")]
pub(crate) use window::prior;
pub use window::{ActuatorKnowledge, InTime, MonitoredWindow};
