//! Identifiers: actuator base plus message offset.

use crate::sample::ActuatorId;

/// Base identifier of actuator 0.
const FIRST_BASE: u16 = 0x100;
/// Distance between the bases of neighbouring actuators.
const BASE_STEP: u16 = 0x10;

impl ActuatorId {
    /// Base identifier of this actuator on CAN, `0x100 + 0x10 n`.
    #[must_use]
    pub const fn base(self) -> u16 {
        FIRST_BASE + BASE_STEP * self.index() as u16
    }
}

/// The messages of one actuator; the discriminant is the offset from the actuator's base identifier.
///
/// ```
/// use ema_wire::{ActuatorId, Message};
/// let ema15 = ActuatorId::new(15).expect("0 to 15");
/// assert_eq!(Message::SampleFd.id(ema15), 0x1f8);
/// assert_eq!(Message::from_id(0x1f8), Some((ema15, Message::SampleFd)));
/// assert_eq!(Message::from_id(0x104), None);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum Message {
    /// B+0.
    Currents = 0,
    /// B+1.
    Position = 1,
    /// B+2.
    Command = 2,
    /// B+3.
    Status = 3,
    /// B+8, CAN FD.
    SampleFd = 8,
}

impl Message {
    /// All five messages, by offset. A device sends a sample as the first three, in this order.
    pub const ALL: [Self; 5] = [
        Self::Currents,
        Self::Position,
        Self::Command,
        Self::Status,
        Self::SampleFd,
    ];

    /// The 11-bit identifier of this message of one actuator.
    #[must_use]
    pub const fn id(self, actuator: ActuatorId) -> u16 {
        actuator.base() + self as u16
    }

    /// Actuator and message of an identifier, the inverse of [`Message::id`]; `None` outside the dictionary.
    #[must_use]
    pub fn from_id(id: u16) -> Option<(ActuatorId, Self)> {
        let offset = id.checked_sub(FIRST_BASE)?;
        let actuator = ActuatorId::new(u8::try_from(offset / BASE_STEP).ok()?)?;
        let message = match offset % BASE_STEP {
            0 => Self::Currents,
            1 => Self::Position,
            2 => Self::Command,
            3 => Self::Status,
            8 => Self::SampleFd,
            _ => return None,
        };
        Some((actuator, message))
    }

    /// The part of the DBC message name after `EMA<n>_`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Currents => "Currents",
            Self::Position => "Position",
            Self::Command => "Command",
            Self::Status => "Status",
            Self::SampleFd => "SampleFd",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_and_messages_are_one_to_one() {
        let known = (0..=0x7ff).filter_map(|id| Message::from_id(id).map(|found| (id, found)));
        let mut count = 0;
        for (id, (actuator, message)) in known {
            assert_eq!(message.id(actuator), id);
            count += 1;
        }
        assert_eq!(count, 16 * Message::ALL.len());
        assert_eq!(Message::from_id(u16::MAX), None);
    }
}
