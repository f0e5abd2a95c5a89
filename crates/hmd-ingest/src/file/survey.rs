//! [`survey`]: what a log of measured signals holds.

use std::path::Path;

use hmd_core::dbc::Dimension;
use hmd_core::log_map::Quantity;

use super::{IngestError, open_signals};
use crate::signals::Between;

/// One signal of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct SurveyedSignal {
    /// Its name.
    pub name: String,
    /// Its unit, where the log has one.
    pub unit: Option<String>,
    /// Whether it is the log's own time.
    pub is_own_time: bool,
    /// Values that are numbers.
    pub values: u64,
    /// Values per second of the time of its group, where that is known.
    pub rate_hz: Option<f64>,
    /// Least and largest value; `None` without one.
    pub range: Option<[f64; 2]>,
    /// What it may be; each quantity once.
    pub guess: Option<Quantity>,
}

/// Reads a log through.
///
/// # Errors
/// [`IngestError`] when it is no log of measured signals, or cannot be read at all.
pub fn survey(path: &Path) -> Result<Vec<SurveyedSignal>, IngestError> {
    let mut log = open_signals(path)?;
    let mut found: Vec<SurveyedSignal> = Vec::new();
    for signal in log.signals() {
        let is_own_time = signal.start_us.is_some();
        let guess = if is_own_time {
            Some(Quantity::Time)
        } else {
            Quantity::guess(&signal.name, signal.unit.as_deref())
        };
        let is_taken = |other: &SurveyedSignal| other.guess == guess;
        found.push(SurveyedSignal {
            name: signal.name.clone(),
            unit: signal.unit.clone(),
            is_own_time,
            values: 0,
            rate_hz: None,
            range: None,
            guess: guess.filter(|_| is_own_time || !found.iter().any(is_taken)),
        });
    }
    for group in log.groups() {
        let selected: Vec<_> = group.iter().map(|&n| (n, Between::Unknown)).collect();
        // What cannot be selected has no values.
        if log.select(&selected).is_err() {
            continue;
        }
        let mut row = vec![f64::NAN; group.len()];
        while let Some(read) = log.next_row(&mut row, &|_, _| None) {
            if read.is_err() {
                continue;
            }
            for (&value, &n) in row.iter().zip(&group).filter(|(value, _)| value.is_finite()) {
                let signal = &mut found[n];
                let [least, largest] = signal.range.unwrap_or([value; 2]);
                signal.range = Some([least.min(value), largest.max(value)]);
                signal.values += 1;
            }
        }
        let time = group
            .iter()
            .find(|&&n| found[n].guess == Some(Quantity::Time))
            .and_then(|&n| {
                let [first, last] = found[n].range?;
                let unit = found[n].unit.as_deref().unwrap_or("s");
                let to_us = Dimension::Time.unit(unit)?.scale;
                Some((last - first) * to_us * 1e-6)
            });
        for &n in &group {
            let intervals = found[n].values.saturating_sub(1) as f64;
            found[n].rate_hz = time.map(|time_s| intervals / time_s).filter(|rate| rate.is_finite());
        }
    }
    Ok(found)
}
