//! The fault vector: eight numbers in [0, 1] that say what is worn and how far (\[P\] section 6.1).

/// Number of fault parameters.
pub const FAULT_COUNT: usize = 8;

/// Normalised fault vector of one actuator, \[P\] section 6.1; index order k1…k8 as the fields stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultVector {
    /// k1: dry friction; T_d and T_s are multiplied by `1 + 2 k1`.
    pub friction: f64,
    /// k2: backlash; b = b₀ `(1 + 99 k2)`.
    pub backlash: f64,
    /// k3: short circuit of phase A; fraction of its turns that is lost.
    pub short_a: f64,
    /// k4: short circuit of phase B.
    pub short_b: f64,
    /// k5: short circuit of phase C.
    pub short_c: f64,
    /// k6: static eccentricity amplitude ζ; 1 is rotor rub.
    pub eccentricity: f64,
    /// k7: eccentricity direction, φ_e = π (2 k7 − 1); an angle, so 0 and 1 are the same direction. Meaningless when
    /// k6 is near zero.
    pub eccentricity_phase: f64,
    /// k8: proportional gain; G_p is multiplied by `0.5 + k8`.
    pub gain: f64,
}

impl FaultVector {
    /// The healthy actuator.
    pub const NOMINAL: Self = Self::from_array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5]);

    /// Names of the eight parameters, in index order.
    pub const NAMES: [&'static str; FAULT_COUNT] = [
        "friction",
        "backlash",
        "short_a",
        "short_b",
        "short_c",
        "eccentricity",
        "eccentricity_phase",
        "gain",
    ];

    /// From `[k1, …, k8]`.
    #[must_use]
    pub const fn from_array(k: [f64; FAULT_COUNT]) -> Self {
        Self {
            friction: k[0],
            backlash: k[1],
            short_a: k[2],
            short_b: k[3],
            short_c: k[4],
            eccentricity: k[5],
            eccentricity_phase: k[6],
            gain: k[7],
        }
    }

    /// As `[k1, …, k8]`.
    #[must_use]
    pub const fn to_array(self) -> [f64; FAULT_COUNT] {
        [
            self.friction,
            self.backlash,
            self.short_a,
            self.short_b,
            self.short_c,
            self.eccentricity,
            self.eccentricity_phase,
            self.gain,
        ]
    }

    /// Whether every component is a number in [0, 1].
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.to_array().iter().all(|k| (0.0..=1.0).contains(k))
    }

    /// Damage d of each parameter, in index order: `k_i`, for the gain `2 |k8 − ½|`; the phase k7 is a direction, not a
    /// damage, and is 0 here.
    ///
    /// ```
    /// use ema_models::FaultVector;
    /// assert!(FaultVector::NOMINAL.damage().iter().all(|&d| d == 0.0));
    /// ```
    #[must_use]
    pub fn damage(&self) -> [f64; FAULT_COUNT] {
        let mut d = self.to_array();
        d[6] = 0.0;
        d[7] = 2.0 * libm::fabs(self.gain - 0.5);
        d
    }

    /// Factor on both friction torques, `1 + 2 k1`.
    #[must_use]
    pub fn friction_factor(&self) -> f64 {
        1.0 + 2.0 * self.friction
    }

    /// Factor on the healthy backlash, `1 + 99 k2`.
    #[must_use]
    pub fn backlash_factor(&self) -> f64 {
        1.0 + 99.0 * self.backlash
    }

    /// Factor on the proportional gain, `0.5 + k8`.
    #[must_use]
    pub fn gain_factor(&self) -> f64 {
        0.5 + self.gain
    }

    /// Fractions `[N_A, N_B, N_C]` of intact turns, `N_j = 1 − k`.
    ///
    /// Where two shorts reach 1 both are taken as 0.99 (\[P\] section 6.1), and no fraction is below 0.01, because the
    /// inductance goes with its square.
    #[must_use]
    pub fn turns(&self) -> [f64; 3] {
        let mut k = [self.short_a, self.short_b, self.short_c];
        if k.iter().filter(|&&x| x >= 1.0).count() >= 2 {
            for x in &mut k {
                *x = x.min(0.99);
            }
        }
        k.map(|x| (1.0 - x).max(0.01))
    }

    /// Direction φ_e = π (2 k7 − 1) of the smallest air gap, rad in [−π, π].
    #[must_use]
    pub fn eccentricity_angle(&self) -> f64 {
        core::f64::consts::PI * (2.0 * self.eccentricity_phase - 1.0)
    }
}

