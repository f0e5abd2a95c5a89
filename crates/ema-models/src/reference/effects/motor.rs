//! The motor beyond sinusoidal back-EMF and constant inductance.

/// Back-EMF harmonics and saturation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotorEffects {
    /// 5th harmonic h₅ relative to the fundamental; its part of phase j is `−h₅ sin 5(θ_e − 2πj/3)`.
    pub harmonic_5: f64,
    /// 7th harmonic h₇ relative to the fundamental; its part of phase j is `−h₇ sin 7(θ_e − 2πj/3)`.
    pub harmonic_7: f64,
    /// Share s of the inductance that is lost at I_max: `L_j(i) = L_j (1 − s (i/I_max)²)`, constant beyond I_max.
    pub saturation: f64,
}
