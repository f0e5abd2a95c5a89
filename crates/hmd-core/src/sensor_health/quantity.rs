//! The quantities that the sensors of a unit are tracked by, and how far each may drift.

use ema_models::{ActuatorParams, Tolerances};

use crate::sensor_checks::{OFFSET_SHARE, Reading, SensorReadings, Suspect};

/// A property of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum SensorQuantity {
    /// Sum of the offsets of the three currents, A.
    CurrentSum,
    /// Offset of the currents along phase A, A.
    OffsetAlpha,
    /// Offset of the currents across phase A, A.
    OffsetBeta,
    /// Gain of phase A against the mean of the three.
    GainA,
    /// Gain of phase B.
    GainB,
    /// Gain of phase C.
    GainC,
    /// Age of the currents against the angles, s.
    Latency,
    /// Error of the resolver, cos θ_e, rad electrical.
    Resolver1Cos,
    /// sin θ_e.
    Resolver1Sin,
    /// cos 2θ_e.
    Resolver2Cos,
    /// sin 2θ_e.
    Resolver2Sin,
    /// Link voltage, V.
    DcLink,
}

/// Number of quantities.
pub const SENSOR_QUANTITY_COUNT: usize = 12;

/// Share of the nominal link voltage by which supplies differ from day to day.
const LINK_SHARE: f64 = 0.05;

/// Latency that no loop of a drive makes, s.
const LATENCY_MIN_S: f64 = 1e-4;

impl SensorQuantity {
    /// All; the discriminant is the place.
    pub const ALL: [Self; SENSOR_QUANTITY_COUNT] = [
        Self::CurrentSum,
        Self::OffsetAlpha,
        Self::OffsetBeta,
        Self::GainA,
        Self::GainB,
        Self::GainC,
        Self::Latency,
        Self::Resolver1Cos,
        Self::Resolver1Sin,
        Self::Resolver2Cos,
        Self::Resolver2Sin,
        Self::DcLink,
    ];

    /// Name in records, with its unit.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::CurrentSum => "current_sum_a",
            Self::OffsetAlpha => "current_offset_alpha_a",
            Self::OffsetBeta => "current_offset_beta_a",
            Self::GainA => "phase_gain_a",
            Self::GainB => "phase_gain_b",
            Self::GainC => "phase_gain_c",
            Self::Latency => "current_latency_s",
            Self::Resolver1Cos => "resolver_1_cos_rad",
            Self::Resolver1Sin => "resolver_1_sin_rad",
            Self::Resolver2Cos => "resolver_2_cos_rad",
            Self::Resolver2Sin => "resolver_2_sin_rad",
            Self::DcLink => "dc_link_v",
        }
    }

    /// The quantity of a name in records.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|quantity| quantity.name() == name)
    }

    /// What a drift of it asks to check.
    #[must_use]
    pub const fn to_check(self) -> &'static str {
        match self {
            Self::CurrentSum | Self::OffsetAlpha | Self::OffsetBeta | Self::GainA | Self::GainB | Self::GainC => {
                Suspect::CurrentOffset.to_check()
            }
            Self::Latency => Suspect::SampleOrder.to_check(),
            Self::Resolver1Cos | Self::Resolver1Sin | Self::Resolver2Cos | Self::Resolver2Sin => {
                Suspect::ResolverFrozen.to_check()
            }
            Self::DcLink => Suspect::DcLink.to_check(),
        }
    }

    /// What a window shows of it.
    #[must_use]
    pub fn of(self, readings: &SensorReadings) -> Option<Reading> {
        let gain = |phase: usize| readings.phase_gain.map(|gains| gains[phase]);
        let offset = |axis: usize| readings.current_offset.map(|offsets| offsets[axis]);
        let resolver = |harmonic: usize| readings.resolver.map(|errors| errors[harmonic]);
        match self {
            Self::CurrentSum => readings.current_sum,
            Self::OffsetAlpha => offset(0),
            Self::OffsetBeta => offset(1),
            Self::GainA => gain(0),
            Self::GainB => gain(1),
            Self::GainC => gain(2),
            Self::Latency => readings.current_latency,
            Self::Resolver1Cos => resolver(0),
            Self::Resolver1Sin => resolver(1),
            Self::Resolver2Cos => resolver(2),
            Self::Resolver2Sin => resolver(3),
            Self::DcLink => readings.dc_link,
        }
    }

    /// Drift that counts as one: what a sensor may be off when it is new, in the unit of the quantity. Where the configuration calls
    /// every number exact, the usual tolerance: no sensor is exact.
    #[must_use]
    pub fn tolerance(self, params: &ActuatorParams, of_type: &Tolerances) -> f64 {
        let or_usual = |own: f64, usual: f64| if own > 0.0 { own } else { usual };
        let usual = &Tolerances::USUAL;
        match self {
            Self::CurrentSum | Self::OffsetAlpha | Self::OffsetBeta => {
                or_usual(of_type.current_offset, usual.current_offset).min(OFFSET_SHARE * params.motor.i_max)
            }
            Self::GainA | Self::GainB | Self::GainC => or_usual(of_type.current_gain, usual.current_gain),
            Self::Latency => or_usual(of_type.sample_latency, usual.sample_latency).max(LATENCY_MIN_S),
            Self::Resolver1Cos | Self::Resolver1Sin | Self::Resolver2Cos | Self::Resolver2Sin => {
                or_usual(of_type.resolver_error, usual.resolver_error)
            }
            Self::DcLink => LINK_SHARE * params.motor.v_dc,
        }
    }
}
