//! Text logs in the format of `candump -l`.
//!
//! One frame per line: `(seconds.fraction) interface id#data`, for example
//! `(1436509052.249713) vcan0 123#DEADBEEF`. After the identifier (3 hexadecimal digits for 11 bits, 8 for 29 bits and
//! for error frames, whose bit 0x20000000 is set) follows one of
//! - `#` and up to 8 data bytes; `_9`…`_F` after 8 of them is a raw length code, which is accepted and dropped;
//! - `##`, a digit of flags (1 BRS, 2 ESI, 4 FD again) and up to 64 data bytes of a CAN FD frame;
//! - `#R` and the length that a remote request asks for.
//!
//! Bytes may be separated by dots. The direction ` R` (received) or ` T` (sent) may follow. Seconds have 6 or 9
//! decimals. Blank lines and CRLF line ends are fine. Everything else is a [`BadLine`].

mod line;

pub use line::{Decimals, LineFault, MAX_LINE, Part, emit, parse};

use crate::lines::{Line, Lines};
use hmd_core::frame::{BusNames, MAX_CLASSIC_DATA, MAX_DATA, RawFrame};
use std::io::BufRead;
use std::sync::Arc;
use thiserror::Error;

/// A line that is not a frame.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{file}:{line}: {fault}")]
pub struct BadLine {
    /// The log.
    pub file: Arc<str>,
    /// Number of the line, from 1.
    pub line: u64,
    /// What is wrong.
    pub fault: LineFault,
}

/// Reads frames from a log, line by line, in bounded memory.
#[derive(Debug)]
pub struct CandumpReader<R> {
    lines: Lines<R>,
    file: Arc<str>,
    names: BusNames,
    ended: bool,
}

impl<R: BufRead> CandumpReader<R> {
    /// A reader of `input`; `file` names it in errors, `names` is the table of interfaces to go on with.
    pub fn new(input: R, file: &str, names: BusNames) -> Self {
        Self {
            lines: Lines::new(input, MAX_LINE),
            file: file.into(),
            names,
            ended: false,
        }
    }

    /// The interfaces seen so far.
    pub fn bus_names(&self) -> &BusNames {
        &self.names
    }

    /// The table of interfaces, to go on with in the next log.
    pub fn into_bus_names(self) -> BusNames {
        self.names
    }

    /// Lines read so far.
    pub fn lines(&self) -> u64 {
        self.lines.number()
    }
}

impl<R: BufRead> Iterator for CandumpReader<R> {
    type Item = Result<RawFrame, BadLine>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.ended {
            let line = self.lines.read();
            if matches!(line, Ok(Line::None)) {
                self.ended = true;
                return None;
            }
            let text = self.lines.text();
            let parsed = match line {
                Err(error) => {
                    self.ended = true;
                    Err(LineFault::Io(error.kind()))
                }
                Ok(Line::TooLong(got)) => Err(LineFault::TooLong { got }),
                Ok(Line::None | Line::Whole | Line::Unfinished) if text.trim_ascii().is_empty() => continue,
                Ok(Line::Unfinished) => match parse(text, &mut BusNames::new()) {
                    Ok(frame) if cannot_be_cut(&frame) => parse(text, &mut self.names),
                    Ok(_) => Err(LineFault::Unfinished),
                    Err(fault) => Err(fault),
                },
                Ok(_) => parse(text, &mut self.names),
            };
            return Some(parsed.map_err(|fault| BadLine {
                file: self.file.clone(),
                line: self.lines.number(),
                fault,
            }));
        }
        None
    }
}

/// Whether no data byte can follow, so that a line without its end is still the whole frame.
fn cannot_be_cut(frame: &RawFrame) -> bool {
    frame.announced_len() == if frame.is_fd() { MAX_DATA } else { MAX_CLASSIC_DATA }
}
#[cfg(test)]
mod tests;