impl Default for FaultVector {
    fn default() -> Self {
        Self::NOMINAL
    }
}

/// Difference of two normalised phases, wrapped to [−½, ½].
#[must_use]
pub fn wrapped_phase_difference(a: f64, b: f64) -> f64 {
    let d = a - b;
    d - libm::round(d)
}

/// Strict error of an estimate in percent: `100 √(Σ₁..₆ Δ² + k6 wrap(Δ7)² + Δ8²)`, k6 that of the truth.
///
/// \[P\] eq. 15 without its factor 1/8 under the root, and with the phase as the angle it is.
///
/// ```
/// use ema_models::{FaultVector, rss_pct};
/// let mut estimate = FaultVector::NOMINAL;
/// estimate.friction = 0.03;
/// estimate.backlash = 0.04;
/// estimate.eccentricity_phase = 0.0; // no eccentricity: its direction does not count
/// assert!((rss_pct(&estimate, &FaultVector::NOMINAL) - 5.0).abs() < 1e-12);
/// ```
#[must_use]
pub fn rss_pct(estimate: &FaultVector, truth: &FaultVector) -> f64 {
    let (e, t) = (estimate.to_array(), truth.to_array());
    let mut sum = 0.0;
    for i in [0, 1, 2, 3, 4, 5, 7] {
        sum += (e[i] - t[i]) * (e[i] - t[i]);
    }
    let phase = wrapped_phase_difference(e[6], t[6]);
    100.0 * libm::sqrt(sum + t[5] * phase * phase)
}

/// \[P\] eq. 15 as printed, with the phase wrapped: `rss_pct / √8`.
#[must_use]
pub fn eq15_pct(estimate: &FaultVector, truth: &FaultVector) -> f64 {
    rss_pct(estimate, truth) / libm::sqrt(8.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_iii_of_the_paper_averages_to_5_36_percent() {
        // The ten rows of [P] Table III; by this formula 5.36 % on average (the paper prints 5.21).
        let truth = FaultVector::from_array([0.2383, 0.5003, 5.32e-7, 0.4503, 0.0404, 0.0028, 0.2785, 0.5]);
        let rows = [
            [0.2051, 0.4727, 9.44e-4, 0.4414, 0.0445, 0.0041, 0.4334, 0.4950],
            [0.2137, 0.4680, 0.0111, 0.4449, 0.0033, 0.0006, 0.6516, 0.4949],
            [0.2192, 0.4858, 5.59e-5, 0.4421, 0.0026, 0.0067, 0.1195, 0.5096],
            [0.2132, 0.4732, 0.0015, 0.4466, 0.0221, 0.0010, 0.0874, 0.4962],
            [0.2137, 0.4813, 2e-4, 0.4504, 0.0021, 0.0067, 0.1402, 0.4970],
            [0.2143, 0.4771, 0.0012, 0.4545, 0.0031, 0.0052, 0.2438, 0.4999],
            [0.2011, 0.4936, 7.9e-4, 0.5019, 0.0178, 0.0066, 0.5405, 0.5350],
            [0.1959, 0.4807, 7.52e-4, 0.4776, 0.0373, 0.0017, 0.1992, 0.4995],
            [0.2123, 0.4780, 2.59e-4, 0.4660, 0.0087, 0.0009, 0.6436, 0.4978],
            [0.2142, 0.4784, 3.5e-5, 0.4590, 0.0018, 0.0015, 0.9062, 0.4996],
        ];
        let mean = rows
            .iter()
            .map(|&r| rss_pct(&FaultVector::from_array(r), &truth))
            .sum::<f64>()
            / 10.0;
        assert!((mean - 5.36).abs() < 0.01, "{mean}");
    }

    #[test]
    fn two_full_shorts_are_held_at_99_percent() {
        let mut k = FaultVector::NOMINAL;
        k.short_a = 1.0;
        assert_eq!(k.turns().map(|n| (n * 100.0).round() as u32), [1, 100, 100]);
        k.short_b = 1.0;
        assert_eq!(k.turns().map(|n| (n * 100.0).round() as u32), [1, 1, 100]);
    }
}
