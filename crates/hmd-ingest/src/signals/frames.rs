//! [`MappedFrames`]: rows of a log of measured signals -> frames of the built-in dictionary.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::sync::Arc;

use ema_wire::can::FD_LEN;
use ema_wire::{ActuatorId, Frame, SampleFd};
use hmd_core::config::ActuatorConfig;
use hmd_core::dbc::Dimension;
use hmd_core::frame::{BusNames, FrameFlags, RawFrame};
use hmd_core::log_map::{Column, LogMap, Quantity, Resampling, RotorFrame, RowDecoder, RowFault};
use hmd_storage::quoted;

use super::log::{Between, Interpolated, SignalInfo, SignalLog, TextValue, Unusable};
use super::resampled::{Base, Resampled, STEPS_MAX};
use crate::damage::{Damage, Place};

/// Dates and times that a text may have; a macro, because one of both texts ends with the other.
macro_rules! dates {
    () => {
        "a date and 24 hours, as 2026-11-20T14:00:00.5Z, 2026-11-20 14:00:00.5, 20.11.2026 14:00:00.5 or 2026/11/20 14:00:00.5, or 14:00:00.5 alone"
    };
}
const DATES: &str = dates!();
const TIMES: &str = concat!("a number, or ", dates!());

/// Of a number that is not there, where signals of several rates are not interpolated.
const NUMBER: &str = "a number (resample = true in [map] takes signals of several rates)";

/// Rows that are looked at before the first is decoded: their times show the period.
const FIRST_ROWS: usize = 64;

/// Interface of an actuator that names none.
const INTERFACE: &str = "log";

/// Names that are offered for one that is not there.
const OFFERED: usize = 12;

/// Reads the rows of a log as frames of one actuator.
#[derive(Debug)]
pub struct MappedFrames {
    log: Box<dyn SignalLog>,
    file: Arc<str>,
    map: Arc<LogMap>,
    columns: Vec<Column>,
    decoder: RowDecoder,
    id: ActuatorId,
    bus: u16,
    names: BusNames,
    /// The first rows.
    rows: VecDeque<Result<(Place, Vec<f64>), Damage>>,
    ready: VecDeque<RawFrame>,
    /// Rows so far that are no samples, until there is one.
    without_sample: Option<u64>,
    mode: ModeForm,
}

/// In which form the values of the mode came, where texts are configured.
#[derive(Debug, Default)]
struct ModeForm {
    is_text: Cell<bool>,
    is_number: bool,
}

