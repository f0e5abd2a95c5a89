//! Lines of a text in bounded memory.

use std::io::{self, BufRead};

/// Reads a text line by line; of a line, no more than `max` bytes are held.
#[derive(Debug)]
pub(crate) struct Lines<R> {
    input: R,
    max: usize,
    number: u64,
    buffer: Vec<u8>,
}

/// How a line ended; its text without that end is [`Lines::text`].
pub(crate) enum Line {
    /// There is none: the text has ended.
    None,
    /// With a line end.
    Whole,
    /// With the end of the text.
    Unfinished,
    /// It has this many bytes, more than are held.
    TooLong(u64),
}

impl<R: BufRead> Lines<R> {
    pub(crate) fn new(input: R, max: usize) -> Self {
        Self {
            input,
            max,
            number: 0,
            buffer: Vec::with_capacity(max + 1),
        }
    }

    /// Number of the line read last, from 1.
    pub(crate) fn number(&self) -> u64 {
        self.number
    }

    /// The line read last.
    pub(crate) fn text(&self) -> &[u8] {
        &self.buffer
    }

    /// Reads the next line.
    ///
    /// # Errors
    /// What the system says; the line is counted.
    pub(crate) fn read(&mut self) -> io::Result<Line> {
        let line = self.read_into_buffer();
        self.number += u64::from(!matches!(line, Ok(Line::None)));
        line
    }

    fn read_into_buffer(&mut self) -> io::Result<Line> {
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
                    _ if length > self.max as u64 => Line::TooLong(length),
                    _ => Line::Unfinished,
                });
            }
            let end = block.iter().position(|&byte| byte == b'\n');
            let part = &block[..end.unwrap_or(block.len())];
            let room = self.max.saturating_sub(self.buffer.len());
            self.buffer.extend_from_slice(&part[..part.len().min(room)]);
            length += part.len() as u64;
            let used = part.len() + usize::from(end.is_some());
            self.input.consume(used);
            if end.is_some() {
                return Ok(if length > self.max as u64 {
                    Line::TooLong(length)
                } else {
                    Line::Whole
                });
            }
        }
    }
}
