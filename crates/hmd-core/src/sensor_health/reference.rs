//! The reference of one quantity: mean and scatter of the windows of commissioning, else of the first windows that show it.

use ema_identify::unit_calibration::CommissionedQuantity;
use serde::{Deserialize, Serialize};

/// Windows of a reference that is not of commissioning.
const WINDOWS: u32 = 10;

/// Variance of a later window over the sample variance of a reference of n windows: its own scatter and that of the mean, as a scatter
/// known by n − 1 degrees of freedom: `(t / 3)² (1 + 1/n)`, t and 3 the 0.27 % quantiles of Student's and the normal distribution. t by
/// the first terms of its expansion in `1 / (n − 1)`: 4.09 for ten windows, and 3 % too small for five.
fn spread(windows: u32) -> f64 {
    let (z, n) = (3.0_f64, f64::from(windows));
    let inverse = 1.0 / (n - 1.0);
    let terms = [
        z,
        (z.powi(3) + z) / 4.0,
        (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0,
        (3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z) / 384.0,
    ];
    let student = terms.iter().rev().fold(0.0, |sum, term| sum * inverse + term);
    (student / z).powi(2) * (1.0 + 1.0 / n)
}

/// Weighted sums over the windows of a reference.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Reference {
    windows: u32,
    mean: f64,
    /// Sum of the squares of the deviations from the mean.
    squares: f64,
    /// Start of the newest window of the commissioning that it is of, UTC ns.
    #[serde(default)]
    commissioned_ns: Option<i64>,
}

impl Reference {
    pub(super) fn is_possible(&self) -> bool {
        let is_possible = match self.commissioned_ns {
            Some(_) => self.windows >= 2,
            None => self.windows <= WINDOWS,
        };
        is_possible && self.mean.is_finite() && self.squares.is_finite() && self.squares >= 0.0
    }

    /// Whether enough windows were seen.
    pub(super) fn is_complete(&self) -> bool {
        self.commissioned_ns.is_some() || self.windows == WINDOWS
    }

    /// Of a commissioning whose newest window began then.
    pub(super) fn commissioned(quantity: &CommissionedQuantity, until_ns: i64) -> Self {
        Self {
            windows: quantity.windows,
            mean: quantity.mean,
            squares: quantity.scatter.powi(2) * (f64::from(quantity.windows) - 1.0),
            commissioned_ns: Some(until_ns),
        }
    }

    /// The commissioning that it is of; `None` of the first windows.
    pub(super) fn commissioned_ns(&self) -> Option<i64> {
        self.commissioned_ns
    }

    /// Mean and scatter so far, as a calibration keeps them; `None` of fewer windows than `least`.
    pub(super) fn to_commissioned(self, least: u32) -> Option<CommissionedQuantity> {
        (self.windows >= least).then(|| CommissionedQuantity {
            windows: self.windows,
            mean: self.mean,
            scatter: (self.squares / (f64::from(self.windows) - 1.0)).sqrt(),
        })
    }

    /// Adds a value to the reference, or returns its difference from it with a standard deviation.
    pub(super) fn take(&mut self, value: f64, sigma: f64) -> Option<(f64, f64)> {
        if self.is_complete() {
            let variance = sigma * sigma + spread(self.windows) * self.squares / f64::from(self.windows - 1);
            return Some((value - self.mean, variance.sqrt()));
        }
        self.add(value);
        None
    }

    /// Adds a value, by Welford's update.
    pub(super) fn add(&mut self, value: f64) {
        self.windows += 1;
        let before = value - self.mean;
        self.mean += before / f64::from(self.windows);
        self.squares += before * (value - self.mean);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_windows_know_their_scatter_less() {
        // t of 4, 9 and 29 degrees of freedom: 6.62, 4.09, 3.28.
        for (windows, t) in [(5, 6.62_f64), (10, 4.09), (30, 3.28)] {
            let expected = (t / 3.0).powi(2) * (1.0 + 1.0 / f64::from(windows));
            let ratio = spread(windows) / expected;
            assert!((0.93..1.01).contains(&ratio), "{windows}: {ratio}");
        }
    }
}