impl MappedFrames {
    /// The frames of `actuator` in `log`, which `file` names in errors; `names` is the table of interfaces to go on with.
    ///
    /// # Errors
    /// The log does not have what is mapped.
    pub fn new(
        mut log: Box<dyn SignalLog>,
        file: &str,
        actuator: &ActuatorConfig,
        map: &Arc<LogMap>,
        mut names: BusNames,
    ) -> Result<Self, Unusable> {
        let mut columns = map.columns().to_vec();
        match own_time(&*log) {
            // A log that has a time of its own needs no key for it.
            Some(own) => {
                columns.retain(|column| column.quantity != Quantity::Time);
                columns.push(own);
            }
            None if !map.has(Quantity::Time) => {
                return Err(Unusable::new("key time in [map]: the column of the time", "none"));
            }
            None => {}
        }
        let (mut places, mut units) = (Vec::new(), Vec::new());
        let mut start_us = 0.0;
        for column in &columns {
            let place = log.signals().iter().position(|signal| signal.name == column.signal);
            let Some(place) = place else {
                return Err(missing(&*log, column));
            };
            let info = &log.signals()[place];
            if is_ambiguous(&*log, column) {
                let found = format!("several {:?}", column.signal);
                return Err(Unusable::new(
                    "a name that one column alone has: rename the others in the file",
                    found,
                ));
            }
            refuse_other_unit_of_time(column, info)?;
            let unit = column.conversion(info.unit.as_deref(), &actuator.params);
            units.push(unit.map_err(|expected| {
                let unit = info
                    .unit
                    .as_deref()
                    .map_or("none".to_owned(), |unit| format!("{unit:?}"));
                let dates = if column.quantity == Quantity::Time {
                    format!("; or {DATES}")
                } else {
                    String::new()
                };
                Unusable::new(format!("{expected}{dates}"), format!("{unit} of {:?}", info.name))
            })?);
            if column.quantity == Quantity::Time {
                start_us = info.start_us.unwrap_or(0.0);
            }
            places.push((place, between(column, map)));
        }
        let of = |is: fn(&Quantity) -> bool| columns.iter().position(|column| is(&column.quantity));
        let (time, current) = (of(|quantity| *quantity == Quantity::Time), of(Quantity::is_current));
        let base = match (map.resampling(), time, current) {
            (Some(Resampling::AtCurrents), _, Some(base)) => {
                places[base].1 = Between::Unknown;
                Some(Base::Column(base))
            }
            (Some(Resampling::Even(hz)), Some(time), _) => Some(Base::Even {
                step: (1e6 / f64::from(hz) / units[time].scale).abs(),
            }),
            _ => None,
        };
        log.select(&places)?;
        let mode = ModeForm::default();
        if let (Some(base), Some(time)) = (base, time) {
            let frame = match base {
                Base::Even { .. } => RotorFrame::new(&columns, &units, &actuator.params),
                Base::Column(_) => None,
            };
            if let (true, Some(current)) = (frame.is_some(), current) {
                // To turn phase currents into that frame takes the angle at their own times.
                let mut at_currents = places.clone();
                at_currents[current].1 = Between::Unknown;
                log = Box::new(Resampled::new(log, &at_currents, time, Base::Column(current)));
            }
            let mut resampled = Resampled::new(log, &places, time, base).in_frame(frame);
            if let Base::Even { step } = base {
                let coarse = resampled.too_coarse(&|n, text| mode_code(&columns, map, &mode, n, text));
                let hz = |step: f64| 1e6 / (step * units[time].scale.abs());
                if let Some((n, own)) = coarse {
                    let (key, name) = (columns[n].quantity.key(), &columns[n].signal);
                    return Err(Unusable::new(
                        format!("resample_hz below {STEPS_MAX} times the rate of {name:?} ({key})"),
                        format!("{:.0}, where it has {:.1} Hz", hz(step), hz(own)),
                    ));
                }
            }
            log = Box::new(resampled);
        }
        let bus = actuator.bus.as_deref().unwrap_or(INTERFACE);
        let bus = names
            .intern(bus)
            .map_err(|cause| Unusable::new("an interface", format!("{bus}: {cause}")))?;
        let mut rows = VecDeque::with_capacity(FIRST_ROWS);
        let time_text = RefCell::new(None);
        let note_time = |n: usize, text: &str| {
            if Some(n) == time {
                time_text.borrow_mut().get_or_insert_with(|| text.to_owned());
            }
            mode_code(&columns, map, &mode, n, text)
        };
        while rows.len() < FIRST_ROWS {
            match next_row(&mut *log, columns.len(), &note_time) {
                Some(row) => rows.push_back(row),
                None => break,
            }
        }
        let samples = rows.iter().flatten().map(|(_, row)| row);
        let samples = samples.filter(|row| current.is_none_or(|place| row[place].is_finite()));
        let samples: Vec<&Vec<f64>> = samples.collect();
        let times: Vec<f64> = samples.iter().filter_map(|row| row.get(time?).copied()).collect();
        if let (Some(time), Some(text)) = (time, time_text.into_inner())
            && times.iter().all(|time| time.is_nan())
        {
            let (text, name) = (quoted(text.as_bytes()), &columns[time].signal);
            return Err(Unusable::new(TIMES, format!("\"{text}\" in column {name:?} (time)")));
        }
        let is_coarse = time.is_some_and(|time| has_coarse_times(&samples, time));
        if !map.has(Quantity::Counter) && is_coarse {
            return Err(Unusable::new(
                "times that tell the rows apart, or a column for sample.counter",
                format!("the same time in many rows: its steps are longer than the rows' distance; {NUMBER_OF_ROW}"),
            ));
        }
        if let (false, Some((double, of))) = (map.has(Quantity::Counter), double_steps(&times)) {
            return Err(Unusable::new(
                "times in even steps, or a column for sample.counter",
                format!(
                    "{double} of the first {of} steps twice as long as the others: times in whole steps that are little shorter than the rows' \
                     distance, or rows that are missing; {NUMBER_OF_ROW}"
                ),
            ));
        }
        let decoder = RowDecoder::new(
            actuator.id,
            &actuator.params,
            map.clone(),
            columns.iter().cloned().zip(units).collect(),
            start_us,
            &times,
        );
        Ok(Self {
            log,
            file: file.into(),
            map: map.clone(),
            columns,
            decoder,
            id: actuator.id,
            bus,
            names,
            rows,
            ready: VecDeque::new(),
            without_sample: Some(0),
            mode,
        })
    }

    /// The interfaces seen so far.
    pub fn bus_names(&self) -> &BusNames {
        &self.names
    }

    /// The table of interfaces, to go on with in the next log.
    pub fn into_bus_names(self) -> BusNames {
        self.names
    }

    /// How far it was read, bytes; `None` where the bytes of its input are counted.
    pub fn position(&self) -> Option<u64> {
        self.log.position()
    }

