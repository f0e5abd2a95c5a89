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

use hmd_core::frame::{BusNames, MAX_CLASSIC_DATA, MAX_DATA, RawFrame};
use std::io::{self, BufRead};
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
    input: R,
    file: Arc<str>,
    names: BusNames,
    line: u64,
    buffer: Vec<u8>,
    ended: bool,
}

impl<R: BufRead> CandumpReader<R> {
    /// A reader of `input`; `file` names it in errors, `names` is the table of interfaces to go on with.
    pub fn new(input: R, file: &str, names: BusNames) -> Self {
        Self {
            input,
            file: file.into(),
            names,
            line: 0,
            buffer: Vec::with_capacity(MAX_LINE + 1),
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
        self.line
    }

    /// Reads the next line into the buffer, without its end.
    fn read_line(&mut self) -> Result<Line, io::Error> {
        self.buffer.clear();
        let mut length = 0_u64;
        loop {
            let block = match self.input.fill_buf() {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                other => other?,
            };
            if block.is_empty() {
                return Ok(match length {
                    0 => Line::None,
                    _ if length > MAX_LINE as u64 => Line::TooLong(length),
                    _ => Line::Unfinished,
                });
            }
            let end = block.iter().position(|&byte| byte == b'\n');
            let part = &block[..end.unwrap_or(block.len())];
            let room = MAX_LINE.saturating_sub(self.buffer.len());
            self.buffer.extend_from_slice(&part[..part.len().min(room)]);
            length += part.len() as u64;
            let used = part.len() + usize::from(end.is_some());
            self.input.consume(used);
            if end.is_some() {
                return Ok(if length > MAX_LINE as u64 {
                    Line::TooLong(length)
                } else {
                    Line::Whole
                });
            }
        }
    }
}

enum Line {
    None,
    Whole,
    Unfinished,
    TooLong(u64),
}

impl<R: BufRead> Iterator for CandumpReader<R> {
    type Item = Result<RawFrame, BadLine>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.ended {
            let line = self.read_line();
            if matches!(line, Ok(Line::None)) {
                self.ended = true;
                return None;
            }
            self.line += 1;
            let parsed = match line {
                Err(error) => {
                    self.ended = true;
                    Err(LineFault::Io(error.kind()))
                }
                Ok(Line::TooLong(got)) => Err(LineFault::TooLong { got }),
                Ok(Line::None | Line::Whole | Line::Unfinished) if self.buffer.trim_ascii().is_empty() => continue,
                Ok(Line::Unfinished) => match parse(&self.buffer, &mut BusNames::new()) {
                    Ok(frame) if cannot_be_cut(&frame) => parse(&self.buffer, &mut self.names),
                    Ok(_) => Err(LineFault::Unfinished),
                    Err(fault) => Err(fault),
                },
                Ok(_) => parse(&self.buffer, &mut self.names),
            };
            return Some(parsed.map_err(|fault| BadLine {
                file: self.file.clone(),
                line: self.line,
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
