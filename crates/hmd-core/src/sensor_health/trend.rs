//! The trend of one drift: a straight line through the last readings.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

/// Most readings that a trend is drawn through; the oldest gives way.
pub const TREND_MAX: usize = 32;

/// Readings that a trend needs.
const READINGS_MIN: usize = 6;

/// Hours, drift and its standard deviation.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub(super) struct Trend(VecDeque<[f64; 3]>);

impl Trend {
    pub(super) fn is_possible(&self) -> bool {
        self.0.len() <= TREND_MAX
            && self
                .0
                .iter()
                .all(|reading| reading.iter().all(|x| x.is_finite()) && reading[2] >= 0.0)
    }

    pub(super) fn push(&mut self, hours: f64, drift: f64, sigma: f64) {
        if self.0.len() == TREND_MAX {
            self.0.pop_front();
        }
        self.0.push_back([hours, drift, sigma]);
    }

    /// Slope per hour with its standard deviation, each reading weighted by its own; `None` with too few readings, or all at one time.
    pub(super) fn slope(&self) -> Option<(f64, f64)> {
        if self.0.len() < READINGS_MIN {
            return None;
        }
        let weighted = |of: &dyn Fn(&[f64; 3]) -> f64| {
            let readings = self.0.iter();
            readings
                .map(|reading| of(reading) / (reading[2] * reading[2]).max(f64::MIN_POSITIVE))
                .sum::<f64>()
        };
        let weights = weighted(&|_| 1.0);
        let [at, mean] = [0, 1].map(|column| weighted(&|reading| reading[column]) / weights);
        let squares = weighted(&|reading| (reading[0] - at).powi(2));
        let slope = weighted(&|reading| (reading[0] - at) * (reading[1] - mean)) / squares;
        let sigma = squares.sqrt().recip();
        (slope.is_finite() && sigma.is_finite()).then_some((slope, sigma))
    }
}
