//! What the healthy windows of a unit show of one number, and a later reading of it with the uncertainty of the unit.

use super::elements::{Needed, Reading};

/// What healthy windows show of one element.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "std", derive(serde::Serialize, serde::Deserialize))]
pub struct Baseline {
    /// Mean over the windows, each weighted by its own information, in the element's unit.
    pub mean: f64,
    /// Standard deviation from window to window, so weighted.
    pub scatter: f64,
    /// Sigma of a window of mean information.
    pub sigma: f64,
    /// Largest sigma of a window; 0 in unit files that have none.
    #[cfg_attr(feature = "std", serde(default))]
    pub sigma_largest: f64,
    /// Root-mean-square of deviation over sigma; below 1, as much nearer to 1 as there are few windows.
    pub excess: f64,
    /// Windows that show the element.
    pub windows: usize,
}

/// Windows that count as scattering like their sigmas before any is seen.
#[cfg(feature = "std")]
const PRIOR_WINDOWS: f64 = 4.0;

impl Baseline {
    /// Mean and scatter of what windows show.
    #[cfg(feature = "std")]
    pub(super) fn of(shown: &[Reading]) -> Self {
        let weight = |reading: &Reading| 1.0 / (reading.sigma * reading.sigma).max(f64::MIN_POSITIVE);
        let weights: f64 = shown.iter().map(weight).sum();
        let weighted = |of: &dyn Fn(&Reading) -> f64| {
            shown.iter().map(|reading| weight(reading) * of(reading)).sum::<f64>() / weights.max(f64::MIN_POSITIVE)
        };
        let n = shown.len() as f64;
        let unbiased = n / (n - 1.0).max(1.0);
        let mean = weighted(&|reading| reading.value);
        let squares = weighted(&|reading| (reading.value - mean) * (reading.value - mean));
        // The mean of deviation² over sigma².
        let relative = squares * weights / n.max(1.0);
        Self {
            mean,
            scatter: libm::sqrt(unbiased * squares),
            sigma: libm::sqrt(n / weights.max(f64::MIN_POSITIVE)),
            sigma_largest: shown.iter().fold(0.0, |largest, reading| largest.max(reading.sigma)),
            excess: libm::sqrt((unbiased * relative).max((n * relative + PRIOR_WINDOWS) / (n + PRIOR_WINDOWS))),
            windows: shown.len(),
        }
    }

    /// A reading of a later window with the uncertainty of the unit. How far the healthy windows scatter compared with their sigmas
    /// holds for sigmas up to the largest of theirs, and where they scatter more for every one; a window that shows less than they
    /// do keeps what its own sigma has besides. That they scatter less than their sigmas holds for a window of the `same_motion`
    /// alone: errors of the model repeat with the motion. The uncertainty of their mean is added. Derived here.
    /// Where a window has less noise than the healthy ones, their sigmas count with the share `calm` that is left of their residual; what
    /// they scatter beyond their sigmas is none of the noise.
    pub(super) fn widened(&self, reading: Reading, same_motion: bool, calm: f64) -> Result<Reading, Needed> {
        if self.windows < 2 {
            return Err(Needed::CommissioningThatShowsIt);
        }
        let mean = self.scatter / libm::sqrt(self.windows as f64);
        let squared = |sigma: f64| sigma * sigma;
        let like_theirs = reading.sigma.min(self.sigma_largest).max(calm * self.sigma);
        let besides = (squared(reading.sigma) - squared(like_theirs)).max(0.0);
        let excess = if same_motion { self.excess } else { self.excess.max(1.0) };
        let beyond_noise = if excess > 1.0 {
            (squared(excess) - 1.0) * (squared(self.sigma) - squared(like_theirs)).max(0.0)
        } else {
            0.0
        };
        let variance = squared(excess * like_theirs) + beyond_noise + squared(self.excess.max(1.0)) * besides;
        let sigma = libm::sqrt(variance + squared(mean));
        Ok(Reading { sigma, ..reading })
    }
}
