//! The simulated drive of an actuator type; with it, the effects of a unit of the type are off.

use super::effects::{Drive, VectorDrive};
use crate::drive::{DriveKind, DriveParams};

impl Drive {
    /// The drive of a type; where the type leaves a parameter open, the usual one.
    #[must_use]
    pub fn of_type(drive: &DriveParams) -> Self {
        let usual = VectorDrive::default();
        match drive.kind {
            DriveKind::Hysteresis => Self::Hysteresis,
            DriveKind::Vector => Self::Vector(VectorDrive {
                pwm_frequency: drive.pwm_frequency.unwrap_or(usual.pwm_frequency),
                bandwidth: drive.current_bandwidth.unwrap_or(usual.bandwidth),
                dead_time: drive.dead_time.unwrap_or(usual.dead_time),
                decoupling: drive.decoupling.unwrap_or(usual.decoupling),
                ..usual
            }),
        }
    }

    /// The drive of a built-in type ([`DriveParams::of_built_in`]).
    #[must_use]
    pub fn of_built_in(type_name: &str) -> Self {
        Self::of_type(&DriveParams::of_built_in(type_name))
    }
}
