//! [`DriveLayout`]: the frames of a drive, and which quantity each value in them is.

use ema_models::ActuatorParams;
use serde::Serialize;

use super::DriveSettings;
use crate::dbc::{Layout, ModeCodes, Role, Selector, Signal, SignalKind};
use crate::log_map::{Clock, Column, LogMap, LogMisfit, ModeNames, Quantity};

/// The frames of one drive as rows of a log: a column for each quantity, the time first and the mode second.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DriveLayout {
    /// Quantities.
    pub columns: Vec<Column>,
    /// Frames that are used.
    pub messages: Vec<DriveMessage>,
}

/// One frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DriveMessage {
    /// Its name in the drive's own documents.
    pub name: String,
    /// Identifier.
    pub id: u32,
    /// Bits of it that count.
    pub mask: u32,
    /// Whether the identifier has 29 bits; `None`: either.
    pub extended: Option<bool>,
    /// Where several drives send this identifier: what tells those of this one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub selector: Option<Selector>,
    /// Whether its commands hold from the next SYNC on.
    pub synchronous: bool,
    /// How its bytes are read.
    pub coding: Coding,
    /// What is in it.
    pub fields: Vec<Field>,
}

/// How the bytes of a frame are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Coding {
    /// Each value has its bits; a shorter frame is malformed.
    Bits {
        /// Bytes that it has at least.
        length: usize,
    },
    /// Subframes of registers: those that are replied to, or written.
    Registers {
        /// Written ones.
        written: bool,
    },
}

/// A value in a frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Field {
    /// Where it is.
    pub place: Place,
    /// What it is.
    pub target: Target,
}

/// Where a value is.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// In these bits.
    Bits(Signal),
    /// In this register.
    Register(u32),
    /// The length of the current vector, positive where power is drawn, and a duty cycle with the sign of v_q: i_q by both.
    CurrentByPower {
        /// The current, in steps.
        current: Box<Place>,
        /// The duty cycle.
        duty: Box<Place>,
    },
}

/// What a value is.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Target {
    /// A quantity, by its column.
    Column(usize),
    /// A command, by its column; it makes the mode.
    Command(usize, i64),
    /// A command of something else, which ends the set point.
    OtherCommand,
    /// A state that follows the set point only at these values, of the bits that count.
    State {
        /// Bits that count.
        mask: u64,
        /// Values with which it does.
        values: Vec<u64>,
    },
}

/// Columns that every drive has: its time and its mode.
pub(super) const TIME: usize = 0;
pub(super) const MODE: usize = 1;

impl DriveLayout {
    /// Without any frame.
    pub(super) fn new() -> Self {
        let mut layout = Self {
            columns: Vec::new(),
            messages: Vec::new(),
        };
        layout.column(Quantity::Time, "stamp", Some("us"), 1.0);
        layout.column(Quantity::MODE, "mode", None, 1.0);
        layout
    }

    /// Adds a quantity; its column.
    pub(super) fn column(&mut self, quantity: Quantity, signal: &str, unit: Option<&str>, scale: f64) -> usize {
        self.columns.push(Column {
            unit: unit.map(str::to_owned),
            scale,
            ..Column::plain(quantity, signal)
        });
        self.columns.len() - 1
    }

    /// Adds a frame.
    pub(super) fn message(&mut self, name: &str, id: u32, extended: Option<bool>, coding: Coding, fields: Vec<Field>) {
        self.messages.push(DriveMessage {
            name: name.to_owned(),
            id,
            mask: u32::MAX,
            extended,
            selector: None,
            synchronous: false,
            coding,
            fields,
        });
    }

    /// Its quantities as those of a log.
    pub(super) fn log_map(&self) -> Result<LogMap, LogMisfit> {
        let (modes, names) = (ModeCodes::default(), ModeNames::default());
        LogMap::new(self.columns.clone(), Clock::Receiver, modes, names)
    }

    /// Whether a row needs this column to be whole.
    pub(super) fn is_awaited(column: &Column) -> bool {
        column.quantity != Quantity::Time && !column.quantity.is_held()
    }

