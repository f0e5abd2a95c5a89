//! Damage of one actuator, window by window -> the distribution of its remaining useful life. No clock.
//!
//! [`Prognosis`] keeps a [`Trend`] for each fault: a bank of [`Law`]s of growth, each a Kalman filter whose rate is held
//! fixed, weighed by how well it predicted the estimates. [`Remaining`] is the distribution of the hours until their
//! mixture reaches the end of life. `docs/prognosis.md` gives the equations.

mod estimate;
mod forecast;
mod jump;
mod later_lines;
mod law;
mod prognosis;
mod trend;
mod usage;

pub(crate) use forecast::normal_cdf;
pub use forecast::{Remaining, quantile};
pub use law::{Clock, Law};
pub use prognosis::{Forecast, NoTrend, Prognosis, Quantiles, RemainingLife};
pub use trend::Trend;
pub use usage::{Odometer, Usage, UseRate};
