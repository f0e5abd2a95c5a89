//! Sources of raw frames, and what can be lost on the way in.
//!
//! A reader yields `Result<RawFrame, Loss>`: an unreadable line or chunk is an item like any other, so that the caller
//! counts it, reports it and goes on. Only what makes a whole source useless is an error of `open`.
//! Live sources ([`live`], [`can`], [`serial`]) never end by themselves: what is missing or fails is said and tried again.
//! Time stamps that step back are passed on as they are; later stages judge them.

pub mod can;
pub mod candump;
pub mod file;
pub mod live;
pub mod mcap;
pub mod serial;

pub use candump::{BadLine, CandumpReader, LineFault};
pub use file::{FrameSource, IngestError, LogFormat, open, open_recorded, open_with};
pub use mcap::{McapFault, McapFrames, McapLoss, McapMessage, McapMessages, McapTail, TailError};

use thiserror::Error;

/// Something that was in a source and could not be read.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Loss {
    /// A line of a text log.
    #[error(transparent)]
    Line(#[from] BadLine),
    /// A stretch of an MCAP file.
    #[error(transparent)]
    Mcap(#[from] McapLoss),
}

impl Loss {
    /// How many frames are known to be lost; 0 when that cannot be told.
    pub fn frames(&self) -> u64 {
        match self {
            Self::Line(_) => 1,
            Self::Mcap(loss) => loss.frames(),
        }
    }
}

/// Bytes as they can be shown in one line of a message: printable ASCII, the rest escaped, cut after 32.
pub(crate) fn shown(bytes: &[u8]) -> String {
    const MOST: usize = 32;
    let mut text: String = bytes[..bytes.len().min(MOST)].escape_ascii().to_string();
    if bytes.len() > MOST {
        text.push('…');
    }
    text
}
