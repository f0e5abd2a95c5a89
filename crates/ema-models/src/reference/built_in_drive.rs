//! The drive that a built-in actuator type has by nature; with it, the effects of a unit of the type are off.

use super::effects::{Drive, VectorDrive};

impl Drive {
    /// The drive of a built-in type: `servo270` has a vector drive, 16 kHz, 700 Hz, dead time fully compensated, with decoupling;
    /// every other type hysteresis comparators. All values declared here.
    #[must_use]
    pub fn of_built_in(type_name: &str) -> Self {
        match type_name {
            "servo270" => Self::Vector(VectorDrive {
                pwm_frequency: 16e3,
                bandwidth: 700.0,
                ..VectorDrive::default()
            }),
            _ => Self::Hysteresis,
        }
    }
}
