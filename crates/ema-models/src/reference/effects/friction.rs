//! Friction beyond the constant dry torque: Stribeck's part, the temperature, and a ripple with each tooth of the gear.

use crate::real::Real;
use crate::temperature::REFERENCE_TEMPERATURE_DEG_C;

/// Effects on friction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrictionEffects {
    /// Torque ΔT by which friction at low speed exceeds T_d, Nm.
    pub stribeck: f64,
    /// Stribeck speed ω_s, rad/s.
    pub stribeck_speed: f64,
    /// Ratio of the viscous damping at −40 °C to that at +40 °C, minus 1.
    pub viscous_temperature: f64,
    /// Ratio of the dry friction at −40 °C to that at +40 °C, minus 1.
    pub dry_temperature: f64,
    /// Temperature of the unit above that of the scenario, K; it affects the motor too.
    pub temperature_rise: f64,
    /// Amplitude of the ripple with each tooth, as a share of the dry friction.
    pub mesh_ripple: f64,
    /// Teeth per motor revolution, N_t.
    pub teeth: f64,
}

impl Default for FrictionEffects {
    /// None. When one is set: ω_s = 10 rad/s, 13 teeth.
    fn default() -> Self {
        Self {
            stribeck: 0.0,
            stribeck_speed: 10.0,
            viscous_temperature: 0.0,
            dry_temperature: 0.0,
            temperature_rise: 0.0,
            mesh_ripple: 0.0,
            teeth: 13.0,
        }
    }
}

/// Temperatures between which the ratios of [`FrictionEffects`] hold: 80 K, from −40 to +40 °C.
const TEMPERATURE_SPAN: f64 = 80.0;

impl FrictionEffects {
    /// Factors on dry friction and on viscous damping at a temperature, °C; 1 at 20 °C.
    pub(crate) fn temperature_factors(&self, temperature_deg_c: f64) -> [f64; 2] {
        let cold = (REFERENCE_TEMPERATURE_DEG_C - temperature_deg_c) / TEMPERATURE_SPAN;
        [self.dry_temperature, self.viscous_temperature].map(|excess| libm::pow(1.0 + excess, cold))
    }
}

/// Dry friction of one unit as a function of speed and angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FrictionCurve {
    dynamic: f64,
    breakaway: f64,
    stribeck: f64,
    per_stribeck_speed: f64,
    mesh_ripple: f64,
    teeth: f64,
}

impl FrictionCurve {
    /// The curve for T_d and T_s of a healthy unit, Nm, all scaled by `factor` (wear and temperature). The breakaway torque is
    /// at least that of the slowest motion.
    pub(crate) fn new(effects: &FrictionEffects, dynamic: f64, breakaway: f64, factor: f64) -> Self {
        let stribeck = factor * effects.stribeck;
        let dynamic = factor * dynamic;
        Self {
            dynamic,
            breakaway: (factor * breakaway).max(dynamic + stribeck),
            stribeck,
            per_stribeck_speed: 1.0 / effects.stribeck_speed,
            mesh_ripple: effects.mesh_ripple,
            teeth: effects.teeth,
        }
    }

    /// Torques `[in motion, breakaway]`, Nm: `(T_d + ΔT e^(−(ω/ω_s)²)) (1 + a sin N_t θ_m)` and `T_s (1 + a sin N_t θ_m)`.
    pub(crate) fn torques(&self, omega: f64, theta_m: f64) -> [f64; 2] {
        let mut moving = self.dynamic;
        let ratio = omega * self.per_stribeck_speed;
        let square = ratio * ratio;
        // Beyond six Stribeck speeds the part is below 3e-16 of itself.
        if self.stribeck > 0.0 && square < 36.0 {
            moving += self.stribeck * libm::exp(-square);
        }
        if self.mesh_ripple > 0.0 {
            let mesh = 1.0 + self.mesh_ripple * (self.teeth * theta_m).sin_cos_poly().0;
            return [moving * mesh, self.breakaway * mesh];
        }
        [moving, self.breakaway]
    }

    /// The curve of a share of this friction.
    pub(crate) fn share(&self, share: f64) -> Self {
        Self {
            dynamic: share * self.dynamic,
            breakaway: share * self.breakaway,
            stribeck: share * self.stribeck,
            ..*self
        }
    }
}
