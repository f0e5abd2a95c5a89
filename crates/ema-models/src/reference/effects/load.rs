//! Loads at the output besides the constant one of the scenario; no measurement reports them.

use crate::real::Real;

/// Unmeasured loads, Nm at the output, positive when they oppose positive motion:
/// `T_u + k_s (θ_out − θ_out(0)) + T_w sin(2πt/τ)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadEffects {
    /// Constant part T_u, Nm.
    pub constant: f64,
    /// Stiffness k_s of a spring (a hinge moment) with its zero at the initial output angle, Nm/rad.
    pub spring: f64,
    /// Amplitude T_w of a slow drift, Nm.
    pub drift: f64,
    /// Period τ of the drift, s.
    pub drift_period: f64,
}

impl Default for LoadEffects {
    /// None. When a drift is set, its period is 10 s.
    fn default() -> Self {
        Self {
            constant: 0.0,
            spring: 0.0,
            drift: 0.0,
            drift_period: 10.0,
        }
    }
}

impl LoadEffects {
    /// Unmeasured load at an output angle relative to the initial one, rad, and a time, s, in Nm.
    pub(crate) fn torque(&self, travel: f64, t: f64) -> f64 {
        let mut torque = self.constant + self.spring * travel;
        if self.drift > 0.0 {
            torque += self.drift * (core::f64::consts::TAU * t / self.drift_period).sin_cos_poly().0;
        }
        torque
    }
}
