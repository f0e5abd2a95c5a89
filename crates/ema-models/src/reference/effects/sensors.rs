//! Sensors with deviations: currents, resolver, output encoder, and the instants at which they are latched.

use crate::real::Real;

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

impl ResolverError {
    /// `[a cos φ, a sin φ]`.
    fn components(&self) -> [f64; 2] {
        let (sin, cos) = self.phase.sin_cos_poly();
        [self.amplitude * cos, self.amplitude * sin]
    }
}

/// Error of one resolver as a function of the electrical angle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ResolverCurve {
    first: [f64; 2],
    second: [f64; 2],
}

impl ResolverCurve {
    /// Error, rad electrical, and its derivative with respect to the electrical angle, at the angle with this sine and cosine.
    pub(crate) fn at(&self, (sin, cos): (f64, f64)) -> [f64; 2] {
        // a sin(x + φ) and a cos(x + φ).
        let wave = |[along, across]: [f64; 2], s: f64, c: f64| [along * s + across * c, along * c - across * s];
        let [first, first_slope] = wave(self.first, sin, cos);
        let [second, second_slope] = wave(self.second, 2.0 * sin * cos, cos * cos - sin * sin);
        [first + second, first_slope + 2.0 * second_slope]
    }
}

impl SensorEffects {
    /// The error of the resolver; `None` without error.
    pub(crate) fn resolver(&self) -> Option<ResolverCurve> {
        (self.resolver_1.amplitude + self.resolver_2.amplitude > 0.0).then(|| ResolverCurve {
            first: self.resolver_1.components(),
            second: self.resolver_2.components(),
        })
    }

    /// Output angle as the encoder sees it, rad.
    pub(crate) fn output_angle(&self, theta_out: f64) -> f64 {
        if self.encoder_eccentricity <= 0.0 {
            return theta_out;
        }
        theta_out + self.encoder_eccentricity * (theta_out + self.encoder_phase).sin_cos_poly().0
    }

    /// Phase currents as the sensors see them, before filter, noise and converter, A.
    pub(crate) fn currents(&self, i: [f64; 3]) -> [f64; 3] {
        let seen = core::array::from_fn(|j| i[j] * (1.0 + self.current_gain[j]) + self.current_offset[j]);
        self.completed(seen)
    }

    /// The currents with the third from the other two, where it has no sensor, A.
    pub(crate) fn completed(&self, [a, b, c]: [f64; 3]) -> [f64; 3] {
        if self.two_current_sensors {
            [a, b, -a - b]
        } else {
            [a, b, c]
        }
    }
}
