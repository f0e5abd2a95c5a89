//! [`Sample`]: all quantities that one actuator latched at one instant, with the actuator's number and the setpoint's mode.
//!
//! The same sample travels as three CAN frames ([`Sample::to_frames`]), in a slot of a CAN FD frame, or in a serial packet.

use core::fmt;

use serde::{Deserialize, Serialize};

use crate::quantity::{current_a, position_setpoint_rad, speed_setpoint_rad_s};

/// One complete sample in raw units; the device latches all of it at `t0 + seq / f_s`.
///
/// ```
/// use ema_wire::{ActuatorId, Mode, Sample};
/// let sample = Sample {
///     actuator: ActuatorId::new(0).expect("0 to 15"),
///     seq: 0x0203,
///     time_us: 1_500,
///     i_a_ma: 1_000,
///     i_b_ma: -500,
///     i_c_ma: -500,
///     motor_counts: 260_757,
///     output_counts: 795,
///     setpoint: 250_000,
///     mode: Mode::Position,
/// };
/// assert!(sample.currents_a().iter().sum::<f64>().abs() < 1e-12); // star connection: the currents sum to zero
/// assert_eq!(sample.setpoint_rad(), Some(0.25));
/// assert_eq!(sample.setpoint_rad_s(), None);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sample {
    /// The actuator that sends it.
    pub actuator: ActuatorId,
    /// Sample counter, wraps.
    pub seq: u16,
    /// Device time, low 16 bits of the microseconds; wraps every 65.536 ms.
    pub time_us: u16,
    /// Current of phase A, mA; positive into the motor.
    pub i_a_ma: i16,
    /// Current of phase B, mA; positive into the motor.
    pub i_b_ma: i16,
    /// Current of phase C, mA; positive into the motor.
    pub i_c_ma: i16,
    /// Resolver, 65 536 counts per motor turn, wraps.
    pub motor_counts: i32,
    /// Encoder, 20 000 counts per output turn, 24 bits, wraps.
    pub output_counts: i32,
    /// Position mode: 1 µrad at the output; speed mode: 1 mrad/s at the motor; idle: ignored.
    pub setpoint: i32,
    /// Quantity that the setpoint commands.
    pub mode: Mode,
}

impl Sample {
    /// Low byte of the counter, as in the position and command frames.
    #[must_use]
    pub const fn seq8(&self) -> u8 {
        self.seq as u8
    }

    /// Phase currents A, B, C in A.
    #[must_use]
    pub fn currents_a(&self) -> [f64; 3] {
        [current_a(self.i_a_ma), current_a(self.i_b_ma), current_a(self.i_c_ma)]
    }

    /// Commanded output angle in rad; `None` unless the mode is position.
    #[must_use]
    pub fn setpoint_rad(&self) -> Option<f64> {
        (self.mode == Mode::Position).then(|| position_setpoint_rad(self.setpoint))
    }

    /// Commanded motor speed in rad/s; `None` unless the mode is speed.
    #[must_use]
    pub fn setpoint_rad_s(&self) -> Option<f64> {
        (self.mode == Mode::Speed).then(|| speed_setpoint_rad_s(self.setpoint))
    }
}

/// Quantity that the setpoint commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[repr(u8)]
pub enum Mode {
    /// The actuator is not controlled; the setpoint is ignored.
    #[default]
    Idle = 0,
    /// The setpoint is the output angle, 1 µrad.
    Position = 1,
    /// The setpoint is the motor speed, 1 mrad/s.
    Speed = 2,
}

/// Number of one actuator, 0 to 15, displayed as `ema0` … `ema15`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "u8", into = "u8")]
pub struct ActuatorId(u8);

impl ActuatorId {
    /// Number of actuators in the identifier range.
    pub const COUNT: u8 = 16;

    /// The actuator of this number; `None` above 15.
    #[must_use]
    pub const fn new(index: u8) -> Option<Self> {
        if index < Self::COUNT { Some(Self(index)) } else { None }
    }

    /// Number of the actuator, 0 to 15.
    #[must_use]
    pub const fn index(self) -> u8 {
        self.0
    }

    /// All sixteen actuators, by number.
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

/// The number of an actuator is above 15.
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
