//! [`Rows`]: the frames of one drive that are its quantities -> one sample.
//!
//! A row is whole when it has every quantity of a sample; commands and conditions hold. The parts of a row are those whose stamps are
//! at most half a sample period apart: nothing counts them. A frame whose parts are all there already, or that comes later than that,
//! begins the next row; what the row before lacks makes its sample missing.

use ema_models::ActuatorParams;
use ema_wire::ActuatorId;

use super::layout::{Coding, DriveLayout, DriveMessage, MODE, Place, TIME, Target};
use super::moteus::{self, Registers};
use super::{DriveBus, vesc};
use crate::dbc::{DecodedUpdate, Role, Selector, Unit};
use crate::frame::RawFrame;
use crate::log_map::{Column, Quantity, RowDecoder};
use crate::sample::MeasuredConditions;

/// The row that is being collected.
#[derive(Clone, Debug)]
pub(super) struct Rows {
    decoder: RowDecoder,
    /// Most between two stamps of one row, ns.
    pub(super) span_ns: u64,
    row: Vec<f64>,
    /// Columns that a row needs, and those that the open one has, a bit each.
    pub(super) awaited: u64,
    filled: u64,
    /// Columns that any frame had, a bit each; and whether a row was ever whole.
    pub(super) heard: u64,
    pub(super) was_whole: bool,
    /// Whether any frame to or from the drive came.
    pub(super) was_addressed: bool,
    since_ns: u64,
    /// The command heard last; 0: none yet.
    commanded: i64,
    /// A command that holds from the next SYNC on: its column, value and mode.
    next: Option<(usize, f64, i64)>,
    /// What each state said last, in the order of the messages' fields.
    follows: Vec<bool>,
}

impl Rows {
    /// `None` until all of its quantities are known.
    pub(super) fn new(actuator: ActuatorId, bus: &DriveBus) -> Option<Self> {
        let (layout, params, map) = (&bus.layout, &bus.params, bus.map.as_ref().ok()?);
        let columns = layout.columns.iter().map(|column| {
            // Every column of a preset has a unit of its quantity.
            let unit = column.conversion(None, params).unwrap_or(Unit::SAME);
            (column.clone(), unit)
        });
        let is_awaited = layout.columns.iter().map(DriveLayout::is_awaited);
        let awaited = is_awaited.enumerate().map(|(n, awaited)| u64::from(awaited) << n);
        let states: usize = layout.messages.iter().map(DriveMessage::states).sum();
        Some(Self {
            decoder: RowDecoder::new(actuator, params, map.clone(), columns.collect(), 0.0, &[]),
            span_ns: span_ns(params),
            row: layout.columns.iter().map(initially).collect(),
            awaited: awaited.sum(),
            filled: 0,
            heard: 0,
            was_whole: false,
            was_addressed: false,
            since_ns: 0,
            commanded: 0,
            next: None,
            follows: vec![true; states],
        })
    }

    pub(super) fn take(
        &mut self,
        layout: &DriveLayout,
        message: &DriveMessage,
        first_state: usize,
        frame: &RawFrame,
    ) -> Option<DecodedUpdate> {
        let (data, mut state) = (frame.data(), first_state);
        let registers = match message.coding {
            Coding::Bits { length } if data.len() < length => return None,
            Coding::Bits { .. } => Registers::default(),
            Coding::Registers { written } => moteus::registers(data, written)?,
        };
        self.was_addressed = true;
        self.begin_row_of(message, &registers, frame);
        for field in &message.fields {
            let value = value_at(&field.place, data, &registers);
            match (&field.target, value) {
                (Target::State { mask, values }, value) => {
                    if let Some(value) = value {
                        self.follows[state] = values.contains(&((value as i64).cast_unsigned() & mask));
                    }
                    state += 1;
                }
                (_, None) => {}
                (Target::OtherCommand, Some(_)) => {
                    self.next = None;
                    self.commanded = 0;
                }
                (Target::Command(column, mode), Some(value)) => {
                    self.next = Some((*column, value, *mode));
                    if !message.synchronous {
                        self.synchronise();
                    }
                }
                (Target::Column(column), Some(value)) => self.set(layout, *column, value),
            }
        }
        self.whole_row()
    }

