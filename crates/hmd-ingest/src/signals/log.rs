//! [`SignalLog`]: one log of measured signals.

use std::fmt::Debug;

use thiserror::Error;

use crate::damage::{Damage, Place};

/// Value of a text in a selected signal, by its place in the selection.
pub type TextValue<'a> = &'a dyn Fn(usize, &str) -> Option<f64>;

/// One signal.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SignalInfo {
    /// Its name.
    pub name: String,
    /// Its unit, where the log has one.
    pub unit: Option<String>,
    /// Of the log's own time: where it starts, UTC, µs.
    pub start_us: Option<f64>,
}

/// Why a log of measured signals cannot be used at all. Displays as what is expected and found, without the file.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("expected {expected}, found {found}")]
pub struct Unusable {
    /// What is expected.
    pub expected: String,
    /// What is there.
    pub found: String,
}

impl Unusable {
    pub(crate) fn new(expected: impl Into<String>, found: impl ToString) -> Self {
        Self {
            expected: expected.into(),
            found: found.to_string(),
        }
    }
}

/// What a signal has between its values, where others have one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Between {
    /// The last one holds: a command, a condition.
    Held,
    /// It is not known.
    Unknown,
    /// It lies on a smooth curve through them. A log with such a signal gives a row at each time at which any signal has a value.
    Curve {
        /// Of an angle: the difference after which it begins again.
        wraps_after: Option<f64>,
    },
}

/// Values of one signal that were interpolated.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Interpolated {
    /// Their number.
    pub values: u64,
    /// About the most that they are off, in the numbers of the log.
    pub error: f64,
    /// The current of the rotor's frame that was interpolated in place of a phase current, A.
    pub in_frame: Option<&'static str>,
}

/// One log of measured signals, row by row.
pub trait SignalLog: Debug {
    /// Its signals.
    fn signals(&self) -> &[SignalInfo];

    /// Names of what the log has besides, in a form that is not read.
    fn not_read(&self) -> &[String] {
        &[]
    }

    /// Chooses signals by their place in [`SignalLog::signals`]; each row has them in this order. The first but the time gives the rows.
    ///
    /// # Errors
    /// They cannot be read, or not beside each other.
    fn select(&mut self, signals: &[(usize, Between)]) -> Result<(), Unusable>;

    /// Signals that have their values at the same times, by their place; each list can be selected.
    fn groups(&self) -> Vec<Vec<usize>> {
        vec![(0..self.signals().len()).collect()]
    }

    /// Puts the next row into `row`, NaN where it has no number; `text` gives the value of what is no number. `None` at the end.
    fn next_row(&mut self, row: &mut [f64], text: TextValue<'_>) -> Option<Result<(), Damage>>;

    /// Where the row read last is.
    fn place(&self) -> Place;

    /// How far it was read, bytes; `None` where the bytes of its input are counted.
    fn position(&self) -> Option<u64> {
        None
    }

    /// What was interpolated so far, of each signal in the order of the selection; empty where nothing is.
    fn interpolated(&self) -> Vec<Interpolated> {
        Vec::new()
    }
}

/// A name and, in brackets behind it, its unit.
pub(crate) fn name_and_unit(cell: &str) -> SignalInfo {
    let ends = [('[', ']'), ('(', ')')];
    let cut = ends.into_iter().find_map(|(open, close)| {
        let (name, unit) = cell.strip_suffix(close)?.rsplit_once(open)?;
        Some((name.trim(), unit.trim()))
    });
    match cut {
        Some((name, unit)) if !name.is_empty() && !unit.is_empty() => SignalInfo {
            name: name.to_owned(),
            unit: Some(unit.to_owned()),
            start_us: None,
        },
        _ => SignalInfo {
            name: cell.to_owned(),
            ..SignalInfo::default()
        },
    }
}
