//! The CAN dictionary: identifiers of the actuators' messages and the meaning of their bytes.
//!
//! Identifiers have 11 bits, fields are little-endian ("Intel"). Actuator n has base `0x100 + 0x10 n`; a [`Message`] is an
//! offset from it. [`Frame::parse`] inverts [`Frame::emit`] for every frame.

mod classic;
mod error;
mod fd;
mod id;

pub use classic::{Command, Currents, Position, Status};
pub use error::{BatchError, ParseError};
pub use fd::{FdSlot, SampleFd};
pub use id::Message;

use crate::sample::ActuatorId;

/// Data bytes of every classic message.
pub const CLASSIC_LEN: usize = 8;
/// Data bytes of [`SampleFd`].
pub const FD_LEN: usize = 64;

/// One decoded message of one actuator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frame {
    /// Phase currents and the sample counter.
    Currents(Currents),
    /// Both angle counters.
    Position(Position),
    /// Setpoint, mode and device time.
    Command(Command),
    /// Slow quantities, 10 Hz.
    Status(Status),
    /// Up to three consecutive samples in one CAN FD frame.
    SampleFd(SampleFd),
}

impl Frame {
    /// Parses a data frame with an 11-bit identifier. `Ok(None)`: the identifier is not in the dictionary.
    ///
    /// The caller passes neither remote, error nor 29-bit frames. The format of the frame on the bus, classic or FD, does not
    /// matter; only its length does.
    ///
    /// ```
    /// use ema_wire::can::{Frame, ParseError};
    /// let (actuator, frame) = Frame::parse(0x130, &[0x2c, 1, 0xd4, 0xfe, 0, 0, 7, 0])?.expect("in the dictionary");
    /// assert_eq!(actuator.index(), 3);
    /// let Frame::Currents(currents) = frame else { panic!("offset 0 is Currents") };
    /// assert_eq!([currents.i_a_ma, currents.i_b_ma, currents.i_c_ma], [300, -300, 0]);
    /// assert_eq!(Frame::parse(0x205, &[0; 8])?, None);
    /// assert_eq!(Frame::parse(0x130, &[0; 7]), Err(ParseError::Length { expected: 8, got: 7 }));
    /// # Ok::<(), ParseError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// [`ParseError`] when the identifier is in the dictionary and the bytes are not valid.
    pub fn parse(id: u16, data: &[u8]) -> Result<Option<(ActuatorId, Self)>, ParseError> {
        let Some((actuator, message)) = Message::from_id(id) else {
            return Ok(None);
        };
        let frame = match message {
            Message::Currents => Self::Currents(Currents::parse(with_length(data)?)),
            Message::Position => Self::Position(Position::parse(with_length(data)?)),
            Message::Command => Self::Command(Command::parse(with_length(data)?)?),
            Message::Status => Self::Status(Status::parse(with_length(data)?)),
            Message::SampleFd => Self::SampleFd(SampleFd::parse(with_length(data)?)?),
        };
        Ok(Some((actuator, frame)))
    }

    /// Writes the data bytes to the start of `buffer` and returns them (8 or 64 bytes).
    ///
    /// ```
    /// use ema_wire::{ActuatorId, Command, Frame, Mode};
    /// let frame = Frame::Command(Command { setpoint: 250_000, mode: Mode::Position, time_us: 500, seq8: 1 });
    /// let mut buffer = [0; 64];
    /// let ema2 = ActuatorId::new(2).expect("0 to 15");
    /// assert_eq!(frame.message().id(ema2), 0x122);
    /// assert_eq!(frame.emit(&mut buffer), [0x90, 0xd0, 0x03, 0, 1, 0xf4, 0x01, 1]);
    /// ```
    pub fn emit<'a>(&self, buffer: &'a mut [u8; FD_LEN]) -> &'a [u8] {
        let classic = match self {
            Self::Currents(currents) => currents.emit(),
            Self::Position(position) => position.emit(),
            Self::Command(command) => command.emit(),
            Self::Status(status) => status.emit(),
            Self::SampleFd(samples) => {
                *buffer = samples.emit();
                return buffer;
            }
        };
        let out = &mut buffer[..CLASSIC_LEN];
        out.copy_from_slice(&classic);
        out
    }

    /// The message of this frame; [`Message::id`] gives its identifier.
    #[must_use]
    pub const fn message(&self) -> Message {
        match self {
            Self::Currents(_) => Message::Currents,
            Self::Position(_) => Message::Position,
            Self::Command(_) => Message::Command,
            Self::Status(_) => Message::Status,
            Self::SampleFd(_) => Message::SampleFd,
        }
    }
}

/// The data as exactly `N` bytes, or [`ParseError::Length`].
fn with_length<const N: usize>(data: &[u8]) -> Result<&[u8; N], ParseError> {
    data.try_into().map_err(|_| ParseError::Length {
        expected: N,
        got: data.len(),
    })
}
