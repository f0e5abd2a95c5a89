//! Whether a window is explained: the residual of each relation against those of the healthy windows.

#[cfg(feature = "std")]
use std::vec::Vec;

/// A relation between measured signals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Relation {
    /// Torque balance of the motor shaft: currents, resolver.
    TorqueBalance,
    /// Law of the speed loop: set point, angles, currents.
    Controller,
    /// Output angle behind the play: both angle sensors.
    Transmission,
}

/// Number of relations.
pub const RELATION_COUNT: usize = 3;

impl Relation {
    /// All relations in order.
    pub const ALL: [Self; RELATION_COUNT] = [Self::TorqueBalance, Self::Controller, Self::Transmission];
}

/// Root-mean-square residual of a relation in one window, and how many independent rows it comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Residual {
    pub(super) rms: f64,
    pub(super) independent: f64,
}

/// Residuals of the healthy windows: mean and standard deviation of the logarithm of their root-mean-square.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "std", derive(serde::Serialize, serde::Deserialize))]
pub struct HealthyResidual {
    /// Mean logarithm.
    pub mean_log: f64,
    /// Standard deviation from window to window.
    pub scatter: f64,
    /// Windows with this relation.
    pub windows: usize,
}

/// Factor by which the residual of another motion or a damaged unit may be larger. Chosen here: on the units of the suite `robust`, no
/// healthy window exceeds it and what four standard deviations add.
const ALLOWED: f64 = 2.0;

/// Standard deviations of the test.
const TEST_SIGMAS: f64 = 4.0;

impl HealthyResidual {
    /// The residuals of healthy windows.
    #[cfg(feature = "std")]
    pub(super) fn of(residuals: impl Iterator<Item = Residual>) -> Self {
        let logs: Vec<f64> = residuals
            .filter(|residual| residual.rms > 0.0 && residual.rms.is_finite())
            .map(|residual| libm::log(residual.rms))
            .collect();
        let n = logs.len() as f64;
        let mean_log = logs.iter().sum::<f64>() / n.max(1.0);
        let squares: f64 = logs.iter().map(|log| (log - mean_log) * (log - mean_log)).sum();
        Self {
            mean_log,
            scatter: libm::sqrt(squares / (n - 1.0).max(1.0)),
            windows: logs.len(),
        }
    }

    /// The residual relative to that of the healthy windows; 1 where there is none.
    pub(super) fn relative(&self, residual: Residual) -> f64 {
        if self.windows > 0 && residual.rms > 0.0 {
            residual.rms / libm::exp(self.mean_log)
        } else {
            1.0
        }
    }

    /// A residual as a share of the largest that is explained: its logarithm exceeds that of the healthy windows by that of 2 and four
    /// standard deviations, `√(s² + 1/2n)` with their scatter s and n independent rows. Derived here.
    /// What the residual may hold `besides`, as by samples that are further apart than those of the healthy windows, widens the limit.
    pub(super) fn share_of_limit(&self, residual: Residual, besides: f64) -> f64 {
        let variance = self.scatter * self.scatter + 0.5 / residual.independent.max(1.0);
        let limit = ALLOWED * libm::exp(TEST_SIGMAS * libm::sqrt(variance));
        self.relative(residual) / libm::hypot(limit, besides / libm::exp(self.mean_log))
    }
}

#[cfg(all(test, feature = "std"))]
mod tests {
    use super::*;

    #[test]
    fn a_residual_ten_times_the_healthy_ones_is_not_explained() {
        let residual = |rms| Residual { rms, independent: 50.0 };
        let healthy = HealthyResidual::of([0.9, 1.0, 1.1].into_iter().map(residual));
        assert!(healthy.share_of_limit(residual(1.5), 0.0) < 1.0 && healthy.share_of_limit(residual(10.0), 0.0) > 1.0);
        assert!(healthy.share_of_limit(residual(10.0), 12.0) < 1.0);
        assert!(healthy.share_of_limit(Residual::default(), 0.0) < 1.0);
    }
}
