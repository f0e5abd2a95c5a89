//! [`survey`]: what a log of measured signals holds.

use std::cell::RefCell;
use std::path::Path;

use hmd_core::dbc::Dimension;
use hmd_core::log_map::{Doubt, Quantity};

use super::{IngestError, open_signals};
use crate::signals::Between;

/// Texts of one signal that are kept, and the characters of each.
const TEXTS_MAX: usize = 8;
const TEXT_LENGTH_MAX: usize = 40;

/// One signal of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct SurveyedSignal {
    /// Its name.
    pub name: String,
    /// Its unit, where the log has one.
    pub unit: Option<String>,
    /// The unit that its name ends with, or of a time that which gives a usual rate, where the log has none and the guess fits it.
    pub guessed_unit: Option<String>,
    /// Whether it is the log's own time.
    pub is_own_time: bool,
    /// Values that are numbers.
    pub values: u64,
    /// Values per second of the time of its group, where that is known.
    pub rate_hz: Option<f64>,
    /// Least and largest value; `None` without one.
    pub range: Option<[f64; 2]>,
    /// Largest difference of one value from the one before.
    pub jump: f64,
    /// The first values that are no numbers, each once.
    pub texts: Vec<String>,
    /// What it may be.
    pub guess: Option<Quantity>,
    /// What speaks against that: of several signals of one quantity that with the least is meant, else the first.
    pub doubt: Doubt,
    /// Whether another signal beside it has the same name.
    pub is_ambiguous: bool,
}

impl SurveyedSignal {
    /// Its unit: a guess replaces one of the log that is none.
    #[must_use]
    pub fn unit_or_guess(&self) -> Option<&str> {
        self.guessed_unit.as_deref().or(self.unit.as_deref())
    }
}

/// Pauses between recordings in one log: they say nothing of the rate.
#[derive(Default)]
struct Pauses {
    /// The first steps of the time, until they show which is usual.
    first: Vec<f64>,
    usual: Option<f64>,
    /// Time of all pauses, beyond a usual step each.
    sum: f64,
}

impl Pauses {
    /// Steps that show which is usual.
    const SHOWN: usize = 64;
    /// A step of so many usual ones is a pause.
    const LEAST: f64 = 50.0;

    fn add(&mut self, step: f64) {
        if step.is_nan() || step <= 0.0 {
            return;
        }
        match self.usual {
            Some(usual) if step > Self::LEAST * usual => self.sum += step - usual,
            Some(_) => {}
            None => {
                self.first.push(step);
                if self.first.len() == Self::SHOWN {
                    let mut sorted = self.first.clone();
                    sorted.sort_unstable_by(f64::total_cmp);
                    self.usual = Some(sorted[Self::SHOWN / 2]);
                    for step in std::mem::take(&mut self.first) {
                        self.add(step);
                    }
                }
            }
        }
    }
}

/// What a log holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Survey {
    /// Its signals.
    pub signals: Vec<SurveyedSignal>,
    /// Names of what it has in a form that is not read.
    pub not_read: Vec<String>,
}