    /// What was interpolated, a sentence for each signal; and that a mode has numbers, where texts are configured.
    pub fn remarks(&self) -> Vec<String> {
        let interpolated = self.log.interpolated();
        let made = interpolated.iter().zip(&self.columns).filter(|(of, _)| of.values > 0);
        let remark = |(of, column): (&Interpolated, &Column)| {
            let info = self.log.signals().iter().find(|signal| signal.name == column.signal);
            let of_log = info.and_then(|info| info.unit.as_deref());
            let unit = column.unit.as_deref().or(of_log).unwrap_or_default();
            let (file, values) = (&self.file, of.values);
            let (key, error, unit) = match of.in_frame {
                Some(name) => (name, of.error, "A"),
                None => (column.quantity.key(), of.error * column.scale.abs(), unit),
            };
            format!("{file}: {key}: {values} values interpolated, off by up to about {error:.1e} {unit}")
        };
        let mut remarks: Vec<String> = made.map(remark).collect();
        if self.map.has_mode_names() && self.mode.is_number && !self.mode.is_text.get() {
            let (file, key, codes) = (&self.file, Quantity::MODE.key(), self.map.modes());
            let (position, speed) = (codes.position, codes.speed);
            remarks.push(format!(
                "{file}: {key}: expected the texts that [map] has, found numbers alone; {position} is taken for position, {speed} for speed"
            ));
        }
        remarks
    }

    fn decode(&mut self, place: Place, row: &[f64]) -> Result<(), Damage> {
        let damage = |expected, found| Damage {
            file: self.file.clone(),
            place,
            expected,
            found,
        };
        let mut modes = self.columns.iter().zip(row);
        self.mode.is_number |= modes.any(|(column, value)| column.quantity == Quantity::MODE && value.is_finite());
        let decoded = self.decoder.push(row).map_err(|fault| {
            let quantity = fault.quantity();
            let column = self.columns.iter().find(|column| column.quantity == quantity);
            let name = column.map_or("", |column| column.signal.as_str());
            let mut values = self.columns.iter().zip(row);
            let has_no_time = quantity == Quantity::Time
                && values.any(|(column, value)| column.quantity == quantity && value.is_nan());
            damage(
                match fault {
                    _ if has_no_time => TIMES,
                    RowFault::NoNumber(_) if self.map.resampling().is_none() => NUMBER,
                    _ => fault.expected(),
                },
                format!("{} in column {name:?} ({})", fault.found(), quantity.key()),
            )
        })?;
        let Some(decoded) = decoded else {
            self.without_sample = self.without_sample.map(|rows| rows + 1);
            return Ok(());
        };
        self.without_sample = None;
        let sample = SampleFd::from_samples(&[decoded.sample]);
        let sample = sample.map_err(|error| damage("a sample", error.to_string()))?;
        let status = decoded.status.map(Frame::Status);
        for frame in status.into_iter().chain([Frame::SampleFd(sample)]) {
            let mut buffer = [0; FD_LEN];
            let data = frame.emit(&mut buffer);
            let flags = FrameFlags::NONE.with(FrameFlags::FD, data.len() > ema_wire::can::CLASSIC_LEN);
            let id = u32::from(frame.message().id(self.id));
            let raw = RawFrame::new(decoded.stamp_ns, self.bus, id, flags, data);
            self.ready
                .push_back(raw.map_err(|error| damage("a frame", error.to_string()))?);
        }
        Ok(())
    }

    /// Why a log of rows alone that are no samples has none.
    fn no_sample(&mut self) -> Option<Damage> {
        let rows = self.without_sample.take().filter(|rows| *rows > 0)?;
        let current = self.columns.iter().find(|column| column.quantity.is_current())?;
        let (name, key) = (&current.signal, current.quantity.key());
        Some(Damage {
            file: self.file.clone(),
            place: self.log.place(),
            expected: "a number",
            found: format!("none in column {name:?} ({key}) of {rows} rows"),
        })
    }
}

impl Iterator for MappedFrames {
    type Item = Result<RawFrame, Damage>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(frame) = self.ready.pop_front() {
                return Some(Ok(frame));
            }
            let row = self.rows.pop_front();
            let text = |n: usize, text: &str| mode_code(&self.columns, &self.map, &self.mode, n, text);
            let row = row.or_else(|| next_row(&mut *self.log, self.columns.len(), &text));
            let decoded = match row {
                None => return self.no_sample().map(Err),
                Some(Ok((place, row))) => self.decode(place, &row),
                Some(Err(damage)) => Err(damage),
            };
            if let Err(damage) = decoded {
                return Some(Err(damage));
            }
        }
    }
}

fn between(column: &Column, map: &LogMap) -> Between {
    if column.quantity.is_held() {
        Between::Held
    } else if map.resampling().is_some() && column.quantity.is_continuous() {
        Between::Curve {
            wraps_after: column.wraps_after,
        }
    } else {
        Between::Unknown
    }
}

