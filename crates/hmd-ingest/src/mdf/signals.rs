//! Channels of measured signals, each with the time of its group.
//!
//! The group of the first signal that is chosen gives the rows. What other groups hold is taken at the time of the row, to the
//! microsecond; between its values a command or a condition keeps the last one, and any other signal has none. Where a signal lies on the
//! line between its values, each time of any group gives a row, with what has a value then. Numbers of fixed length are read, with a
//! linear conversion or names beside them.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io::{self, Read, Seek, SeekFrom};
use std::rc::Rc;
use std::sync::Arc;

use super::block::Blocks;
use super::channel::{Channel, bits, names};
use super::layout::{self, Layout};
use super::records::Records;
use crate::damage::{Damage, Place};
use crate::signals::{Between, SignalInfo, SignalLog, TextValue, Unusable};

/// Most groups that are read beside each other: each holds a block.
const GROUPS_MAX: usize = 32;

/// Most that two times are apart that are the same, s: floats of seconds since 1970 have steps of 0.24 µs.
const SAME_TIME_S: f64 = 0.5e-6;

/// Reads the signals of a file.
#[derive(Debug)]
pub struct MdfSignals<R> {
    input: Shared<R>,
    file: Arc<str>,
    groups: Vec<(Arc<Layout>, layout::Data)>,
    signals: Vec<SignalInfo>,
    not_read: Vec<String>,
    /// Where each signal is.
    places: Vec<Origin>,
    /// Groups that are read; the first gives the rows.
    read: Vec<Group<R>>,
    selected: Vec<Selected>,
    /// Whether each time of any group gives a row.
    is_merged: bool,
    row: u64,
    /// Damage of another group, behind the row at which it was found.
    pending: Option<Damage>,
    ended: bool,
}

/// A channel by the indices of its data group and channel group, and the channel with its time.
#[derive(Debug, Clone, Copy)]
struct Origin {
    group: usize,
    format: usize,
    channel: usize,
    time: usize,
}

#[derive(Debug, Clone)]
struct Selected {
    /// Index of its group among those that are read.
    group: usize,
    /// Its value among those of the group; `None`: the time of the row.
    value: Option<usize>,
    between: Between,
    /// Names of its numbers, by their bits.
    names: BTreeMap<u64, String>,
}

/// One channel group that is read.
#[derive(Debug)]
struct Group<R> {
    blocks: Blocks<Shared<R>>,
    records: Records,
    layout: Arc<Layout>,
    format: usize,
    time: usize,
    channels: Vec<usize>,
    now: Option<Values>,
    next: Option<Values>,
    ended: bool,
}

/// Values of one record.
#[derive(Debug)]
struct Values {
    time_s: f64,
    values: Vec<f64>,
}

/// One input with several readers.
#[derive(Debug)]
struct Shared<R>(Rc<RefCell<R>>);

impl<R: Read> Read for Shared<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.borrow_mut().read(buffer)
    }
}

impl<R: Seek> Seek for Shared<R> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.0.borrow_mut().seek(to)
    }
}

impl<R> Clone for Shared<R> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<R: Read + Seek> MdfSignals<R> {
    /// A reader of `input`; `file` names it in errors.
    ///
    /// # Errors
    /// The head or the structure of the file cannot be read.
    pub fn new(input: R, file: &str) -> Result<Self, Unusable> {
        let input = Shared(Rc::new(RefCell::new(input)));
        let file: Arc<str> = file.into();
        let unusable = |damage: Damage| Unusable::new(damage.expected, damage.found);
        let mut blocks = Blocks::new(input.clone(), file.clone()).map_err(unusable)?;
        let groups = layout::read(&mut blocks, &mut Vec::new()).map_err(unusable)?;
        let (mut signals, mut not_read, mut places) = (Vec::new(), Vec::new(), Vec::new());
        for (g, (layout, _)) in groups.iter().enumerate() {
            for (f, format) in layout.formats.iter().enumerate() {
                let length = format.length.unwrap_or(0);
                let is_read = |of: &Channel| of.is_number() && of.is_linear && of.field.fits(length);
                let time = format.channels.iter().position(|of| of.is_time() && is_read(of));
                for (c, channel) in format.channels.iter().enumerate() {
                    let time = match time {
                        Some(time) if is_read(channel) => time,
                        _ => {
                            not_read.push(channel.name.clone());
                            continue;
                        }
                    };
                    if channel.is_time() && c != time {
                        continue;
                    }
                    let unit = blocks.text(channel.unit).unwrap_or_default();
                    let unit = if channel.is_time() { "s".to_owned() } else { unit };
                    signals.push(SignalInfo {
                        name: channel.name.clone(),
                        unit: (!unit.is_empty()).then_some(unit),
                        start_us: channel.is_time().then_some(layout.start_ns as f64 / 1e3),
                    });
                    places.push(Origin {
                        group: g,
                        format: f,
                        channel: c,
                        time,
                    });
                }
            }
        }
        Ok(Self {
            input,
            file,
            groups: groups
                .into_iter()
                .map(|(layout, data)| (Arc::new(layout), data))
                .collect(),
            signals,
            not_read,
            places,
            read: Vec::new(),
            selected: Vec::new(),
            is_merged: false,
            row: 0,
            pending: None,
            ended: false,
        })
    }

