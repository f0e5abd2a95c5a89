//! The fault vector k1…k8 of an actuator (\[P\] section 6.1), the seven faults it describes, and their damage.
//!
//! [`FaultVector`] has eight parameters in [0, 1]; [`FaultId`] names the seven faults, with one table of names, parts and
//! parameters. The eighth parameter, k7, is the direction of the eccentricity and not a fault.

/// Number of fault parameters.
pub const FAULT_COUNT: usize = 8;

/// Normalised fault vector of one actuator, \[P\] section 6.1; index order k1…k8 is the order of the fields.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultVector {
    /// k1: dry friction; T_d and T_s are multiplied by `1 + 2 k1`.
    pub friction: f64,
    /// k2: backlash; b = b₀ `(1 + 99 k2)`.
    pub backlash: f64,
    /// k3: inter-turn short of phase A; fraction of the phase's turns that are shorted.
    pub short_a: f64,
    /// k4: inter-turn short of phase B.
    pub short_b: f64,
    /// k5: inter-turn short of phase C.
    pub short_c: f64,
    /// k6: amplitude ζ of the static eccentricity; at 1 the rotor touches the stator.
    pub eccentricity: f64,
    /// k7: direction of the eccentricity, φ_e = π (2 k7 − 1). It is an angle: 0 and 1 are the same direction. It has no
    /// meaning when k6 is near zero.
    pub eccentricity_phase: f64,
    /// k8: proportional gain of the position loop; G_p is multiplied by `0.5 + k8`.
    pub gain: f64,
}

impl FaultVector {
    /// The healthy actuator.
    pub const NOMINAL: Self = Self::from_array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5]);

    /// Index of k7, the direction of the eccentricity: the parameter that is not a fault.
    pub const ECCENTRICITY_PHASE_INDEX: usize = 6;

    /// Names of the eight parameters in configuration, records and on the command line, in index order.
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

    /// Whether every parameter is in [0, 1]; false for NaN.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.to_array().iter().all(|k| (0.0..=1.0).contains(k))
    }

    /// Damage of one fault, 0 (healthy) to 1: the parameter itself, and `2 |k8 − ½|` for the controller gain.
    ///
    /// ```
    /// use ema_models::{FaultId, FaultVector};
    /// let mut worn = FaultVector::NOMINAL;
    /// (worn.friction, worn.gain) = (0.3, 0.25);
    /// assert_eq!(worn.damage_of(FaultId::Friction), 0.3);
    /// assert_eq!(worn.damage_of(FaultId::Gain), 0.5);
    /// assert!(FaultId::ALL.iter().all(|&fault| FaultVector::NOMINAL.damage_of(fault) == 0.0));
    /// ```
    #[must_use]
    pub fn damage_of(&self, fault: FaultId) -> f64 {
        match fault {
            FaultId::Gain => fault.damage_per_change() * libm::fabs(self.gain - 0.5),
            _ => self.to_array()[fault.parameter()],
        }
    }

    /// Damage of each fault, in the order of [`FaultId::ALL`].
    #[must_use]
    pub fn damages(&self) -> [f64; FaultId::COUNT] {
        FaultId::ALL.map(|fault| self.damage_of(fault))
    }

    /// Damage of each parameter, in index order of the fault vector; 0 for k7, which is a direction.
    #[must_use]
    pub fn damage(&self) -> [f64; FAULT_COUNT] {
        let mut damage = [0.0; FAULT_COUNT];
        for fault in FaultId::ALL {
            damage[fault.parameter()] = self.damage_of(fault);
        }
        damage
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

    /// Winding turns ratios `[N_A, N_B, N_C]`: fractions of intact turns, `N_j = 1 − k`.
    ///
    /// Where two shorts reach 1 both are taken as 0.99 (\[P\] section 6.1). No ratio is below 0.01, because the inductance is
    /// proportional to its square.
    #[must_use]
    pub fn winding_turns_ratio(&self) -> [f64; 3] {
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

/// One of the seven faults of an actuator.
///
/// The discriminant is the position in [`FaultId::ALL`] and in every list of faults.
///
/// ```
/// use ema_models::FaultId;
/// assert_eq!(FaultId::from_name("short_a"), Some(FaultId::ShortA));
/// assert_eq!(FaultId::ShortA.plain_name(), "inter-turn short, phase A");
/// assert_eq!(FaultId::from_parameter(6), None); // k7 is a direction, not a fault
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FaultId {
    /// Dry friction of bearings and transmission, k1.
    Friction,
    /// Backlash of the transmission, k2.
    Backlash,
    /// Inter-turn short of phase A, k3.
    ShortA,
    /// Inter-turn short of phase B, k4.
    ShortB,
    /// Inter-turn short of phase C, k5.
    ShortC,
    /// Static eccentricity of the rotor, k6 (direction k7).
    Eccentricity,
    /// Proportional gain of the position loop, k8.
    Gain,
}

/// Parameter, name in files, name for people, and part of one fault.
struct FaultEntry {
    parameter: usize,
    name: &'static str,
    plain_name: &'static str,
    part: &'static str,
}

/// The table of faults, in the order of [`FaultId::ALL`].
const FAULT_TABLE: [FaultEntry; FaultId::COUNT] = [
    FaultEntry {
        parameter: 0,
        name: "friction",
        plain_name: "friction",
        part: "bearings, gear and screw",
    },
    FaultEntry {
        parameter: 1,
        name: "backlash",
        plain_name: "backlash",
        part: "gear and screw",
    },
    FaultEntry {
        parameter: 2,
        name: "short_a",
        plain_name: "inter-turn short, phase A",
        part: "stator winding, phase A",
    },
    FaultEntry {
        parameter: 3,
        name: "short_b",
        plain_name: "inter-turn short, phase B",
        part: "stator winding, phase B",
    },
    FaultEntry {
        parameter: 4,
        name: "short_c",
        plain_name: "inter-turn short, phase C",
        part: "stator winding, phase C",
    },
    FaultEntry {
        parameter: 5,
        name: "eccentricity",
        plain_name: "eccentricity",
        part: "rotor and its bearings",
    },
    FaultEntry {
        parameter: 7,
        name: "gain",
        plain_name: "controller gain",
        part: "position controller",
    },
];

impl FaultId {
    /// Number of faults.
    pub const COUNT: usize = 7;

    /// All faults, in the order of records and configuration.
    pub const ALL: [Self; Self::COUNT] = [
        Self::Friction,
        Self::Backlash,
        Self::ShortA,
        Self::ShortB,
        Self::ShortC,
        Self::Eccentricity,
        Self::Gain,
    ];

    /// Names in records, configuration and JSON, in the order of [`FaultId::ALL`].
    pub const NAMES: [&'static str; Self::COUNT] = {
        let mut names = [""; Self::COUNT];
        let mut n = 0;
        while n < Self::COUNT {
            names[n] = FAULT_TABLE[n].name;
            n += 1;
        }
        names
    };

    /// Position in [`FaultId::ALL`], 0 to 6.
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Index of the fault's parameter in the fault vector, 0 to 7.
    #[must_use]
    pub const fn parameter(self) -> usize {
        FAULT_TABLE[self as usize].parameter
    }

    /// Damage by a change of the fault's parameter, which scales its standard deviation, too: 2 for the gain, whose damage is
    /// `2 |k8 − ½|`, else 1.
    #[must_use]
    pub const fn damage_per_change(self) -> f64 {
        match self {
            Self::Gain => 2.0,
            _ => 1.0,
        }
    }

    /// The fault of a parameter of the fault vector; `None` for the direction of the eccentricity and beyond k8.
    #[must_use]
    pub fn from_parameter(parameter: usize) -> Option<Self> {
        Self::ALL.into_iter().find(|fault| fault.parameter() == parameter)
    }

    /// Name in records, configuration and JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        FAULT_TABLE[self as usize].name
    }

    /// The fault of a name in records, configuration and JSON.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|fault| fault.name() == name)
    }

    /// Name for people, as reports and messages use it.
    #[must_use]
    pub const fn plain_name(self) -> &'static str {
        FAULT_TABLE[self as usize].plain_name
    }

    /// The part of the actuator that fails.
    #[must_use]
    pub const fn part(self) -> &'static str {
        FAULT_TABLE[self as usize].part
    }
}

