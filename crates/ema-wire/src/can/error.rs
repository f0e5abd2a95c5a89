//! Errors of the CAN dictionary: small, `Copy`, with the numbers expected and received.

use core::fmt;

use crate::sample::ActuatorId;

/// Why the bytes of an actuator's frame are not valid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ParseError {
    /// The frame has the wrong number of data bytes.
    Length {
        /// Bytes that this message has.
        expected: usize,
        /// Bytes received.
        got: usize,
    },
    /// The mode is not 0 (idle), 1 (position) or 2 (speed), so the unit of the setpoint is unknown.
    Mode {
        /// Offset of the byte in the frame.
        at: usize,
        /// Its value.
        got: u8,
    },
    /// The sample count of a `SampleFd` is 0 or exceeds the number of slots.
    Count {
        /// Slots in the frame.
        max: u8,
        /// Count received.
        got: u8,
    },
    /// The layout number of a `SampleFd` is not [`SampleFd::LAYOUT`](super::SampleFd::LAYOUT).
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
    /// There are no samples, or more than the frame has slots.
    Count {
        /// Slots in the frame.
        max: usize,
        /// Samples given.
        got: usize,
    },
    /// The samples are of two actuators.
    Actuator {
        /// Actuator of the first sample.
        expected: ActuatorId,
        /// The one that differs.
        got: ActuatorId,
    },
    /// The samples are not consecutive; the frame carries only the first counter.
    Seq {
        /// Counter after that of the sample before.
        expected: u16,
        /// Counter given.
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
