//! Assessed windows of a unit -> counts -> rates.

use ema_models::{FaultId, FaultVector};
use hmd_core::assess::AssessedWindow;
use hmd_core::record::WindowStatus;
use serde::{Deserialize, Serialize};

use super::super::noise::NORMAL_95;
use super::super::percentile;

/// Counts of windows; those of several units add up.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Tally {
    /// Healthy windows.
    pub(super) healthy: u64,
    /// Of these with status `ok` or `degraded`.
    pub(super) judged: u64,
    /// Of all healthy windows those that name a fault.
    pub(super) false_faults: u64,
    /// Windows of both kinds that name a sensor, a wire or a number.
    pub(super) sensor_accused: u64,
    /// Faulty windows.
    pub(super) faulty: u64,
    /// Of these, those that name exactly the true fault.
    pub(super) named: u64,
    /// Of these, those that name a sound part.
    pub(super) wrong: u64,
    /// |Δ| of the damaged element in each judged faulty window.
    pub(super) errors: Vec<f64>,
    /// Judged faulty windows that state a sigma of the damaged element.
    pub(super) stated: u64,
    /// Of these, those whose 95 % interval holds the truth.
    pub(super) covered: u64,
}

/// Rates over windows. All windows of a kind count, also those that are not assessed.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Rates {
    /// Share of the healthy windows with status `ok` or `degraded`.
    pub judged_rate: f64,
    /// Share of the healthy windows that name a fault.
    pub false_fault_rate: f64,
    /// Share of all windows that name a sensor, a wire or a number, of which none is wrong beyond its tolerance.
    pub sensor_accused_rate: f64,
    /// Share of the faulty windows that name exactly the true fault.
    pub named_rate: f64,
    /// Share of the faulty windows that name a sound part, with the worn one or without it.
    pub wrong_rate: f64,
    /// Median of |Δ| of the damaged element over faulty windows with status `ok` or `degraded`; `None` without any.
    pub median_error: Option<f64>,
    /// Share of these windows whose 95 % interval of the damaged element holds the truth, where one is stated.
    pub coverage_95: Option<f64>,
}

impl Tally {
    /// Counts a healthy window; `None` was not cut.
    pub(super) fn add_healthy(&mut self, window: Option<&AssessedWindow>) {
        self.healthy += 1;
        if let Some(window) = window {
            self.judged += u64::from(is_judged(window));
            self.false_faults += u64::from(!window.health.fault_list.is_empty());
            self.sensor_accused += u64::from(!window.suspects.is_empty());
        }
    }

    /// Counts a faulty window whose element at `place` is damaged.
    pub(super) fn add_faulty(&mut self, window: Option<&AssessedWindow>, place: usize, truth: &FaultVector) {
        self.faulty += 1;
        let Some(window) = window else { return };
        self.sensor_accused += u64::from(!window.suspects.is_empty());
        let fault = FaultId::ALL.into_iter().find(|fault| fault.parameter() == place);
        let is_true = |name: &String| fault.is_some_and(|fault| name == fault.name());
        let found = &window.health.fault_list;
        self.named += u64::from(!found.is_empty() && found.iter().all(is_true));
        self.wrong += u64::from(!found.iter().all(is_true));
        let Some(estimate) = window.health.estimate().filter(|_| is_judged(window)) else {
            return;
        };
        let error = (estimate.k[place] - truth.to_array()[place]).abs();
        self.errors.push(error);
        if let Some(sigma) = estimate.sigma[place] {
            self.stated += 1;
            self.covered += u64::from(error <= NORMAL_95 * sigma);
        }
    }

    /// The counts of several units.
    pub(super) fn sum<'a>(tallies: impl Iterator<Item = &'a Self>) -> Self {
        let mut sum = Self::default();
        for tally in tallies {
            sum.healthy += tally.healthy;
            sum.judged += tally.judged;
            sum.false_faults += tally.false_faults;
            sum.sensor_accused += tally.sensor_accused;
            sum.faulty += tally.faulty;
            sum.named += tally.named;
            sum.wrong += tally.wrong;
            sum.errors.extend(&tally.errors);
            sum.stated += tally.stated;
            sum.covered += tally.covered;
        }
        sum
    }

    /// The rates.
    pub(super) fn rates(&self) -> Rates {
        let share = |count: u64, of: u64| count as f64 / of.max(1) as f64;
        Rates {
            judged_rate: share(self.judged, self.healthy),
            false_fault_rate: share(self.false_faults, self.healthy),
            sensor_accused_rate: share(self.sensor_accused, self.healthy + self.faulty),
            named_rate: share(self.named, self.faulty),
            wrong_rate: share(self.wrong, self.faulty),
            median_error: (!self.errors.is_empty()).then(|| percentile(self.errors.iter().copied(), 0.5)),
            coverage_95: (self.stated > 0).then(|| share(self.covered, self.stated)),
        }
    }
}

fn is_judged(window: &AssessedWindow) -> bool {
    let status = WindowStatus::from_name(&window.health.status);
    matches!(status, Some(WindowStatus::Ok | WindowStatus::Degraded))
}
