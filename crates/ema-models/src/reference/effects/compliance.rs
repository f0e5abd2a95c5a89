//! Compliant transmission: motor and load as two masses with a spring, a damper and the play between them.

/// Two masses, referred to the motor shaft; a rigid shaft where `resonance` is 0.
///
/// `f_r = √(K (1/J_m + 1/J_l)) / 2π` with both ends free; the damper is `D = 2 ζ 2π f_r J_m J_l / (J_m + J_l)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compliance {
    /// Resonance f_r with the motor free, Hz; 0 for a rigid shaft.
    pub resonance: f64,
    /// Damping ratio ζ of this resonance.
    pub damping_ratio: f64,
    /// Share J_l / J of the inertia on the load side.
    pub load_inertia: f64,
    /// Share of the dry friction on the load side.
    pub load_friction: f64,
}

impl Default for Compliance {
    /// Rigid. When a resonance is set: ζ = 0.03, J_l = 0.23 J, 30 % of the dry friction on the load side.
    fn default() -> Self {
        Self {
            resonance: 0.0,
            damping_ratio: 0.03,
            load_inertia: 0.23,
            load_friction: 0.3,
        }
    }
}
