//! What real actuators have besides the ideal one: the effects of a simulated unit, one small type for each family.
//!
//! Input are values by name ([`Effects::set`], table in [`EFFECTS`]), output is what the reference model simulates. Every effect
//! is off by default; with all of them off the reference takes the same steps as without this module. Values are in SI units.

mod catalogue;
mod cogging;
mod compliance;
mod controller;
mod deviations;
mod drive;
mod friction;
mod link;
mod load;
mod motor;
mod sensors;
mod shorted_turns;

pub use catalogue::{EFFECTS, EffectError, EffectInfo, Scale};
pub use cogging::Cogging;
pub use compliance::Compliance;
pub use controller::ControllerEffects;
pub use deviations::Deviations;
pub use drive::{Drive, VectorDrive};
pub use friction::FrictionEffects;
pub use link::LinkEffects;
pub use load::LoadEffects;
pub use motor::MotorEffects;
pub use sensors::{ResolverError, SensorEffects};
pub use shorted_turns::ShortedTurns;

pub(crate) use compliance::TwoMasses;
pub(crate) use controller::{Controller, ControllerState};
pub(crate) use drive::{DriveInput, VectorControl, VectorState};
pub(crate) use friction::FrictionCurve;
pub(crate) use sensors::ResolverCurve;
pub(crate) use shorted_turns::ShortedPhase;

/// All effects of a simulated unit.
///
/// ```
/// use ema_models::reference::Effects;
/// let mut effects = Effects::default();
/// effects.set("cogging_nm", 0.05).unwrap();
/// effects.set("dead_time_s", 1e-6).unwrap(); // a parameter of the vector drive selects this drive
/// assert!(effects.active().any(|(name, value)| name == "cogging_nm" && value == 0.05));
/// assert_eq!(effects.drive.name(), "vector");
/// assert!(effects.set("coging_nm", 0.05).is_err());
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Effects {
    /// Kind of the power electronics and their current control.
    pub drive: Drive,
    /// Parameters that differ from the type's values.
    pub deviations: Deviations,
    /// Setpoint rate, speed filter and delay of the controller.
    pub controller: ControllerEffects,
    /// Compliant transmission.
    pub compliance: Compliance,
    /// Friction beyond the constant dry torque.
    pub friction: FrictionEffects,
    /// Cogging torque.
    pub cogging: Cogging,
    /// Loads besides the constant one.
    pub load: LoadEffects,
    /// Back-EMF harmonics and saturation.
    pub motor: MotorEffects,
    /// Deviations of the sensors.
    pub sensors: SensorEffects,
    /// DC link.
    pub link: LinkEffects,
    /// Shorted turns with a current of their own; `None` for turns that are merely missing.
    pub shorted_turns: Option<ShortedTurns>,
}

impl Effects {
    /// Whether every effect is off.
    #[must_use]
    pub fn are_off(&self) -> bool {
        *self == Self::default()
    }

    /// Whether only parameters differ, so that the plain reference model simulates the unit.
    #[must_use]
    pub fn only_change_parameters(&self) -> bool {
        let rest = Self {
            deviations: Deviations::default(),
            friction: FrictionEffects {
                temperature_rise: 0.0,
                ..self.friction
            },
            ..*self
        };
        rest.are_off()
    }

    /// The vector drive, where the unit has one.
    #[must_use]
    pub fn vector_drive(&self) -> Option<&VectorDrive> {
        match &self.drive {
            Drive::Hysteresis => None,
            Drive::Vector(drive) => Some(drive),
        }
    }
}