    /// Messages with parts of a sample, which come once in each.
    pub fn sampled(&self) -> impl Iterator<Item = &DriveMessage> {
        self.messages.iter().filter(|message| {
            message.fields.iter().any(|field| match field.target {
                Target::Column(column) => Self::is_awaited(&self.columns[column]),
                Target::Command(..) | Target::OtherCommand | Target::State { .. } => false,
            })
        })
    }
}

impl Field {
    pub(super) fn column(place: Place, column: usize) -> Self {
        let target = Target::Column(column);
        Self { place, target }
    }

    pub(super) fn command(place: Place, column: usize, mode: i64) -> Self {
        let target = Target::Command(column, mode);
        Self { place, target }
    }

    pub(super) fn other_command(place: Place) -> Self {
        let target = Target::OtherCommand;
        Self { place, target }
    }

    pub(super) fn state(place: Place, mask: u64, values: &[u64]) -> Self {
        let values = values.to_vec();
        Self {
            place,
            target: Target::State { mask, values },
        }
    }
}

impl Place {
    /// The least and the largest value of a whole number of fixed size, in the signal's unit.
    pub(super) fn ends(&self) -> Option<[f64; 2]> {
        let Self::Bits(signal) = self else { return None };
        let numbers = f64::powi(2.0, i32::from(signal.layout.size));
        let raw = match signal.kind {
            SignalKind::Unsigned => [0.0, numbers - 1.0],
            SignalKind::Signed => [-0.5 * numbers, 0.5 * numbers - 1.0],
            SignalKind::F32 | SignalKind::F64 => return None,
        };
        Some(raw.map(|raw| raw * signal.factor + signal.offset))
    }

    /// Step of a whole number of fixed size, in the signal's unit.
    pub(super) fn step(&self) -> Option<f64> {
        match self {
            Self::Bits(signal) if matches!(signal.kind, SignalKind::Unsigned | SignalKind::Signed) => {
                Some(signal.factor)
            }
            Self::CurrentByPower { current, .. } => current.step(),
            Self::Bits(_) | Self::Register(_) => None,
        }
    }

    /// A number of so many bits from a bit on, the least significant first.
    pub(super) fn bits(kind: SignalKind, start: u16, size: u16) -> Self {
        Self::Bits(Signal {
            layout: Layout {
                start,
                size,
                big_endian: false,
            },
            kind,
            factor: 1.0,
            offset: 0.0,
            selectors: Vec::new(),
        })
    }

    /// A number of so many bits from a byte on, the most significant byte first.
    pub(super) fn big_endian(kind: SignalKind, byte: u16, size: u16) -> Self {
        Self::Bits(Signal {
            layout: Layout {
                start: 8 * byte + 7,
                size,
                big_endian: true,
            },
            kind,
            factor: 1.0,
            offset: 0.0,
            selectors: Vec::new(),
        })
    }

    /// A float of 32 bits from a byte on.
    pub(super) fn f32_at(byte: u16) -> Self {
        Self::bits(SignalKind::F32, 8 * byte, 32)
    }
}

/// Columns of motor, output and commands of a drive that gives its position in turns or steps of the motor.
pub(super) struct Angles {
    pub(super) motor: usize,
    pub(super) output: Option<usize>,
    pub(super) position: Option<usize>,
}

impl Angles {
    /// Adds them, with so many steps of the motor and of the output in a turn; a position command has the steps of the motor.
    pub(super) fn add(
        layout: &mut DriveLayout,
        settings: &DriveSettings,
        params: &ActuatorParams,
        names: [&str; 3],
        steps: (f64, f64),
    ) -> Self {
        let (motor_steps, output_steps) = steps;
        let of = Quantity::Of;
        let motor = layout.column(of(Role::MotorPosition), names[0], Some("rev"), 1.0 / motor_steps);
        let output = settings
            .output_encoder
            .map(|_| layout.column(of(Role::OutputPosition), names[1], Some("rev"), 1.0 / output_steps));
        let at_output = 1.0 / (motor_steps * params.transmission.gear_ratio);
        let position = settings
            .uses_commands
            .then(|| layout.column(of(Role::CommandPosition), names[2], Some("rev"), at_output));
        Self {
            motor,
            output,
            position,
        }
    }
}