fn next_row(log: &mut dyn SignalLog, columns: usize, text: TextValue<'_>) -> Option<Result<(Place, Vec<f64>), Damage>> {
    let mut row = vec![f64::NAN; columns];
    let read = log.next_row(&mut row, text)?;
    Some(read.map(|()| (log.place(), row)))
}

/// The code of a text in a column: only the mode has texts.
fn mode_code(columns: &[Column], map: &LogMap, mode: &ModeForm, n: usize, text: &str) -> Option<f64> {
    let is_mode = columns.get(n).is_some_and(|column| column.quantity == Quantity::MODE);
    let code = map.mode_code(text).filter(|_| is_mode);
    mode.is_text.set(mode.is_text.get() || code.is_some());
    code
}

/// Whether several columns beside each other have the name; groups of MF4 may have it each.
fn is_ambiguous(log: &dyn SignalLog, column: &Column) -> bool {
    let is_named = |n: &&usize| log.signals()[**n].name == column.signal;
    log.groups()
        .iter()
        .any(|group| group.iter().filter(is_named).count() > 1)
}

/// A date, or a number of which the log says what it counts, is in no other unit.
fn refuse_other_unit_of_time(column: &Column, info: &SignalInfo) -> Result<(), Unusable> {
    match (column.quantity, &info.unit, &column.unit) {
        (Quantity::Time, Some(own), Some(unit)) if own != unit && Dimension::Time.unit(own).is_some() => {
            Err(Unusable::new(
                "no unit of the time in [map] other than the log's",
                format!("{unit:?} for {:?}, which counts in {own}", info.name),
            ))
        }
        _ => Ok(()),
    }
}

/// The column of the log's own time.
fn own_time(log: &dyn SignalLog) -> Option<Column> {
    let own = log.signals().iter().find(|signal| signal.start_us.is_some());
    own.map(|signal| Column::plain(Quantity::Time, &signal.name))
}

fn missing(log: &dyn SignalLog, column: &Column) -> Unusable {
    let expected = format!("signal {:?} ({})", column.signal, column.quantity.key());
    if log.not_read().contains(&column.signal) {
        return Unusable::new(expected, "it in a form that is not read (docs/logs.md)");
    }
    let names: Vec<&str> = log.signals().iter().map(|signal| signal.name.as_str()).collect();
    let more = names.len().saturating_sub(OFFERED);
    let mut found = names[..names.len() - more].join(", ");
    if more > 0 {
        found.push_str(&format!(" and {more} more"));
    }
    Unusable::new(expected, found)
}

/// What does without times.
const NUMBER_OF_ROW: &str =
    "the number of the row as sample.counter, with clock = \"receiver\" and the true sample_rate_hz, does without";

/// Rows with the time of the row before, as shares of the first rows, from which on times number no samples: of all such rows, and of those
/// that are other rows. A recorder that repeats a row now and then stays below, and so does an actuator at rest.
const REPEATED_MAX: f64 = 0.25;
const OTHER_MAX: f64 = 0.05;

fn has_coarse_times(rows: &[&Vec<f64>], time: usize) -> bool {
    let is_same = |a: f64, b: f64| a.to_bits() == b.to_bits();
    let repeated = || rows.windows(2).filter(|two| is_same(two[0][time], two[1][time]));
    let is_other = |two: &&[&Vec<f64>]| two[0].iter().zip(two[1]).any(|(a, b)| !is_same(*a, *b));
    let share = |count: usize| count as f64 / rows.len() as f64;
    share(repeated().count()) > REPEATED_MAX || share(repeated().filter(is_other).count()) > OTHER_MAX
}

/// Steps of times on a grid that are twice the usual one, and the number of all; `None` where they are rare, as losses are. Then no step
/// is near the rows' distance, and nobody knows what is lost. Of steps that differ by less, the mean serves.
fn double_steps(times: &[f64]) -> Option<(usize, usize)> {
    /// Their share, from which on they are not rare.
    const SHARE: f64 = 0.15;
    /// How far, in usual steps, a step of a grid is off a whole number of them.
    const OFF: f64 = 0.02;
    let steps = times.windows(2).map(|two| (two[1] - two[0]).abs());
    let mut steps: Vec<f64> = steps.filter(|step| step.is_finite() && *step > 0.0).collect();
    steps.sort_unstable_by(f64::total_cmp);
    let usual = *steps.get(steps.len() / 2)?;
    let is_on_grid = |step: &f64| (step / usual - f64::round(step / usual)).abs() < OFF;
    let double = steps
        .iter()
        .filter(|step| f64::round(*step / usual) as u64 == 2)
        .count();
    let is_often = double as f64 > SHARE * steps.len() as f64;
    (is_often && steps.iter().all(is_on_grid)).then_some((double, steps.len()))
}
