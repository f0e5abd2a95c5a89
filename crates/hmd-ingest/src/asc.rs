//! Text logs of Vector's tools, `.asc`.
//!
//! A head (`date …`, `base hex|dec timestamps absolute|relative`), then a line per event, of which frames are used:
//!
//! ```text
//! 0.000120 1  1A0             Rx   d 8 EA 77 00 00 B7 00 00 00
//! 0.000240 1  ErrorFrame
//! 0.000360 CANFD   1 Rx  123  NAME  1 0 d 32 … 0 0 3000 …
//! ```
//!
//! Stamps count from the newest `Begin Triggerblock` or `date`, whose zone no file names: they are taken as UTC. Channel n is the
//! interface `can<n-1>`, as SocketCAN and python-can count. An error frame has no class there; it becomes that of a bus error.

mod date;
mod line;

use std::io::BufRead;
use std::sync::Arc;

use hmd_core::frame::{BusNames, RawFrame};
use hmd_storage::quoted;

use crate::damage::{Damage, Place};
use crate::lines::{Line, Lines};
use date::date_ns;
use line::{Fault, parse};

/// Longest line that is looked at, bytes; one of a 64-byte frame with all its fields has about 400.
const MAX_LINE: usize = 1000;

/// Reads frames from a log, line by line, in bounded memory.
#[derive(Debug)]
pub struct AscReader<R> {
    lines: Lines<R>,
    file: Arc<str>,
    names: BusNames,
    state: State,
    ended: bool,
}

/// What the lines so far say about those to come.
#[derive(Debug)]
struct State {
    /// Of identifiers and data.
    radix: u32,
    /// Each stamp counts from the one before.
    relative: bool,
    start_ns: u64,
    /// Stamp of the line before, from the start.
    last_ns: u64,
}

/// Whether a text begins as such a log does.
#[must_use]
pub fn is_asc(start: &[u8]) -> bool {
    let mut lines = start.split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii);
    let first = lines.find(|line| !line.is_empty() && !line.starts_with(b"//"));
    first.is_some_and(|line| has_prefix(line, b"date ") || has_prefix(line, b"base "))
}

fn has_prefix(line: &[u8], prefix: &[u8]) -> bool {
    line.get(..prefix.len())
        .is_some_and(|start| start.eq_ignore_ascii_case(prefix))
}

impl<R: BufRead> AscReader<R> {
    /// A reader of `input`; `file` names it in errors, `names` is the table of interfaces to go on with.
    pub fn new(input: R, file: &str, names: BusNames) -> Self {
        Self {
            lines: Lines::new(input, MAX_LINE),
            file: file.into(),
            names,
            state: State {
                radix: 16,
                relative: false,
                start_ns: 0,
                last_ns: 0,
            },
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

    fn damage(&self, fault: Fault) -> Damage {
        Damage {
            file: self.file.clone(),
            place: Place::Line(self.lines.number()),
            expected: fault.expected,
            found: fault.found,
        }
    }
}

impl State {
    /// Takes a line of the head; whether it was one.
    fn take_head(&mut self, line: &[u8]) -> Result<bool, Fault> {
        let date = if has_prefix(line, b"date ") {
            line.get(5..)
        } else if has_prefix(line, b"begin triggerblock") {
            line.get(18..).filter(|rest| !rest.trim_ascii().is_empty())
        } else {
            None
        };
        if let Some(date) = date {
            self.start_ns = date_ns(date).ok_or_else(|| Fault {
                expected: "a date, as \"Tue Nov 14 10:13:20.000 pm 2023\"",
                found: format!("\"{}\"", quoted(date.trim_ascii())),
            })?;
            self.last_ns = 0;
            return Ok(true);
        }
        if has_prefix(line, b"base ") {
            let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
            let has = |word: &[u8], of: &str| word.eq_ignore_ascii_case(of.as_bytes());
            self.radix = if words.clone().any(|word| has(word, "dec")) {
                10
            } else {
                16
            };
            self.relative = words.any(|word| has(word, "relative"));
            return Ok(true);
        }
        Ok(!line.first().is_some_and(u8::is_ascii_digit))
    }
}

impl<R: BufRead> Iterator for AscReader<R> {
    type Item = Result<RawFrame, Damage>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.ended {
            let fault = match self.lines.read() {
                Ok(Line::None) => {
                    self.ended = true;
                    return None;
                }
                Err(error) => {
                    self.ended = true;
                    Fault::new("to read on", error.kind())
                }
                Ok(Line::TooLong(got)) => Fault::new("at most 1000 bytes in a line", got),
                // A line of the head may end the file.
                Ok(Line::Unfinished) if self.lines.text().trim_ascii().first().is_some_and(u8::is_ascii_digit) => {
                    Fault::new(
                        "a line end",
                        "the end of the file; the last frame may be cut and is not used",
                    )
                }
                Ok(Line::Whole | Line::Unfinished) => {
                    let line = self.lines.text().trim_ascii();
                    match self.state.take_head(line) {
                        Ok(true) => continue,
                        Ok(false) => match parse(line, &mut self.state, &mut self.names) {
                            Ok(Some(frame)) => return Some(Ok(frame)),
                            Ok(None) => continue,
                            Err(fault) => fault,
                        },
                        Err(fault) => fault,
                    }
                }
            };
            return Some(Err(self.damage(fault)));
        }
        None
    }
}

#[cfg(test)]
mod tests;
