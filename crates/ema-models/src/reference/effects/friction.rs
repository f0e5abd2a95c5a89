//! Friction beyond the constant dry torque: Stribeck's part, the temperature, and a ripple with each tooth of the gear.

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
