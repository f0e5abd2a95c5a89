//! What cannot be read in a log that other programs wrote.

use std::fmt;
use std::sync::Arc;

use thiserror::Error;

/// A place of a foreign log that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{file}{place}: expected {expected}, found {found}")]
pub struct Damage {
    /// The log.
    pub file: Arc<str>,
    /// Where.
    pub place: Place,
    /// What should be there.
    pub expected: &'static str,
    /// What is there.
    pub found: String,
}

impl Damage {
    /// The same at another place.
    pub(crate) fn at(self, place: Place) -> Self {
        Self { place, ..self }
    }
}

/// A place in a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// Number of a line, from 1: of a text, where a line is a frame or a row.
    Line(u64),
    /// Offset in bytes: of a stretch with any number of frames.
    Byte(u64),
    /// Offset in bytes of the block with one frame or record.
    Frame(u64),
    /// Number of a row, from 1.
    Row(u64),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, ":{line}"),
            Self::Byte(at) | Self::Frame(at) => write!(f, ": at byte {at}"),
            Self::Row(row) => write!(f, ": row {row}"),
        }
    }
}
