//! Identifiers: actuator base plus message offset.

use core::fmt;

use serde::{Deserialize, Serialize};

/// Base identifier of actuator 0.
const FIRST_BASE: u16 = 0x100;
/// Distance between the bases of neighbouring actuators.
const BASE_STEP: u16 = 0x10;

/// Number of one actuator, 0 to 15, shown as `ema0` … `ema15`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "u8", into = "u8")]
pub struct ActuatorId(u8);

impl ActuatorId {
    /// How many actuators the identifier range has room for.
    pub const COUNT: u8 = 16;

    /// Actuator `index`; `None` above 15.
    #[must_use]
    pub const fn new(index: u8) -> Option<Self> {
        if index < Self::COUNT { Some(Self(index)) } else { None }
    }

    /// Its number, 0 to 15.
    #[must_use]
    pub const fn index(self) -> u8 {
        self.0
    }

    /// Its base identifier, `0x100 + 0x10 n`.
    #[must_use]
    pub const fn base(self) -> u16 {
        FIRST_BASE + BASE_STEP * self.0 as u16
    }

    /// All sixteen, in order.
    pub fn all() -> impl ExactSizeIterator<Item = Self> {
        (0..Self::COUNT).map(Self)
    }
}

impl fmt::Display for ActuatorId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ema{}", self.0)
    }
}

impl From<ActuatorId> for u8 {
    fn from(actuator: ActuatorId) -> Self {
        actuator.0
    }
}

impl TryFrom<u8> for ActuatorId {
    type Error = ActuatorIdError;

    fn try_from(index: u8) -> Result<Self, Self::Error> {
        Self::new(index).ok_or(ActuatorIdError { got: index })
    }
}

/// The number is above 15.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ActuatorIdError {
    /// The number given.
    pub got: u8,
}

impl fmt::Display for ActuatorIdError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "actuator number: expected 0 to 15, got {}", self.got)
    }
}

impl core::error::Error for ActuatorIdError {}

/// The messages of one actuator; the value is the offset from its base.
///
/// ```
/// use ema_wire::can::{ActuatorId, Message};
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
    /// All five, by offset. The first three make one sample, in this order.
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

    /// The inverse of [`Message::id`]; `None` when the identifier is not ours.
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
        let ours = (0..=0x7ff).filter_map(|id| Message::from_id(id).map(|found| (id, found)));
        let mut count = 0;
        for (id, (actuator, message)) in ours {
            assert_eq!(message.id(actuator), id);
            count += 1;
        }
        assert_eq!(count, 16 * Message::ALL.len());
        assert_eq!(Message::from_id(u16::MAX), None);
    }
}
