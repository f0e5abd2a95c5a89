//! Cogging: torque between magnets and slots, without current.

/// Cogging torque `T_c sin(N_c θ_m + φ)`, positive along positive motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cogging {
    /// Amplitude T_c, Nm.
    pub torque: f64,
    /// Periods N_c per revolution; 0 for six per pole pair.
    pub periods: f64,
    /// Phase φ, rad.
    pub phase: f64,
}
