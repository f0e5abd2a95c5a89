//! What an estimator says of healthy windows from which it did not learn.

use std::collections::BTreeMap;

use ema_identify::OBSERVABLE_SIGMA;
use ema_identify::unit_calibration::NORMAL_999;
use ema_models::FaultId;

use crate::health::{Levels, significance};

/// Largest damage that there is.
const DAMAGE_MAX: f64 = 1.0;

/// Quantile of the normal distribution, 99 %.
const NORMAL_99: f64 = 2.326_348;

/// Least share of windows that the estimator explains.
const EXPLAINED_MIN: f64 = 0.8;

/// Sigma up to which every fault of a damage of 0.1 is named.
const SIGMA_SMALL: f64 = 0.03;

/// How well an estimator knows a unit.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Evidence {
    /// Sigma of each damage in a healthy window, in the order of [`FaultId::ALL`]; `None` where fewer than half of the windows show it.
    sigma: [Option<f64>; FaultId::COUNT],
    /// Share of the windows that are explained.
    pub(super) explained: f64,
}

impl Evidence {
    /// Of the sigmas of each parameter of the fault vector in each window, and how many windows were explained.
    pub(super) fn new(windows: &[[Option<f64>; ema_models::FAULT_COUNT]], explained: usize) -> Self {
        let sigma = FaultId::ALL.map(|fault| {
            let shown: Vec<f64> = windows.iter().filter_map(|window| window[fault.parameter()]).collect();
            let squares: f64 = shown.iter().map(|sigma| sigma * sigma).sum();
            (!shown.is_empty() && 2 * shown.len() >= windows.len())
                .then(|| fault.damage_per_change() * (squares / shown.len() as f64).sqrt())
        });
        Self {
            sigma,
            explained: explained as f64 / windows.len().max(1) as f64,
        }
    }

    /// Leaves out faults that later windows cannot show either.
    pub(super) fn hide<'a>(&mut self, faults: impl Iterator<Item = &'a FaultId>) {
        for fault in faults {
            self.sigma[fault.index()] = None;
        }
    }

    /// With another standard deviation of a fault's parameter; it is not shown where that alone hides it.
    pub(super) fn widen(&mut self, fault: FaultId, sigma: f64) {
        let other = fault.damage_per_change() * sigma;
        let own = &mut self.sigma[fault.index()];
        *own = own.filter(|_| other <= OBSERVABLE_SIGMA).map(|own| own.hypot(other));
    }

    /// Whether the estimator can assess the unit at all.
    pub(super) fn is_sound(&self) -> bool {
        self.explained >= EXPLAINED_MIN && self.sigma.iter().any(Option::is_some)
    }

    /// Of two estimators where each fault is assessed by the one that shows it better.
    pub(super) fn of_both(&self, other: &Self) -> Self {
        let least = |place: usize| match (self.sigma[place], other.sigma[place]) {
            (Some(own), Some(other)) => Some(own.min(other)),
            (own, other) => own.or(other),
        };
        Self {
            sigma: std::array::from_fn(least),
            explained: self.explained.max(other.explained),
        }
    }

    /// Faults that a window shows.
    pub(super) fn shown(&self) -> usize {
        self.sigma.iter().flatten().count()
    }

    /// Whether a window shows a fault.
    pub(super) fn shows(&self, fault: FaultId) -> bool {
        self.sigma[fault.index()].is_some()
    }

    /// Whether a window shows every fault with a small sigma.
    pub(super) fn shows_all_well(&self) -> bool {
        self.sigma
            .iter()
            .all(|sigma| sigma.is_some_and(|sigma| sigma <= SIGMA_SMALL))
    }

    /// Whether an estimator shows a fault that another one does not, or one that the other shows badly with half the sigma.
    pub(super) fn is_clearly_better_somewhere(&self, other: &Self) -> bool {
        self.pairs(other)
            .any(|(own, other)| other > SIGMA_SMALL && 2.0 * own < other)
    }

    /// Whether an estimator shows a fault badly that another one shows better.
    pub(super) fn is_worse_somewhere(&self, other: &Self) -> bool {
        self.pairs(other).any(|(own, other)| own > SIGMA_SMALL && own > other)
    }

    /// The sigmas of both; infinite where a fault is not shown.
    fn pairs(&self, other: &Self) -> impl Iterator<Item = (f64, f64)> {
        let pair =
            |(own, other): (Option<f64>, Option<f64>)| (own.unwrap_or(f64::INFINITY), other.unwrap_or(f64::INFINITY));
        self.sigma.into_iter().zip(other.sigma).map(pair)
    }

    /// Smallest damage of each fault that a window shows with a probability of 99 %, at a false alarm rate of 0.1 % and by the levels
    /// of the configuration.
    pub(super) fn smallest_damage(&self, levels: &[Levels; FaultId::COUNT]) -> BTreeMap<String, f64> {
        let of = |fault: FaultId| {
            let sigma = self.sigma[fault.index()]?;
            let alarm = levels[fault.index()].watch.max(alarm_sigmas(fault) * sigma);
            let least = round(alarm + NORMAL_99 * sigma);
            (least < DAMAGE_MAX).then(|| (fault.name().to_owned(), least))
        };
        FaultId::ALL.into_iter().filter_map(of).collect()
    }
}

/// Sigmas that count and that chance exceeds with 0.1 % at most: the amplitude of two components with `exp(−x²/2)`.
fn alarm_sigmas(fault: FaultId) -> f64 {
    const AMPLITUDE_999: f64 = 3.717;
    let chance = if fault == FaultId::Eccentricity {
        AMPLITUDE_999
    } else {
        NORMAL_999
    };
    chance.max(significance(fault))
}

/// To three decimals, upwards.
fn round(damage: f64) -> f64 {
    (1000.0 * damage).ceil() / 1000.0
}
