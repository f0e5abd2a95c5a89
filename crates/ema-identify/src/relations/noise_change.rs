//! Variances of the noise of the measured signals, of a window and of commissioning.

use serde::{Deserialize, Serialize};

/// Variances of the noise of the measured signals.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeasurementNoise {
    /// Of the quadrature current, A².
    pub current: f64,
    /// Of the motor angle, rad².
    pub angle: f64,
    /// Samples from which they come.
    pub samples: f64,
}

impl MeasurementNoise {
    /// Mean of windows; `None` without one.
    #[must_use]
    pub fn mean(windows: impl Iterator<Item = Self>) -> Option<Self> {
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for window in windows {
            for (sum, value) in sum.iter_mut().zip([window.current, window.angle, window.samples]) {
                *sum += value;
            }
            count += 1.0;
        }
        let [current, angle, samples] = sum;
        (count > 0.0).then(|| Self {
            current: current / count,
            angle: angle / count,
            samples,
        })
    }
}

/// Noise of a window, and of the windows of commissioning where the unit's file says it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseChange {
    /// In the window.
    pub now: MeasurementNoise,
    /// At commissioning.
    pub commissioned: Option<MeasurementNoise>,
}