    fn group(&self, of: Origin) -> Result<Group<R>, Unusable> {
        let (layout, data) = &self.groups[of.group];
        let blocks = Blocks::new(self.input.clone(), self.file.clone());
        Ok(Group {
            blocks: blocks.map_err(|damage| Unusable::new(damage.expected, damage.found))?,
            records: Records::new(*data, layout),
            layout: layout.clone(),
            format: of.format,
            time: of.time,
            channels: Vec::new(),
            now: None,
            next: None,
            ended: false,
        })
    }
}

impl<R: Read + Seek + std::fmt::Debug> SignalLog for MdfSignals<R> {
    fn signals(&self) -> &[SignalInfo] {
        &self.signals
    }

    fn not_read(&self) -> &[String] {
        &self.not_read
    }

    fn groups(&self) -> Vec<Vec<usize>> {
        let mut groups: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
        for (n, of) in self.places.iter().enumerate() {
            groups.entry((of.group, of.format)).or_default().push(n);
        }
        groups.into_values().collect()
    }

    fn select(&mut self, signals: &[(usize, Between)]) -> Result<(), Unusable> {
        let is_time = |n: usize| self.signals[n].start_us.is_some();
        let base = signals.iter().map(|&(n, _)| n).find(|&n| !is_time(n));
        let mut read: Vec<Group<R>> = Vec::new();
        let mut known = BTreeMap::new();
        let mut selected = Vec::with_capacity(signals.len());
        for &(n, between) in base
            .iter()
            .map(|&n| (n, Between::Unknown))
            .collect::<Vec<_>>()
            .iter()
            .chain(signals)
        {
            let place = self.places[n];
            if is_time(n) {
                selected.push(Selected {
                    group: 0,
                    value: None,
                    between,
                    names: BTreeMap::new(),
                });
                continue;
            }
            let group = match known.get(&(place.group, place.format)) {
                Some(&group) => group,
                None if read.len() == GROUPS_MAX => {
                    return Err(Unusable::new("at most 32 groups of channels", "more"));
                }
                None => {
                    known.insert((place.group, place.format), read.len());
                    read.push(self.group(place)?);
                    read.len() - 1
                }
            };
            let of = &mut read[group];
            of.channels.push(place.channel);
            // Names that cannot be read are none: the numbers are there.
            let names = of.layout.formats[of.format].channels[place.channel]
                .names
                .map(|at| names(&mut of.blocks, at));
            selected.push(Selected {
                group,
                value: Some(of.channels.len() - 1),
                between,
                names: names.and_then(Result::ok).unwrap_or_default(),
            });
        }
        if base.is_some() {
            selected.remove(0);
        }
        (self.read, self.selected) = (read, selected);
        self.is_merged = signals
            .iter()
            .any(|(_, between)| matches!(between, Between::Curve { .. }));
        (self.row, self.pending, self.ended) = (0, None, false);
        Ok(())
    }

    fn next_row(&mut self, row: &mut [f64], text: TextValue<'_>) -> Option<Result<(), Damage>> {
        let read = if self.is_merged {
            self.next_merged(row)
        } else {
            self.next_of_base(row)
        };
        for (n, (value, selected)) in row.iter_mut().zip(&self.selected).enumerate() {
            if let Some(name) = selected.names.get(&bits(*value)) {
                *value = text(n, name).unwrap_or(*value);
            }
        }
        read
    }

    fn place(&self) -> Place {
        Place::Row(self.row)
    }

    fn position(&self) -> Option<u64> {
        self.read.first().map(|group| group.blocks.bytes_read())
    }
}