    /// The command that waits holds.
    pub(super) fn synchronise(&mut self) {
        let Some((column, value, mode)) = self.next.take() else {
            return;
        };
        // A command that is no number leaves it to the drive where it goes.
        if value.is_finite() {
            (self.row[column], self.commanded) = (value, mode);
        } else {
            self.commanded = 0;
        }
    }

    /// Adds the parts of a frame to those of the row, or begins the next with them.
    fn begin_row_of(&mut self, message: &DriveMessage, registers: &Registers, frame: &RawFrame) {
        let parts = message.fields.iter().filter_map(|field| match field.target {
            Target::Column(column) => value_at(&field.place, frame.data(), registers).map(|_| 1 << column),
            Target::Command(..) | Target::OtherCommand | Target::State { .. } => None,
        });
        let parts = parts.fold(0, |bits, bit| bits | bit) & self.awaited;
        if parts == 0 {
            return;
        }
        let is_over = frame.stamp_ns.abs_diff(self.since_ns) > self.span_ns;
        if self.filled == 0 || is_over || parts & !self.filled == 0 {
            (self.filled, self.since_ns) = (0, frame.stamp_ns);
        }
        self.filled |= parts;
        self.heard |= parts;
    }

    fn set(&mut self, layout: &DriveLayout, column: usize, value: f64) {
        // Without a sensor, drives report 0 °C to the bit.
        let is_temperature = layout.columns[column].quantity == Quantity::Of(Role::WindingTemp);
        let is_missing = is_temperature && value.abs() < f64::MIN_POSITIVE;
        self.row[column] = if is_missing { f64::NAN } else { value };
    }

    /// The sample, where the row is whole; `None` where a value of it is no number.
    fn whole_row(&mut self) -> Option<DecodedUpdate> {
        if self.filled != self.awaited {
            return Some(DecodedUpdate::default());
        }
        self.filled = 0;
        self.was_whole = true;
        self.row[TIME] = self.since_ns as f64 / 1e3;
        let follows = self.follows.iter().all(|&follows| follows);
        self.row[MODE] = if follows { self.commanded as f64 } else { 0.0 };
        let decoded = self.decoder.push(&self.row).ok()??;
        Some(DecodedUpdate {
            conditions: decoded.status.as_ref().map(MeasuredConditions::from),
            sample: Some((decoded.sample, decoded.stamp_ns)),
        })
    }
}

/// The value of a place in a frame with these registers; `None` where it is not in it.
fn value_at(place: &Place, data: &[u8], registers: &Registers) -> Option<f64> {
    match place {
        Place::Bits(signal) => signal.value(data),
        Place::Register(register) => registers.value(*register),
        Place::CurrentByPower { current, duty } => {
            let [current, duty] = [current, duty].map(|place| value_at(place, data, registers));
            Some(vesc::current_a(current?, duty?))
        }
    }
}

/// Half a sample period, ns.
fn span_ns(params: &ActuatorParams) -> u64 {
    (0.5e9 / params.sensors.sample_rate) as u64
}

/// A command or mode that was never heard is none; anything else is not known.
fn initially(column: &Column) -> f64 {
    if column.quantity.is_command() { 0.0 } else { f64::NAN }
}

impl DriveMessage {
    pub(super) fn is(&self, frame: &RawFrame) -> bool {
        let is_of_drive = |selector: &Selector| selector.selects(frame.data());
        self.has_identifier_of(frame) && self.selector.as_ref().is_none_or(is_of_drive)
    }

    pub(super) fn states(&self) -> usize {
        let states = self
            .fields
            .iter()
            .filter(|field| matches!(field.target, Target::State { .. }));
        states.count()
    }
}
