//! Cogging: torque between magnets and slots, without current.

use crate::real::Real;

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

impl Cogging {
    /// The torque for a motor with these pole pairs, whose default of six periods per pole pair is then explicit.
    pub(crate) fn of_motor(self, pole_pairs: f64) -> Self {
        let periods = if self.periods > 0.0 {
            self.periods
        } else {
            6.0 * pole_pairs
        };
        Self { periods, ..self }
    }

    /// Torque at a motor angle, Nm.
    pub(crate) fn torque_at(&self, theta_m: f64) -> f64 {
        if self.torque <= 0.0 {
            return 0.0;
        }
        self.torque * (self.periods * theta_m + self.phase).sin_cos_poly().0
    }
}