/// Reads a log through.
///
/// # Errors
/// [`IngestError`] when it is no log of measured signals, or cannot be read at all.
pub fn survey(path: &Path) -> Result<Survey, IngestError> {
    let mut log = open_signals(path)?;
    let mut found: Vec<SurveyedSignal> = Vec::new();
    let has_own_time = log.signals().iter().any(|signal| signal.start_us.is_some());
    for signal in log.signals() {
        let is_own_time = signal.start_us.is_some();
        let guess = Quantity::guess(&signal.name, signal.unit.as_deref()).filter(|_| !is_own_time);
        let guess = guess.filter(|guess| guess.quantity != Quantity::Time || !has_own_time);
        let of_guess = guess.as_ref().map(|guess| guess.quantity);
        found.push(SurveyedSignal {
            name: signal.name.clone(),
            unit: signal.unit.clone(),
            is_own_time,
            values: 0,
            rate_hz: None,
            range: None,
            jump: 0.0,
            texts: Vec::new(),
            guess: of_guess.or(is_own_time.then_some(Quantity::Time)),
            doubt: guess.as_ref().map_or(Doubt::None, |guess| guess.doubt),
            is_ambiguous: false,
            guessed_unit: guess.and_then(|guess| guess.unit),
        });
    }
    for group in log.groups() {
        for &n in &group {
            found[n].is_ambiguous = group
                .iter()
                .filter(|&&other| found[other].name == found[n].name)
                .count()
                > 1;
        }
        let selected: Vec<_> = group.iter().map(|&n| (n, Between::Unknown)).collect();
        // What cannot be selected has no values.
        if log.select(&selected).is_err() {
            continue;
        }
        let mut row = vec![f64::NAN; group.len()];
        let mut before = row.clone();
        let times = group.iter().enumerate();
        let times = times.filter(|&(_, &n)| found[n].guess == Some(Quantity::Time));
        let time = times.min_by_key(|&(_, &n)| found[n].doubt).map(|(place, _)| place);
        let mut pauses = Pauses::default();
        let texts = RefCell::new(vec![Vec::new(); group.len()]);
        let keep = |place: usize, text: &str| {
            let kept: &mut Vec<String> = &mut texts.borrow_mut()[place];
            let text: String = text.chars().take(TEXT_LENGTH_MAX).collect();
            if kept.len() < TEXTS_MAX && !text.is_empty() && !kept.contains(&text) {
                kept.push(text);
            }
            None
        };
        while let Some(read) = log.next_row(&mut row, &keep) {
            if read.is_err() {
                continue;
            }
            if let Some(place) = time {
                pauses.add(row[place] - before[place]);
            }
            for ((&value, before), &n) in row.iter().zip(&mut before).zip(&group) {
                if !value.is_finite() {
                    continue;
                }
                let signal = &mut found[n];
                // Not a number before the first one.
                signal.jump = signal.jump.max((value - *before).abs());
                *before = value;
                let [least, largest] = signal.range.unwrap_or([value; 2]);
                signal.range = Some([least.min(value), largest.max(value)]);
                signal.values += 1;
            }
        }
        for (&n, texts) in group.iter().zip(texts.into_inner()) {
            found[n].texts = texts;
        }
        let time = time.and_then(|place| {
            let signal = &mut found[group[place]];
            let [first, last] = signal.range?;
            let span = last - first - pauses.sum;
            if signal.unit_or_guess().is_none() {
                signal.guessed_unit = unit_of_time(span / signal.values.saturating_sub(1) as f64);
            }
            Some(span * Dimension::Time.unit(signal.unit_or_guess()?)?.scale * 1e-6)
        });
        for &n in &group {
            let intervals = found[n].values.saturating_sub(1) as f64;
            found[n].rate_hz = time
                .map(|time_s| intervals / time_s)
                .filter(|rate| rate.is_finite() && found[n].values > 0);
        }
    }
    let not_read = log.not_read().to_vec();
    Ok(Survey {
        signals: found,
        not_read,
    })
}

/// The unit in which a step of the time gives a rate that a type may have; at most one does. Parts of a second alone have parts: a step of
/// 0.1 is 10 Hz, which is no such rate, and not 10 kHz.
fn unit_of_time(step: f64) -> Option<String> {
    /// Rates of samples, Hz (`sample_rate_hz`).
    const RATES: std::ops::RangeInclusive<f64> = 50.0..=20_000.0;
    let is_usual = |unit: &&str| {
        let to_us = Dimension::Time.unit(unit);
        to_us.is_some_and(|unit| RATES.contains(&(1e6 / (step * unit.scale))))
    };
    let found = ["s", "ms", "us", "ns"].into_iter().find(is_usual);
    found.filter(|unit| *unit == "s" || step >= 1.0).map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_without_unit_has_that_which_gives_a_usual_rate() {
        for (step, unit) in [
            (0.0025, Some("s")),
            (2.5, Some("ms")),
            (2500.0, Some("us")),
            (2.5e6, Some("ns")),
            (0.03, None),
            (0.05, None),
            (0.1, None),
            (0.0, None),
            (f64::NAN, None),
        ] {
            assert_eq!(unit_of_time(step).as_deref(), unit, "{step}");
        }
    }

    #[test]
    fn what_lies_between_recordings_is_no_part_of_the_rate() {
        let mut pauses = Pauses::default();
        // One pause before it is known which step is usual, one after.
        for n in 0..200 {
            pauses.add(if n == 10 || n == 150 { 19.0 } else { 0.001 });
        }
        assert!((pauses.sum - 2.0 * (19.0 - 0.001)).abs() < 1e-9, "{}", pauses.sum);
        pauses.add(f64::NAN);
        pauses.add(-100.0);
        pauses.add(0.04);
        assert!((pauses.sum - 2.0 * (19.0 - 0.001)).abs() < 1e-9, "{}", pauses.sum);
    }
}