impl core::fmt::Display for FaultId {
    /// [`FaultId::plain_name`].
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.pad(self.plain_name())
    }
}

/// Difference of two normalised phases, wrapped to [−½, ½].
#[must_use]
pub fn wrapped_phase_difference(a: f64, b: f64) -> f64 {
    let d = a - b;
    d - libm::round(d)
}

/// Error of an estimate in percent: `100 √(Σ₁..₆ Δ² + k6 wrap(Δ7)² + Δ8²)`, with k6 of the truth.
///
/// This is \[P\] eq. 15 without its factor 1/8 under the root, and with the phase treated as an angle.
///
/// ```
/// use ema_models::{FaultVector, rss_pct};
/// let mut estimate = FaultVector::NOMINAL;
/// estimate.friction = 0.03;
/// estimate.backlash = 0.04;
/// estimate.eccentricity_phase = 0.0; // without eccentricity its direction has no effect
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

/// Error of an estimate in percent by \[P\] eq. 15 as printed, with the phase wrapped: `rss_pct / √8`.
#[must_use]
pub fn eq15_pct(estimate: &FaultVector, truth: &FaultVector) -> f64 {
    rss_pct(estimate, truth) / libm::sqrt(8.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_iii_of_the_paper_averages_to_5_36_percent() {
        // The ten rows of [P] Table III. Their mean by this formula is 5.36 %; the paper prints 5.21 %.
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
    fn two_full_shorts_leave_one_percent_of_the_turns() {
        let mut k = FaultVector::NOMINAL;
        let percent = |k: FaultVector| k.winding_turns_ratio().map(|n| (n * 100.0).round() as u32);
        k.short_a = 1.0;
        assert_eq!(percent(k), [1, 100, 100]);
        k.short_b = 1.0;
        assert_eq!(percent(k), [1, 1, 100]);
    }

    #[test]
    fn every_fault_has_its_parameter_and_its_names() {
        for (n, fault) in FaultId::ALL.into_iter().enumerate() {
            assert_eq!(fault.index(), n);
            assert_eq!(fault.name(), FaultVector::NAMES[fault.parameter()]);
            assert_eq!(FaultId::from_name(fault.name()), Some(fault));
            assert_eq!(FaultId::from_parameter(fault.parameter()), Some(fault));
            assert_eq!(FaultId::NAMES[n], fault.name());
        }
        assert_eq!(FaultId::from_parameter(FaultVector::ECCENTRICITY_PHASE_INDEX), None);
        assert_eq!(FaultId::from_name("eccentricity_phase"), None);
    }

    #[test]
    fn damage_is_that_of_each_parameter_and_zero_for_the_direction() {
        let k = FaultVector::from_array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.9, 0.3]);
        let damage = k.damage();
        let expected = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.0, 2.0 * (0.3 - 0.5f64).abs()];
        assert_eq!(damage.map(f64::to_bits), expected.map(f64::to_bits));
        assert_eq!(
            k.damages().map(f64::to_bits),
            [0, 1, 2, 3, 4, 5, 7].map(|p| damage[p].to_bits())
        );
    }
}
