//! Tables as text: names in the first line, a row of values in each line after it.
//!
//! Separated by comma, semicolon or tab, whichever the first line has most of; beside the latter two, numbers may have a decimal comma.
//! Before the names, lines that begin with `#` and lines of one or two cells are passed over: `sep=;`, a name of the recorder. Names and
//! units that are no UTF-8 are Latin-1. A unit stands behind its name as `name [unit]`, or in a line of its own under
//! the names. A date and time (`2026-11-20T14:00:00.0005Z`, or without a zone, taken as UTC) counts as microseconds since 1970, a
//! time alone (`14:00:00.0005`) as those since midnight. Lines are at most
//! 64 KiB long, and no quoted value goes over several.

use std::cell::RefCell;
use std::fmt::Debug;
use std::io::BufRead;
use std::sync::Arc;

use csv_core::{ReadRecordResult, Reader, ReaderBuilder};
use hmd_storage::quoted;
use jiff::Timestamp;
use jiff::civil::DateTime;
use jiff::tz::TimeZone;

use super::log::{Between, SignalInfo, SignalLog, TextValue, Unusable, name_and_unit};
use crate::damage::{Damage, Place};
use crate::lines::{Line, Lines};

/// Longest line, bytes.
const MAX_LINE: usize = 1 << 16;

/// What some programs put before UTF-8 text.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Cells of a line before the names that is none of them: a log has at least three columns.
const PREAMBLE_CELLS: usize = 2;

/// Lines of remarks before the names.
const REMARKS_MAX: usize = 1000;

/// Reads a table from a text, line by line, in bounded memory.
#[derive(Debug)]
pub struct CsvLog<R> {
    lines: Lines<R>,
    file: Arc<str>,
    splitter: Splitter,
    signals: Vec<SignalInfo>,
    selected: Vec<(usize, Between)>,
    /// The line after the names, where it was read to tell them.
    after_names: Option<Vec<u8>>,
    /// The first line of values, where it is no line of units.
    first: Option<Vec<u8>>,
    /// Why that line cannot be read.
    pending: Option<Damage>,
    ended: bool,
}

/// What may stand between cells. Of as many of two kinds in a line the first kind counts.
const SEPARATORS: [u8; 3] = [b',', b';', b'\t'];

thread_local! {
    /// A reader for each of them. Nothing is kept in it from line to line, and making one takes longer than it takes to cut a line. A clone of one
    /// cuts nothing (csv-core 0.1.13 leaves half of the tables out).
    static READERS: RefCell<[Reader; SEPARATORS.len()]> =
        RefCell::new(SEPARATORS.map(|separator| ReaderBuilder::new().delimiter(separator).build()));
}

/// Cuts lines into cells.
#[derive(Debug)]
struct Splitter {
    /// Place of its separator in [`SEPARATORS`].
    kind: usize,
    text: Vec<u8>,
    ends: Vec<usize>,
}

impl<R: BufRead + Debug> CsvLog<R> {
    /// A reader of `input`; `file` names it in errors.
    ///
    /// # Errors
    /// There is no line of names.
    pub fn new(input: R, file: &str) -> Result<Self, Unusable> {
        let mut lines = Lines::new(input, MAX_LINE);
        let unreadable = |found: String| Unusable::new("names of columns in the first line", found);
        for _ in 0..REMARKS_MAX {
            match lines.read().map_err(|error| unreadable(error.to_string()))? {
                Line::None => return Err(unreadable("the end of the file".to_owned())),
                Line::TooLong(bytes) => return Err(unreadable(format!("a line of {bytes} bytes"))),
                Line::Whole | Line::Unfinished => {}
            }
            let line = lines.text().trim_ascii();
            if !line.is_empty() && line[0] != b'#' {
                break;
            }
        }
        let names = lines.text();
        let names = as_utf8(trim_line_end(names.strip_prefix(BYTE_ORDER_MARK).unwrap_or(names)));
        let mut log = Self {
            lines,
            file: file.into(),
            splitter: Splitter::of(&names),
            signals: Vec::new(),
            selected: Vec::new(),
            after_names: None,
            first: None,
            pending: None,
            ended: false,
        };
        let names = log.pass_preamble(names);
        log.signals = log.splitter.cells(&names).map(name_and_unit).collect();
        if log.signals.iter().all(|signal| number(&signal.name, b';').is_some()) {
            return Err(unreadable(format!("numbers alone: \"{}\"", quoted(&names))));
        }
        log.read_units();
        Ok(log)
    }

