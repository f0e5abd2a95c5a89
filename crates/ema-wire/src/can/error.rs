//! Errors of the CAN dictionary: small, `Copy`, with the numbers that tell what was wrong.

use core::fmt;

use super::ActuatorId;

/// Why the bytes of one of our frames are not valid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ParseError {
    /// The frame has the wrong number of data bytes.
    Length {
        /// Bytes this message has.
        expected: usize,
        /// Bytes received.
        got: usize,
    },
    /// The mode is none of 0 (idle), 1 (position), 2 (speed); the setpoint's unit is then unknown.
    Mode {
        /// Offset of the byte in the frame.
        at: usize,
        /// Its value.
        got: u8,
    },
    /// The sample count of a `SampleFd` is 0 or larger than the frame can hold.
    Count {
        /// Slots in the frame.
        max: u8,
        /// Count received.
        got: u8,
    },
    /// The `SampleFd` layout number is not the one this crate knows.
    Layout {
        /// Layout number of this crate.
        expected: u8,
        /// Number received.
        got: u8,
    },
}

impl fmt::Display for ParseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Length { expected, got } => write!(f, "data length: expected {expected} bytes, got {got}"),
            Self::Mode { at, got } => write!(f, "mode at byte {at}: expected 0 to 2, got {got}"),
            Self::Count { max, got } => write!(f, "sample count: expected 1 to {max}, got {got}"),
            Self::Layout { expected, got } => write!(f, "SampleFd layout: expected {expected}, got {got}"),
        }
    }
}

impl core::error::Error for ParseError {}

/// Why samples cannot share one `SampleFd`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BatchError {
    /// None, or more than the frame holds.
    Count {
        /// Slots in the frame.
        max: usize,
        /// Samples given.
        got: usize,
    },
    /// Samples of two actuators.
    Actuator {
        /// Actuator of the first sample.
        expected: ActuatorId,
        /// The one that differs.
        got: ActuatorId,
    },
    /// The samples are not consecutive; the frame carries only the first counter.
    Seq {
        /// The counter that should have followed.
        expected: u16,
        /// The one given.
        got: u16,
    },
}

impl fmt::Display for BatchError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Count { max, got } => write!(f, "samples in one frame: expected 1 to {max}, got {got}"),
            Self::Actuator { expected, got } => write!(f, "actuator: expected {expected}, got {got}"),
            Self::Seq { expected, got } => write!(f, "sample counter: expected {expected}, got {got}"),
        }
    }
}

impl core::error::Error for BatchError {}
