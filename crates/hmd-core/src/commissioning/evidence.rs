//! What an estimator says of healthy windows from which it did not learn.

use std::collections::BTreeMap;

use ema_identify::unit_calibration::NORMAL_999;
use ema_models::FaultId;

use crate::health::{Levels, SIGNIFICANCE};

/// Quantile of the normal distribution, 99 %.
const NORMAL_99: f64 = 2.326_348;

/// Least share of windows that the estimator explains.
const EXPLAINED_MIN: f64 = 0.8;

/// Sigma up to which every fault of a damage of 0.1 is named.
const SIGMA_SMALL: f64 = 0.03;

/// How well an estimator knows a unit.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Evidence {
    /// Sigma of each parameter of the fault vector in a healthy window; `None` where most windows do not show it.
    pub(super) sigma: [Option<f64>; ema_models::FAULT_COUNT],
    /// Share of the windows that are explained.
    pub(super) explained: f64,
}

impl Evidence {
    /// Of the sigmas of each window, and how many windows were explained.
    pub(super) fn new(windows: &[[Option<f64>; ema_models::FAULT_COUNT]], explained: usize) -> Self {
        let sigma = std::array::from_fn(|parameter| {
            let shown: Vec<f64> = windows.iter().filter_map(|window| window[parameter]).collect();
            let squares: f64 = shown.iter().map(|sigma| sigma * sigma).sum();
            (2 * shown.len() > windows.len()).then(|| (squares / shown.len() as f64).sqrt())
        });
        Self {
            sigma,
            explained: explained as f64 / windows.len().max(1) as f64,
        }
    }

    /// Whether the estimator can assess the unit at all.
    pub(super) fn is_sound(&self) -> bool {
        self.explained >= EXPLAINED_MIN && self.sigma.iter().any(Option::is_some)
    }

    /// Faults that a window shows.
    pub(super) fn shown(&self) -> usize {
        FaultId::ALL
            .into_iter()
            .filter(|fault| self.sigma[fault.parameter()].is_some())
            .count()
    }

    /// Whether a window shows every fault with a small sigma.
    pub(super) fn shows_all_well(&self) -> bool {
        FaultId::ALL
            .into_iter()
            .all(|fault| self.sigma[fault.parameter()].is_some_and(|sigma| sigma <= SIGMA_SMALL))
    }

    /// Whether an estimator serves clearly better than another one: it shows a fault that the other does not, or one that the other
    /// shows badly with half the sigma, and none badly that the other shows well.
    pub(super) fn is_clearly_better_than(&self, other: &Self) -> bool {
        let sigmas = |fault: FaultId| {
            let of = |evidence: &Self| evidence.sigma[fault.parameter()].unwrap_or(f64::INFINITY);
            (of(self), of(other))
        };
        let is_better = |(own, other): (f64, f64)| other > SIGMA_SMALL && 2.0 * own < other;
        let is_worse = |(own, other): (f64, f64)| own > SIGMA_SMALL && own > other;
        let faults = || FaultId::ALL.into_iter().map(sigmas);
        faults().any(is_better) && !faults().any(is_worse)
    }

    /// Smallest damage of each fault that a window shows with a probability of 99 %, at a false alarm rate of 0.1 % and by the levels
    /// of the configuration.
    pub(super) fn smallest_damage(&self, levels: &[Levels; FaultId::COUNT]) -> BTreeMap<String, f64> {
        let of = |fault: FaultId| {
            let parameter = fault.parameter();
            // The gain's damage is 2 |k8 − ½|.
            let per_parameter = if fault == FaultId::Gain { 2.0 } else { 1.0 };
            let sigma = per_parameter * self.sigma[parameter]?;
            let alarm = levels[fault.index()].watch.max(NORMAL_999.max(SIGNIFICANCE) * sigma);
            Some((fault.name().to_owned(), round(alarm + NORMAL_99 * sigma)))
        };
        FaultId::ALL.into_iter().filter_map(of).collect()
    }
}

/// To three decimals, upwards.
fn round(damage: f64) -> f64 {
    (1000.0 * damage).ceil() / 1000.0
}
