//! Actuation profiles: what is commanded during one actuation.

/// Shape of the position command from the start of an actuation, relative to the position before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Profile {
    /// 0.25 rad at once.
    Step,
    /// 0.6 rad/s.
    Ramp,
    /// 0.05 rad · sin 2π(0.5 τ + 7.5 τ²).
    Chirp,
    /// 0.25 rad and 0.01 rad · sin 2π(0.5 τ + 7.5 τ²): the default.
    #[default]
    Mixed,
}

impl Profile {
    /// Names of the profiles, as the command line spells them.
    pub const NAMES: [(&'static str, Self); 4] = [
        ("step", Self::Step),
        ("ramp", Self::Ramp),
        ("chirp", Self::Chirp),
        ("mixed", Self::Mixed),
    ];

    /// Commanded output angle `tau` seconds after the start, rad relative to before; 0 while `tau` is negative.
    #[must_use]
    pub fn angle(self, tau: f64) -> f64 {
        if tau < 0.0 {
            return 0.0;
        }
        let sweep = libm::sin(core::f64::consts::TAU * (0.5 * tau + 7.5 * tau * tau));
        match self {
            Self::Step => 0.25,
            Self::Ramp => 0.6 * tau,
            Self::Chirp => 0.05 * sweep,
            Self::Mixed => 0.25 + 0.01 * sweep,
        }
    }
}
