//! [`LogMap`]: which columns of a log of measured signals are the quantities of one actuator, and what comes of those that are missing.
//!
//! A log of measured signals (CSV, Parquet, channels of MF4) has values over time instead of frames. Its rows become the samples that
//! the built-in dictionary has ([`RowDecoder`]), so that everything behind them is the same. How to write a map: `docs/logs.md`.

mod gap;
mod guess;
mod rotor_frame;
mod rows;

pub use gap::Gap;
pub use guess::{Doubt, Guess};
pub use rotor_frame::RotorFrame;
pub use rows::{Decoded, RowDecoder, RowFault};

use ema_models::ActuatorParams;
use serde::Serialize;

use crate::dbc::{Dimension, ModeCodes, Role, Unit};

/// What a column of a log is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Time of the row.
    Time,
    /// Counts samples, wraps after 2^16 or later.
    Counter,
    /// Current along the rotor's north pole.
    CurrentD,
    /// Torque-producing current.
    CurrentQ,
    /// What a mapped bus has as well.
    #[serde(untagged)]
    Of(Role),
}

impl Quantity {
    /// What is commanded.
    pub const MODE: Self = Self::Of(Role::Mode);

    /// Its key in section `[map]`.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Self::Time => "time",
            Self::Counter => "sample.counter",
            Self::CurrentD => "currents.d",
            Self::CurrentQ => "currents.q",
            Self::Of(role) => role.key(),
        }
    }

    /// All of them, the time first.
    pub fn all() -> impl Iterator<Item = Self> {
        let own = [Self::Time, Self::Counter, Self::CurrentD, Self::CurrentQ];
        own.into_iter().chain(Role::ALL.map(|(role, _)| Self::Of(role)))
    }

    /// What kind of quantity it is, for the sensors of an actuator.
    #[must_use]
    pub fn dimension(self, params: &ActuatorParams) -> Dimension {
        let sensors = &params.sensors;
        match self {
            Self::Time => Dimension::Time,
            Self::Counter => Dimension::Number,
            Self::CurrentD | Self::CurrentQ => Dimension::Current,
            Self::Of(role) => role.dimension(sensors.motor_counts_per_rev, sensors.output_counts_per_rev),
        }
    }

    /// Whether it keeps its value until it has another: a command or a condition.
    #[must_use]
    pub fn is_held(self) -> bool {
        self.is_command() || !self.is_sampled()
    }

    /// Whether it is what is commanded.
    #[must_use]
    pub fn is_command(self) -> bool {
        matches!(self, Self::Of(Role::CommandPosition | Role::CommandSpeed | Role::Mode))
    }

    /// Whether it is a current.
    #[must_use]
    pub fn is_current(&self) -> bool {
        use Role::{CurrentA, CurrentB, CurrentC};
        matches!(
            self,
            Self::CurrentD | Self::CurrentQ | Self::Of(CurrentA | CurrentB | CurrentC)
        )
    }

    /// Whether it has a value at every time: a current or an angle.
    #[must_use]
    pub fn is_continuous(&self) -> bool {
        self.is_current() || matches!(self, Self::Of(Role::MotorPosition | Role::OutputPosition))
    }

    /// Whether a row without it makes no sample.
    fn is_sampled(self) -> bool {
        match self {
            Self::Of(role) => role.is_sampled(),
            Self::Time | Self::Counter | Self::CurrentD | Self::CurrentQ => true,
        }
    }
}

/// One column of a log.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Column {
    /// What it is.
    pub quantity: Quantity,
    /// Its name in the log.
    pub signal: String,
    /// Its unit; `None`: the log has it.
    pub unit: Option<String>,
    /// Value in that unit = `scale · number + offset`.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
    /// Difference of numbers after which an angle begins again; `None`: never.
    pub wraps_after: Option<f64>,
}

/// Whose clock the time of the rows is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Clock {
    /// Of the device that took the samples: it shows their rate.
    Device,
    /// Of the computer that wrote the log: the samples have the rate of their type.
    Receiver,
}

/// Values of the mode as texts.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ModeNames {
    /// Position mode.
    pub position: Option<String>,
    /// Speed mode.
    pub speed: Option<String>,
}

/// Columns of a log as the quantities of one actuator; complete, so that samples can be made of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LogMap {
    columns: Vec<Column>,
    clock: Clock,
    modes: ModeCodes,
    names: ModeNames,
    #[serde(skip_serializing_if = "Option::is_none")]
    current_bandwidth_hz: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    resampling: Option<Resampling>,
}

/// Times at which currents and angles are interpolated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Resampling {
    /// Those of the first current, of a log with signals of several rates.
    AtCurrents,
    /// Even ones, so many a second, of a log whose own rate is of no use.
    Even(u32),
}

/// Why columns make no map. Displays as what is expected.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LogMisfit {
    /// No currents, or too few, or of both kinds.
    #[error("columns for currents.a and currents.b, or for currents.q")]
    Currents,
    /// A quantity without which nothing can be assessed is missing.
    #[error("a column for {0}, without which no window can be assessed")]
    Missing(&'static str),
    /// Two commands, and no mode that selects one.
    #[error("a column for command.mode beside command.position and command.speed")]
    NoMode,
}

