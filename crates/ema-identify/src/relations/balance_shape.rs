//! Constants of the torque balance that an actuator type's parameters do not hold.

use ema_models::ActuatorParams;

use super::compliance::Compliance;

/// Constants of the terms that an actuator type's parameters do not hold.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "std", derive(serde::Serialize, serde::Deserialize))]
pub struct BalanceShape {
    /// Stribeck speed ω_s at the motor shaft, rad/s.
    pub stribeck_speed: f64,
    /// Periods of the cogging torque per motor revolution, N_c, a whole number.
    pub cogging_periods: f64,
    /// Teeth of the first gear stage per motor revolution, N_t, a whole number.
    pub teeth: f64,
    /// The transmission behind the motor shaft.
    #[cfg_attr(feature = "std", serde(default))]
    pub compliance: Compliance,
}

impl BalanceShape {
    /// Usual values: 10 rad/s, six cogging periods per pole pair, 13 teeth, a rigid transmission.
    #[must_use]
    pub fn usual(params: &ActuatorParams) -> Self {
        Self {
            stribeck_speed: 10.0,
            cogging_periods: 6.0 * params.motor.pole_pairs,
            teeth: 13.0,
            compliance: Compliance::RIGID,
        }
    }
}
