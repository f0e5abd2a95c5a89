//! Sensors with deviations: currents, resolver, output encoder, and the instants at which they are latched.

/// Deviations of the sensors. Gain and offset of the currents and the resolver's error reach the controller as well as the
/// samples; filter, latencies and jitter belong to the samples alone.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SensorEffects {
    /// Gain error of each phase current, relative.
    pub current_gain: [f64; 3],
    /// Offset of each phase current, A.
    pub current_offset: [f64; 3],
    /// Cut-off frequency of a first-order filter in the path of the samples, Hz; 0 without filter.
    pub current_filter: f64,
    /// Two current sensors, with `i_C = −i_A − i_B`.
    pub two_current_sensors: bool,
    /// Age of the currents at the sample's instant, s.
    pub current_latency: f64,
    /// Age of the two angles at the sample's instant, s.
    pub angle_latency: f64,
    /// Half width of the uniform distribution of the sample's instant, in sample periods.
    pub sample_jitter: f64,
    /// Resolver error of first electrical harmonic.
    pub resolver_1: ResolverError,
    /// Resolver error of second electrical harmonic.
    pub resolver_2: ResolverError,
    /// Amplitude of the output encoder's error once per output revolution, rad.
    pub encoder_eccentricity: f64,
    /// Phase of this error, rad.
    pub encoder_phase: f64,
}

/// One harmonic of the resolver's error, `a sin(h θ_e + φ)`, in electrical radians.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ResolverError {
    /// Amplitude a, rad electrical.
    pub amplitude: f64,
    /// Phase φ, rad.
    pub phase: f64,
}