impl LogMap {
    /// The map, if it is complete.
    ///
    /// # Errors
    /// [`LogMisfit`] for the first thing that is missing.
    pub fn new(columns: Vec<Column>, clock: Clock, modes: ModeCodes, names: ModeNames) -> Result<Self, LogMisfit> {
        let map = Self {
            columns,
            clock,
            modes,
            names,
            current_bandwidth_hz: None,
            resampling: None,
        };
        let has = |role: Role| map.has(Quantity::Of(role));
        let phases = [Role::CurrentA, Role::CurrentB, Role::CurrentC].map(has);
        let rotor = [Quantity::CurrentD, Quantity::CurrentQ].map(|of| map.has(of));
        match (phases, rotor) {
            ([true, true, _], [false, false]) | ([false, false, false], [_, true]) => {}
            _ => return Err(LogMisfit::Currents),
        }
        if !has(Role::MotorPosition) {
            return Err(LogMisfit::Missing(Role::MotorPosition.key()));
        }
        match (has(Role::CommandPosition), has(Role::CommandSpeed), has(Role::Mode)) {
            (true, true, false) => Err(LogMisfit::NoMode),
            _ => Ok(map),
        }
    }

    /// The same of currents that a drive filters; `None`: it does not, or nobody knows.
    #[must_use]
    pub fn with_current_bandwidth(self, current_bandwidth_hz: Option<u32>) -> Self {
        Self {
            current_bandwidth_hz,
            ..self
        }
    }

    /// The same of a log whose currents and angles are interpolated.
    #[must_use]
    pub fn with_resampling(self, resampling: Option<Resampling>) -> Self {
        Self { resampling, ..self }
    }

    /// Times at which currents and angles are interpolated; `None`: they are taken as they are.
    #[must_use]
    pub fn resampling(&self) -> Option<Resampling> {
        self.resampling
    }

    /// Its columns.
    #[must_use]
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Whether a quantity is mapped.
    #[must_use]
    pub fn has(&self, quantity: Quantity) -> bool {
        self.columns.iter().any(|column| column.quantity == quantity)
    }

    /// Whether anything is commanded; else motion begins a window.
    #[must_use]
    pub fn has_command(&self) -> bool {
        [Role::CommandPosition, Role::CommandSpeed]
            .into_iter()
            .any(|role| self.has(Quantity::Of(role)))
    }

    /// Whether the rows show the time of the device.
    #[must_use]
    pub fn has_device_time(&self) -> bool {
        self.clock == Clock::Device || self.has(Quantity::Of(Role::Time))
    }

    /// What is missing.
    pub fn gaps(&self) -> impl Iterator<Item = Gap> {
        let of_columns = Gap::OF_COLUMNS.into_iter().filter(|gap| gap.is_in(self));
        let of_columns = of_columns.chain(self.current_bandwidth_hz.map(Gap::FilteredCurrents));
        of_columns.chain(self.resampling.map(Gap::Resampled))
    }

    /// Numbers that stand for a mode.
    #[must_use]
    pub fn modes(&self) -> ModeCodes {
        self.modes
    }

    /// Whether the values of the mode are configured as texts.
    #[must_use]
    pub fn has_mode_names(&self) -> bool {
        self.names != ModeNames::default()
    }

    /// The code of a mode that a log has as text; `None` where no name is configured, and of an empty text, which is no value.
    #[must_use]
    pub fn mode_code(&self, text: &str) -> Option<f64> {
        /// No code of any mode: idle.
        const IDLE: f64 = -1.0;
        if text.trim().is_empty() {
            return None;
        }
        let is = |name: &Option<String>| name.as_deref() == Some(text);
        if is(&self.names.position) {
            Some(self.modes.position as f64)
        } else if is(&self.names.speed) {
            Some(self.modes.speed as f64)
        } else {
            self.has_mode_names().then_some(IDLE)
        }
    }
}

impl Column {
    /// A column whose unit the log has.
    #[must_use]
    pub fn plain(quantity: Quantity, signal: &str) -> Self {
        Self {
            quantity,
            signal: signal.to_owned(),
            unit: None,
            scale: 1.0,
            offset: 0.0,
            wraps_after: None,
        }
    }

    /// Conversion of its numbers to the internal unit; `of_log` is the unit that the log has of it.
    ///
    /// # Errors
    /// What is expected, where there is no unit or one of another quantity.
    pub fn conversion(&self, of_log: Option<&str>, params: &ActuatorParams) -> Result<Unit, String> {
        let dimension = self.quantity.dimension(params);
        let name = self.unit.as_deref().or(of_log).unwrap_or_default();
        match dimension.unit(name) {
            Some(unit) => Ok(Unit {
                scale: unit.scale * self.scale,
                offset: unit.to_internal(self.offset),
            }),
            None => Err(format!(
                "a unit of {} ({}), in the log or as {{ signal = …, unit = … }}",
                self.quantity.key(),
                dimension.names()
            )),
        }
    }
}
