//! A window of a unit whose numbers are known within tolerances only: faults and nuisances fitted together. Host only.
//!
//! 1. `nuisance` lists what the tolerances leave open, `basis` what each nuisance does to torque and signals.
//! 2. `problem` is the least-squares problem of the window's unknowns and of the nuisances, the tolerances as prior. Its solution
//!    is that of generalised least squares with the covariance R + S Σ Sᵀ of the residual, S being the sensitivities to the
//!    nuisances and Σ the squared tolerances: what a tolerance explains as well as a fault does widens the fault's sigma.
//! 3. `derivatives` are those of its residuals, by monitors side by side; `linearised` makes information and gradient of them and the residuals
//!    of a point.
//! 4. `conclusion` solves it from the best optimum of the search, and says how uncertain the result is. `on_descent` is the problem as a
//!    descent sees it, with derivatives that stay while they foretell the costs.
//! 5. `inferred` says what the window shows of its readings.

mod basis;
mod conclusion;
mod derivatives;
mod inferred;
mod linearised;
mod nuisance;
mod on_descent;
mod problem;
#[cfg(test)]
mod tests;

pub(crate) use conclusion::{conclude_with_tolerances, residuals_with_tolerances};
