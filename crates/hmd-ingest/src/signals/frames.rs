//! [`MappedFrames`]: rows of a log of measured signals -> frames of the built-in dictionary.

use std::collections::VecDeque;
use std::sync::Arc;

use ema_wire::can::FD_LEN;
use ema_wire::{ActuatorId, Frame, SampleFd};
use hmd_core::config::ActuatorConfig;
use hmd_core::frame::{BusNames, FrameFlags, RawFrame};
use hmd_core::log_map::{Column, LogMap, Quantity, Resampling, RowDecoder};

use super::log::{Between, Interpolated, SignalInfo, SignalLog, Unusable};
use super::resampled::{Base, Resampled};
use crate::damage::{Damage, Place};
use hmd_core::log_map::RotorFrame;

/// Dates and times that a text may have; a macro, because one of both texts ends with the other.
macro_rules! dates {
    () => {
        "a date and 24 hours, as 2026-11-20T14:00:00.5Z, 2026-11-20 14:00:00.5, 20.11.2026 14:00:00.5 or 2026/11/20 14:00:00.5"
    };
}
const DATES: &str = dates!();
const TIMES: &str = concat!("a number, or ", dates!());

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
                return Err(Unusable::new("a name that one column alone has", found));
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
        let (time, base) = (of(|quantity| *quantity == Quantity::Time), of(Quantity::is_current));
        let base = match (map.resampling(), time, base) {
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
        if let (Some(base), Some(time)) = (base, time) {
            let frame = match base {
                Base::Even { .. } => RotorFrame::new(&columns, &units, &actuator.params),
                Base::Column(_) => None,
            };
            log = Box::new(Resampled::new(log, &places, time, base).in_frame(frame));
        }
        let bus = actuator.bus.as_deref().unwrap_or(INTERFACE);
        let bus = names
            .intern(bus)
            .map_err(|cause| Unusable::new("an interface", format!("{bus}: {cause}")))?;
        let mut rows = VecDeque::with_capacity(FIRST_ROWS);
        while rows.len() < FIRST_ROWS {
            match next_row(&mut *log, &columns, map) {
                Some(row) => rows.push_back(row),
                None => break,
            }
        }
        let times = rows.iter().flatten().filter_map(|(_, row)| row.get(time?).copied());
        let times: Vec<f64> = times.collect();
        if !map.has(Quantity::Counter) && has_coarse_times(&times) {
            return Err(Unusable::new(
                "times that tell the rows apart, or a column for sample.counter",
                "the same time in many rows: its steps are longer than the rows' distance; the number of the row as sample.counter, with \
                 clock = \"receiver\" and the true sample_rate_hz, does without",
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

    /// What was interpolated, a sentence for each signal.
    pub fn remarks(&self) -> Vec<String> {
        let interpolated = self.log.interpolated();
        let made = interpolated.iter().zip(&self.columns).filter(|(of, _)| of.values > 0);
        let remark = |(of, column): (&Interpolated, &Column)| {
            let info = self.log.signals().iter().find(|signal| signal.name == column.signal);
            let of_log = info.and_then(|info| info.unit.as_deref());
            let unit = column.unit.as_deref().or(of_log).unwrap_or_default();
            let (file, key, values) = (&self.file, column.quantity.key(), of.values);
            let error = of.error * column.scale.abs();
            format!("{file}: {key}: {values} values interpolated, off by up to about {error:.1e} {unit}")
        };
        made.map(remark).collect()
    }

    fn decode(&mut self, place: Place, row: &[f64]) -> Result<(), Damage> {
        let damage = |expected, found| Damage {
            file: self.file.clone(),
            place,
            expected,
            found,
        };
        let decoded = self.decoder.push(row).map_err(|fault| {
            let quantity = fault.quantity();
            let column = self.columns.iter().find(|column| column.quantity == quantity);
            let name = column.map_or("", |column| column.signal.as_str());
            let mut values = self.columns.iter().zip(row);
            let has_no_time = quantity == Quantity::Time
                && values.any(|(column, value)| column.quantity == quantity && value.is_nan());
            damage(
                if has_no_time { TIMES } else { fault.expected() },
                format!("{} in column {name:?} ({})", fault.found(), quantity.key()),
            )
        })?;
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
}

impl Iterator for MappedFrames {
    type Item = Result<RawFrame, Damage>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(frame) = self.ready.pop_front() {
                return Some(Ok(frame));
            }
            let row = self.rows.pop_front();
            let decoded = match row.or_else(|| next_row(&mut *self.log, &self.columns, &self.map))? {
                Ok((place, row)) => self.decode(place, &row),
                Err(damage) => Err(damage),
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

fn next_row(log: &mut dyn SignalLog, columns: &[Column], map: &LogMap) -> Option<Result<(Place, Vec<f64>), Damage>> {
    let mut row = vec![f64::NAN; columns.len()];
    let text = |n: usize, text: &str| {
        let is_mode = columns.get(n).is_some_and(|column| column.quantity == Quantity::MODE);
        map.mode_code(text).filter(|_| is_mode)
    };
    let read = log.next_row(&mut row, &text)?;
    Some(read.map(|()| (log.place(), row)))
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
        (Quantity::Time, Some(own), Some(unit)) if own != unit => Err(Unusable::new(
            "no unit of the time in [map] other than the log's",
            format!("{unit:?} for {:?}, which counts in {own}", info.name),
        )),
        _ => Ok(()),
    }
}

/// The column of the log's own time.
fn own_time(log: &dyn SignalLog) -> Option<Column> {
    let own = log.signals().iter().find(|signal| signal.start_us.is_some());
    own.map(|signal| Column::plain(Quantity::Time, &signal.name))
}

fn missing(log: &dyn SignalLog, column: &Column) -> Unusable {
    let names: Vec<&str> = log.signals().iter().map(|signal| signal.name.as_str()).collect();
    let more = names.len().saturating_sub(OFFERED);
    let mut found = names[..names.len() - more].join(", ");
    if more > 0 {
        found.push_str(&format!(" and {more} more"));
    }
    Unusable::new(format!("signal {:?} ({})", column.signal, column.quantity.key()), found)
}

/// Repeated times among those of the first rows, as a share, from which on they number no samples: a recorder that repeats a row now and then
/// stays below.
const REPEATED_MAX: f64 = 0.25;

fn has_coarse_times(times: &[f64]) -> bool {
    let repeated = times
        .windows(2)
        .filter(|two| two[0].to_bits() == two[1].to_bits())
        .count();
    repeated as f64 > REPEATED_MAX * times.len() as f64
}