    /// The line of names, where the first line, which is not empty, may be one of a few words about the recording: those have one or two cells,
    /// and no row of as many values follows.
    fn pass_preamble(&mut self, first: Vec<u8>) -> Vec<u8> {
        let mut names = first;
        for _ in 0..REMARKS_MAX {
            self.splitter = Splitter::of(&names);
            let count = self.splitter.split(&names);
            if count > PREAMBLE_CELLS {
                return names;
            }
            match self.read_line() {
                Ok(true) => {}
                Ok(false) => return names,
                Err(damage) => {
                    self.pending = Some(damage);
                    return names;
                }
            }
            if self.lines.text().trim_ascii().starts_with(b"#") {
                continue;
            }
            let next = as_utf8(trim_line_end(self.lines.text()));
            let separator = self.splitter.separator();
            let is_row = self.splitter.split(&next) == count && {
                let first = self.splitter.cell(0);
                number(first, separator).is_some() || date_us(first).is_some()
            };
            if is_row {
                self.after_names = Some(next);
                return names;
            }
            names = next;
        }
        names
    }

    /// Takes the line after the names: units where none of its cells is a value, else the first values. Among units, 1 is that of a number
    /// without one.
    fn read_units(&mut self) {
        let separator = self.splitter.separator();
        let is_value = |cell: &&str| number(cell, separator).is_some() || date_us(cell).is_some();
        let is_one = |cell: &&str| unit_alone(cell) == "1";
        for _ in 0..2 {
            let line = match self.after_names.take() {
                Some(line) => line,
                None if self.pending.is_some() => return,
                None => match self.read_line() {
                    Ok(true) => as_utf8(trim_line_end(self.lines.text())),
                    Ok(false) => return,
                    Err(damage) => {
                        self.pending = Some(damage);
                        return;
                    }
                },
            };
            let cells: Vec<&str> = self.splitter.cells(&line).collect();
            let values = cells.iter().filter(|cell| is_value(cell) && !is_one(cell)).count();
            let ones = cells.iter().filter(|cell| is_one(cell)).count();
            let units = cells.iter().filter(|cell| !cell.is_empty() && !is_value(cell)).count();
            if values > 0 || units <= ones {
                for (signal, cell) in self.signals.iter_mut().zip(cells) {
                    if number(cell, separator).is_none() && date_us(cell).is_some() {
                        signal.unit = Some("us".to_owned());
                    }
                }
                self.first = Some(line);
                return;
            }
            let cells = cells.into_iter().map(unit_alone);
            let is_unit = |(_, cell): &(_, &str)| !matches!(*cell, "" | "1");
            for (signal, cell) in self.signals.iter_mut().zip(cells).filter(is_unit) {
                signal.unit = Some(cell.to_owned());
            }
        }
    }

    fn damage(&self, expected: &'static str, found: String) -> Damage {
        Damage {
            file: self.file.clone(),
            place: self.place(),
            expected,
            found,
        }
    }

    /// Reads the next line that is not empty; false at the end.
    fn read_line(&mut self) -> Result<bool, Damage> {
        loop {
            match self.lines.read() {
                Ok(Line::None) => return Ok(false),
                Ok(Line::TooLong(bytes)) => {
                    return Err(self.damage("at most 65536 bytes in a line", bytes.to_string()));
                }
                Ok(Line::Unfinished) => {
                    let found = "the end of the file; the last row may be cut and is not used".to_owned();
                    return Err(self.damage("a line end", found));
                }
                Ok(Line::Whole) => {
                    if !self.lines.text().trim_ascii().is_empty() {
                        return Ok(true);
                    }
                }
                Err(error) => {
                    self.ended = true;
                    return Err(self.damage("to read on", error.to_string()));
                }
            }
        }
    }
}

