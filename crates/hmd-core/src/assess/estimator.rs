//! Who estimates the windows of a unit that is not commissioned.

use std::fmt;

use ema_identify::effort::Effort;
use ema_identify::{Estimate, Fit, Identifier};
use ema_models::Conditions;

use super::AssessError;
use crate::outbox::WindowJob;
use crate::outliers::identify_without_outliers;

/// Estimates a window, and shows how well the estimate fits. Identification takes a thousand times as long as all the rest of the
/// program, so a simulation of that rest answers by itself.
pub trait Estimator: fmt::Debug + Send + Sync {
    /// Estimates a window; it may take counts out that stick out. None where that is not granted.
    ///
    /// # Errors
    /// The settings of the search contradict each other.
    fn estimate(
        &self,
        identifier: &Identifier,
        job: &mut WindowJob,
        conditions: Conditions,
        seed: u64,
        effort: &Effort<'_>,
    ) -> Result<Option<(Estimate, Fit)>, AssessError>;
}

/// The identification of this program.
#[derive(Clone, Copy, Debug)]
pub struct Identification;

impl Estimator for Identification {
    fn estimate(
        &self,
        identifier: &Identifier,
        job: &mut WindowJob,
        conditions: Conditions,
        seed: u64,
        effort: &Effort<'_>,
    ) -> Result<Option<(Estimate, Fit)>, AssessError> {
        let found = identify_without_outliers(identifier, &mut job.window, conditions, seed, effort)?;
        Ok(found.map(|(fit, estimate)| (estimate, fit)))
    }
}
