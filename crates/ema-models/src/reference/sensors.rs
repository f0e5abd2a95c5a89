//! Sensors: from true currents and angles to converter readings with noise and to counts.

use crate::params::SensorParams;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Current measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurrentSensing {
    /// Whether the converters round and limit. Otherwise only the transmission rounds.
    pub quantised: bool,
    /// Gaussian noise at the input of the converter, A rms.
    pub noise_rms: f64,
}

impl CurrentSensing {
    /// No converter and no noise, for the accuracy suites without noise.
    pub const IDEAL: Self = Self {
        quantised: false,
        noise_rms: 0.0,
    };

    /// Measured values of three currents, A.
    pub fn measure(&self, sensors: &SensorParams, currents: [f64; 3], rng: &mut ChaCha8Rng) -> [f64; 3] {
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

/// Multi-turn count `floor(theta / lsb)` of an angle.
#[must_use]
pub fn encoder_count(theta: f64, lsb: f64) -> i64 {
    libm::floor(theta / lsb) as i64
}
