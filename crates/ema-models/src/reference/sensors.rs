//! What the sensors make of the truth: converters with noise for the currents, counters for the angles.

use crate::params::SensorParams;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// How the currents are measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurrentSensing {
    /// Whether the 12-bit converters round and limit (otherwise the wire's own resolution is all that rounds).
    pub quantised: bool,
    /// Gaussian noise before the converter, A rms.
    pub noise_rms: f64,
}

impl CurrentSensing {
    /// No converter, no noise: what the accuracy suites without noise use.
    pub const IDEAL: Self = Self {
        quantised: false,
        noise_rms: 0.0,
    };

    /// One reading of three currents, A.
    pub fn read(&self, sensors: &SensorParams, currents: [f64; 3], rng: &mut ChaCha8Rng) -> [f64; 3] {
        currents.map(|i| {
            let noise: f64 = if self.noise_rms > 0.0 {
                StandardNormal.sample(rng)
            } else {
                0.0
            };
            let noisy = i + self.noise_rms * noise;
            if !self.quantised {
                return noisy;
            }
            let lsb = sensors.current_lsb();
            let half_range = f64::from(1u32 << (sensors.current_bits - 1));
            libm::round(noisy / lsb).clamp(-half_range, half_range - 1.0) * lsb
        })
    }
}

/// Counter reading `floor(theta / lsb)` of an angle, multi-turn.
#[must_use]
pub fn count(theta: f64, lsb: f64) -> i64 {
    libm::floor(theta / lsb) as i64
}
