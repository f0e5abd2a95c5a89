//! The reference of one quantity: mean and scatter of the first windows that show it.

use serde::{Deserialize, Serialize};

/// Windows of a reference.
const WINDOWS: u32 = 10;

/// Variance of a later window over the sample variance of the reference: its own scatter and that of the mean, as a scatter known by
/// nine degrees of freedom: `t² (1 + 1/n)` with t = 4.09 / 3, the ratio of the 0.27 % quantiles of Student's and the normal distribution.
const SPREAD: f64 = 1.859 * 1.1;

/// Weighted sums over the windows of a reference.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Reference {
    windows: u32,
    mean: f64,
    /// Sum of the squares of the deviations from the mean.
    squares: f64,
}

impl Reference {
    pub(super) fn is_possible(&self) -> bool {
        self.windows <= WINDOWS && self.mean.is_finite() && self.squares.is_finite() && self.squares >= 0.0
    }

    /// Whether enough windows were seen.
    pub(super) fn is_complete(&self) -> bool {
        self.windows == WINDOWS
    }

    /// Adds a value to the reference, or returns its difference from it with a standard deviation.
    pub(super) fn take(&mut self, value: f64, sigma: f64) -> Option<(f64, f64)> {
        if self.is_complete() {
            let variance = sigma * sigma + SPREAD * self.squares / f64::from(WINDOWS - 1);
            return Some((value - self.mean, variance.sqrt()));
        }
        // Welford's update.
        self.windows += 1;
        let before = value - self.mean;
        self.mean += before / f64::from(self.windows);
        self.squares += before * (value - self.mean);
        None
    }
}
