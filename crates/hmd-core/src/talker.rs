//! Who talks on a bus: for a hint where nothing comes of somebody who is watched.

use std::fmt;

use ema_wire::ActuatorId;

use crate::drive_bus::Preset;

/// A number that talks on a bus. Displays as its key in the configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Talker {
    /// Of the built-in dictionary.
    Actuator(ActuatorId),
    /// A drive.
    Node(Preset, u8),
}

impl Talker {
    /// The number.
    #[must_use]
    pub fn number(self) -> u8 {
        match self {
            Self::Actuator(id) => id.index(),
            Self::Node(_, node) => node,
        }
    }

    /// Whether a mistyped number could make one of the other.
    #[must_use]
    pub fn is_like(self, other: Self) -> bool {
        match (self, other) {
            (Self::Actuator(_), Self::Actuator(_)) => true,
            (Self::Node(preset, _), Self::Node(other, _)) => preset == other,
            _ => false,
        }
    }
}

impl fmt::Display for Talker {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Actuator(id) => write!(f, "id {}", id.index()),
            Self::Node(_, node) => write!(f, "node {node}"),
        }
    }
}
