//! What the monitor of an estimate says of a window.

use std::vec::Vec;

use ema_models::{Conditions, Signals};

use super::Identifier;
use crate::estimate::Estimate;
use crate::monitor_fit::residuals_with_tolerances;
use crate::prepared::Prepared;

/// One window's fit, sample by sample, for records and plots.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fit {
    /// Place of each sample of the curves in the window: those that were measured.
    pub samples: Vec<usize>,
    /// Measured quadrature current, A.
    pub i_q_measured: Vec<f32>,
    /// The monitor's, A.
    pub i_q_fitted: Vec<f32>,
    /// Measured motor speed, rad/s.
    pub omega_measured: Vec<f32>,
    /// The monitor's, rad/s.
    pub omega_fitted: Vec<f32>,
    /// Measured output angle relative to the window's first, rad.
    pub theta_out_measured: Vec<f32>,
    /// The monitor's, rad.
    pub theta_out_fitted: Vec<f32>,
}

/// Place and unweighted residuals of each measured sample of a window.
pub type Residuals = Vec<(usize, Signals<f64>)>;

impl Fit {
    /// The fit with these residuals to a window.
    #[must_use]
    pub fn new(window: &Prepared, residuals: &Residuals) -> Self {
        let samples = window.recording().samples;
        let mut fit = Self::default();
        for (n, r) in residuals {
            let sample = &samples[*n];
            fit.samples.push(*n);
            fit.i_q_measured.push(sample.i_q as f32);
            fit.i_q_fitted.push((sample.i_q - r.i_q) as f32);
            fit.omega_measured.push(sample.omega_m as f32);
            fit.omega_fitted.push((sample.omega_m - r.omega_m) as f32);
            fit.theta_out_measured.push(sample.theta_out as f32);
            fit.theta_out_fitted.push((sample.theta_out - r.theta_out) as f32);
        }
        fit
    }
}

impl Identifier {
    /// The residuals of an estimate.
    #[must_use]
    pub fn residuals(&self, window: &Prepared, conditions: Conditions, estimate: &Estimate) -> Residuals {
        let coefficients = self.calibration.coefficients();
        let comparison = self.comparison(window, &coefficients, conditions);
        let mut found = Residuals::new();
        let visit = |n, residuals| found.push((n, residuals));
        if estimate.deviations.is_empty() {
            comparison.residuals(&estimate.unknowns, visit);
        } else {
            residuals_with_tolerances(&comparison, &self.tolerances, estimate, visit);
        }
        found
    }
}