impl<R: Read + Seek> MdfSignals<R> {
    /// The row of the next record of the first group.
    fn next_of_base(&mut self, row: &mut [f64]) -> Option<Result<(), Damage>> {
        if let Some(damage) = self.pending.take() {
            return Some(Err(damage));
        }
        if self.ended {
            return None;
        }
        let (base, others) = self.read.split_first_mut()?;
        let now = match base.read() {
            Ok(Some(now)) => now,
            Ok(None) => {
                self.ended = true;
                return None;
            }
            Err(damage) => return Some(Err(damage)),
        };
        self.row += 1;
        for group in others {
            if let Err(damage) = group.read_to(now.time_s) {
                self.pending.get_or_insert(damage);
            }
        }
        for (value, selected) in row.iter_mut().zip(&self.selected) {
            *value = match (selected.group, selected.value) {
                (_, None) => now.time_s,
                (0, Some(n)) => now.values[n],
                (group, Some(n)) => self.read[group].value(n, selected.between, now.time_s),
            };
        }
        Some(Ok(()))
    }

    /// The row of the earliest time that any group has next: NaN where a signal has no value then.
    fn next_merged(&mut self, row: &mut [f64]) -> Option<Result<(), Damage>> {
        for group in &mut self.read {
            if group.next.is_none() {
                match group.read() {
                    Ok(next) => group.next = next,
                    Err(damage) => return Some(Err(damage)),
                }
            }
        }
        let times = self.read.iter().filter_map(|group| Some(group.next.as_ref()?.time_s));
        let time_s = times.min_by(f64::total_cmp)?;
        for group in &mut self.read {
            let is_now = |next: &mut Values| next.time_s.total_cmp(&(time_s + SAME_TIME_S)).is_le();
            group.now = group.next.take_if(is_now);
        }
        self.row += u64::from(self.read.first().is_some_and(|base| base.now.is_some()));
        for (value, selected) in row.iter_mut().zip(&self.selected) {
            let now = self.read[selected.group].now.as_ref();
            *value = match selected.value {
                None => time_s,
                Some(n) => now.map_or(f64::NAN, |now| now.values[n]),
            };
        }
        Some(Ok(()))
    }
}

impl<R: Read + Seek> Group<R> {
    /// Its next record; none after one that cannot be read. One without a time belongs to no row, and the next one follows.
    fn read(&mut self) -> Result<Option<Values>, Damage> {
        while !self.ended {
            let record = match self.records.next(&mut self.blocks) {
                Ok(Some(record)) => record,
                Ok(None) => {
                    self.ended = true;
                    break;
                }
                Err(damage) => {
                    self.ended = true;
                    return Err(damage);
                }
            };
            if record.format != self.format {
                continue;
            }
            let format = &self.layout.formats[self.format];
            let number = |n: usize| {
                let channel = &format.channels[n];
                let is_invalid = channel.invalid_bit.is_some_and(|bit| {
                    let byte = record.bytes.get(format.values + (bit / 8) as usize);
                    byte.is_some_and(|byte| byte >> (bit % 8) & 1 == 1)
                });
                if is_invalid || channel.all_invalid {
                    f64::NAN
                } else {
                    channel.field.number(record.bytes)
                }
            };
            let time_s = number(self.time);
            if !time_s.is_finite() {
                let damage = self
                    .blocks
                    .damage(record.at, "a record with a time", &time_s.to_string());
                return Err(damage.at(Place::Frame(record.at)));
            }
            return Ok(Some(Values {
                time_s,
                values: self.channels.iter().map(|&n| number(n)).collect(),
            }));
        }
        Ok(None)
    }

    /// Reads on to the last record that is not later.
    fn read_to(&mut self, time_s: f64) -> Result<(), Damage> {
        loop {
            if self.next.is_none() {
                self.next = self.read()?;
            }
            match self.next.take() {
                Some(next) if next.time_s <= time_s + SAME_TIME_S => self.now = Some(next),
                other => {
                    self.next = other;
                    return Ok(());
                }
            }
        }
    }

    fn value(&self, n: usize, between: Between, time_s: f64) -> f64 {
        let Some(now) = &self.now else { return f64::NAN };
        let is_same = (now.time_s - time_s).abs() <= SAME_TIME_S;
        if is_same || between == Between::Held {
            now.values[n]
        } else {
            f64::NAN
        }
    }
}