impl<R: BufRead + Debug> SignalLog for CsvLog<R> {
    fn signals(&self) -> &[SignalInfo] {
        &self.signals
    }

    fn select(&mut self, signals: &[(usize, Between)]) -> Result<(), Unusable> {
        self.selected = signals.to_vec();
        Ok(())
    }

    fn next_row(&mut self, row: &mut [f64], text: TextValue<'_>) -> Option<Result<(), Damage>> {
        if let Some(damage) = self.pending.take() {
            return Some(Err(damage));
        }
        if self.ended {
            return None;
        }
        let first = self.first.take();
        if first.is_none() {
            match self.read_line() {
                Ok(true) => {}
                Ok(false) => {
                    self.ended = true;
                    return None;
                }
                Err(damage) => return Some(Err(damage)),
            }
        }
        let line = first.as_deref().unwrap_or_else(|| trim_line_end(self.lines.text()));
        let (separator, count) = (self.splitter.separator(), self.signals.len());
        let found = self.splitter.split(line);
        if found != count {
            let found = format!("{found} cells, where there are {count} names");
            return Some(Err(self.damage("a cell for each name", found)));
        }
        for (n, (value, &(column, between))) in row.iter_mut().zip(&self.selected).enumerate() {
            let cell = self.splitter.cell(column);
            let read = number(cell, separator)
                .or_else(|| text(n, cell))
                .or_else(|| date_us(cell));
            if read.is_none() && between != Between::Held && is_spoilt(cell) {
                let found = format!(
                    "\"{}\" in column {:?}",
                    quoted(cell.as_bytes()),
                    self.signals[column].name
                );
                return Some(Err(self.damage("a number", found)));
            }
            *value = read.unwrap_or(f64::NAN);
        }
        Some(Ok(()))
    }

    fn place(&self) -> Place {
        Place::Line(self.lines.number())
    }
}

impl Splitter {
    /// For a text whose first line is this one.
    fn of(names: &[u8]) -> Self {
        let count = |of: u8| names.iter().filter(|&&byte| byte == of).count();
        let kind = (1..SEPARATORS.len()).fold(0, |most, of| {
            if count(SEPARATORS[of]) > count(SEPARATORS[most]) {
                of
            } else {
                most
            }
        });
        Self {
            kind,
            text: Vec::new(),
            ends: Vec::new(),
        }
    }

    fn separator(&self) -> u8 {
        SEPARATORS[self.kind]
    }

    /// Cuts a line; how many cells it has. More than a line can have are not cut.
    fn split(&mut self, line: &[u8]) -> usize {
        // A cell takes a separator, but the last; no cell is longer than its line.
        let most = line.len() + 2;
        if self.text.len() < most {
            self.text.resize(most, 0);
            self.ends.resize(most, 0);
        }
        READERS.with_borrow_mut(|readers| {
            let reader = &mut readers[self.kind];
            reader.reset();
            let (mut read, mut text, mut cells) = (0, 0, 0);
            loop {
                let (result, used, written, ended) =
                    reader.read_record(&line[read..], &mut self.text[text..], &mut self.ends[cells..]);
                read += used;
                text += written;
                cells += ended;
                match result {
                    ReadRecordResult::InputEmpty => {}
                    ReadRecordResult::OutputFull | ReadRecordResult::OutputEndsFull => return 0,
                    ReadRecordResult::Record | ReadRecordResult::End => return cells,
                }
            }
        })
    }

    /// A cell of the line cut last; empty where it is no UTF-8.
    fn cell(&self, n: usize) -> &str {
        let start = if n == 0 { 0 } else { self.ends[n - 1] };
        let bytes = self.text.get(start..self.ends[n]).unwrap_or_default();
        std::str::from_utf8(bytes).unwrap_or_default().trim()
    }

    fn cells(&mut self, line: &[u8]) -> impl Iterator<Item = &str> {
        let count = self.split(line);
        (0..count).map(|n| self.cell(n))
    }
}

fn trim_line_end(line: &[u8]) -> &[u8] {
    line.strip_suffix(b"\r").unwrap_or(line)
}

/// A line of names or units; one that is no UTF-8 is Latin-1, whose bytes are the first 256 characters.
fn as_utf8(line: &[u8]) -> Vec<u8> {
    match std::str::from_utf8(line) {
        Ok(_) => line.to_vec(),
        Err(_) => line.iter().copied().map(char::from).collect::<String>().into_bytes(),
    }
}

fn unit_alone(cell: &str) -> &str {
    let inside = cell.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
    inside.unwrap_or(cell).trim()
}

/// A number; a decimal comma where the comma does not separate.
fn number(cell: &str, separator: u8) -> Option<f64> {
    match cell.parse::<f64>() {
        Ok(number) => Some(number),
        Err(_) if separator != b',' && cell.contains(',') => cell.replacen(',', ".", 1).parse().ok(),
        Err(_) if cell.is_empty() => None,
        Err(_) if cell.eq_ignore_ascii_case("true") => Some(1.0),
        Err(_) if cell.eq_ignore_ascii_case("false") => Some(0.0),
        Err(_) => None,
    }
}

/// Whether a cell that cannot be read was a number: it has a digit. Words (`null`, `n/a`) and signs stand for none; what has a colon is a time.
fn is_spoilt(cell: &str) -> bool {
    cell.bytes().any(|byte| byte.is_ascii_digit()) && !cell.contains(':')
}

/// A date as `20.11.2026 14:00:00.5` or `2026/11/20 14:00:00.5`. With slashes and the year last, nobody knows which is the month.
fn day_first(cell: &str) -> Option<DateTime> {
    let (date, time) = cell.split_once([' ', 'T'])?;
    let parts = |by: char| {
        let mut parts = date.split(by);
        let three = [parts.next()?, parts.next()?, parts.next()?];
        parts.next().is_none().then_some(three)
    };
    let [year, month, day] = match parts('.') {
        Some([day, month, year]) => [year, month, day],
        None => parts('/').filter(|[year, ..]| year.len() == 4)?,
    };
    format!("{year:0>4}-{month:0>2}-{day:0>2}T{}", time.trim()).parse().ok()
}

/// A time without a date, as `22:13:20.5`, or `0:00:20,5` of one that has run so long, µs since it began.
fn time_of_day_us(cell: &str) -> Option<f64> {
    let mut parts = cell.split(':');
    let [hours, minutes, seconds] = [parts.next()?, parts.next()?, parts.next()?];
    let whole = |part: &str| {
        part.bytes()
            .all(|byte| byte.is_ascii_digit())
            .then(|| part.parse::<u16>().ok())?
    };
    let seconds = seconds.replace(',', ".");
    let is_plain = seconds.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.');
    let seconds: f64 = is_plain.then(|| seconds.parse().ok())??;
    let (hours, minutes) = (whole(hours)?, whole(minutes)?);
    let is_one = parts.next().is_none() && minutes < 60 && seconds < 60.0;
    is_one.then(|| 1e6 * ((f64::from(hours) * 60.0 + f64::from(minutes)) * 60.0 + seconds))
}

/// A date and time, µs since 1970; a time alone, since it began.
fn date_us(cell: &str) -> Option<f64> {
    if !cell.as_bytes().first()?.is_ascii_digit() || !cell.contains(':') {
        return None;
    }
    if let Some(time) = time_of_day_us(cell) {
        return Some(time);
    }
    let stamp = match cell.parse::<Timestamp>() {
        Ok(stamp) => stamp,
        Err(_) => {
            let civil = cell.parse().ok().or_else(|| day_first(cell))?;
            TimeZone::UTC.to_timestamp(civil).ok()?
        }
    };
    Some(stamp.as_nanosecond() as f64 / 1e3)
}

#[cfg(test)]
mod tests;
