//! [`SignalMap`]: which signals of a bus are the quantities of one actuator.

use serde::Serialize;

use super::database::DbcMessage;
use super::signal::{Signal, SignalKind};
use super::unit::{Dimension, Unit};

/// A quantity of an actuator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Phase currents.
    CurrentA,
    /// See [`Role::CurrentA`].
    CurrentB,
    /// The same; without it, the star point gives it: the three sum to zero.
    CurrentC,
    /// Angle of the motor.
    MotorPosition,
    /// Angle of the output.
    OutputPosition,
    /// Commanded angle of the output.
    CommandPosition,
    /// Commanded speed of the motor.
    CommandSpeed,
    /// What is commanded.
    Mode,
    /// Time of the device.
    Time,
    /// DC link voltage.
    DcLink,
    /// Winding temperature.
    WindingTemp,
    /// Load torque at the output.
    LoadTorque,
}

impl Role {
    /// All of them, with the key of the configuration; those of a sample before those of conditions.
    pub const ALL: [(Self, &'static str); 12] = [
        (Self::CurrentA, "currents.a"),
        (Self::CurrentB, "currents.b"),
        (Self::CurrentC, "currents.c"),
        (Self::MotorPosition, "position.motor"),
        (Self::OutputPosition, "position.output"),
        (Self::CommandPosition, "command.position"),
        (Self::CommandSpeed, "command.speed"),
        (Self::Mode, "command.mode"),
        (Self::Time, "sample.time"),
        (Self::DcLink, "status.dc_link"),
        (Self::WindingTemp, "status.winding_temp"),
        (Self::LoadTorque, "status.load_torque"),
    ];

    /// Number of those that belong to a sample.
    pub const SAMPLED: usize = 9;

    /// Without these no window can be assessed.
    pub const NEEDED: [Self; 4] = [
        Self::CurrentA,
        Self::CurrentB,
        Self::MotorPosition,
        Self::OutputPosition,
    ];

    /// Whether it was latched with a sample; else it is a condition that changes slowly.
    #[must_use]
    pub fn is_sampled(self) -> bool {
        (self as usize) < Self::SAMPLED
    }

    /// Its key in the configuration.
    #[must_use]
    pub fn key(self) -> &'static str {
        Self::ALL[self as usize].1
    }

    /// What kind of quantity it is, for sensors with so many counts per turn.
    #[must_use]
    pub fn dimension(self, motor_counts_per_rev: f64, output_counts_per_rev: f64) -> Dimension {
        let angle = |counts_per_rev| Dimension::Angle { counts_per_rev };
        match self {
            Self::CurrentA | Self::CurrentB | Self::CurrentC => Dimension::Current,
            Self::MotorPosition => angle(motor_counts_per_rev),
            Self::OutputPosition => angle(output_counts_per_rev),
            Self::CommandPosition => Dimension::CommandedAngle,
            Self::CommandSpeed => Dimension::Speed,
            Self::Mode => Dimension::Number,
            Self::Time => Dimension::Time,
            Self::DcLink => Dimension::Voltage,
            Self::WindingTemp => Dimension::Temperature,
            Self::LoadTorque => Dimension::Torque,
        }
    }
}

/// One quantity in its message.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Binding {
    /// Which quantity.
    pub role: Role,
    /// Where its bits are.
    pub signal: Signal,
    /// Conversion of its physical value to the internal unit.
    pub unit: Unit,
    /// Difference after which it begins again, in the internal unit; `None`: never. Of angles alone.
    pub wraps_after: Option<f64>,
}

/// What is used of one message.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MessageUse {
    /// Its name.
    pub name: String,
    /// Identifier.
    pub id: u32,
    /// Whether the identifier has 29 bits.
    pub extended: bool,
    /// Data bytes; a shorter frame is malformed.
    pub length: usize,
    /// Quantities in it.
    pub bindings: Vec<Binding>,
    /// Sample counters in it, one for each branch of its multiplexor that has one.
    pub counters: Vec<Signal>,
}

/// Values of the mode signal; every other one is idle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct ModeCodes {
    /// Position mode.
    pub position: i64,
    /// Speed mode.
    pub speed: i64,
}

impl Default for ModeCodes {
    /// Those of the built-in dictionary.
    fn default() -> Self {
        Self { position: 1, speed: 2 }
    }
}

/// Signals of a bus as the quantities of one actuator; complete, so that samples can be made of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SignalMap {
    /// Messages, in the order in which they were first named.
    pub messages: Vec<MessageUse>,
    /// What the mode means.
    pub modes: ModeCodes,
    /// Bits of the narrowest and of the widest counter.
    pub counter_bits: (u16, u16),
}

/// A map in the making.
#[derive(Clone, Debug, Default)]
pub struct MapDraft {
    messages: Vec<MessageUse>,
    modes: ModeCodes,
}

/// Why signals make no map. Displays as what is expected.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Misfit {
    /// A quantity without which nothing can be assessed is missing.
    #[error("a signal for {0}, without which no window can be assessed")]
    Missing(&'static str),
    /// Nothing is commanded.
    #[error("a signal for command.position or command.speed, without which no window begins")]
    NoCommand,
    /// Two commands, and no mode that selects one.
    #[error("a signal for command.mode beside command.position and command.speed")]
    NoMode,
    /// Nothing counts samples.
    #[error("a signal for sample.counter, without which lost samples go unseen")]
    NoCounter,
    /// A counter that is no plain number, or too short to tell late from early.
    #[error("a counter: a whole number of at least 2 bits, with factor 1 and offset 0")]
    Counter,
    /// Two quantities from the same bits.
    #[error("a signal of its own for each quantity, where {0} and {1} have the same")]
    Shared(&'static str, &'static str),
    /// An identifier that cannot be.
    #[error("a message whose identifier has 11 or 29 bits, and up to 64 data bytes")]
    Message,
}

impl MapDraft {
    /// With these values of the mode.
    pub fn set_modes(&mut self, modes: ModeCodes) {
        self.modes = modes;
    }

    /// Adds a quantity.
    ///
    /// # Errors
    /// [`Misfit::Message`].
    pub fn bind(&mut self, message: &DbcMessage, binding: Binding) -> Result<(), Misfit> {
        self.message(message)?.bindings.push(binding);
        Ok(())
    }

    /// Adds a counter.
    ///
    /// # Errors
    /// [`Misfit::Message`], [`Misfit::Counter`].
    pub fn count(&mut self, message: &DbcMessage, counter: Signal) -> Result<(), Misfit> {
        let whole = matches!(counter.kind, SignalKind::Unsigned | SignalKind::Signed);
        let plain = (counter.factor - 1.0).abs() < f64::EPSILON && counter.offset.abs() < f64::EPSILON;
        if !(whole && plain && counter.layout.size >= 2) {
            return Err(Misfit::Counter);
        }
        self.message(message)?.counters.push(counter);
        Ok(())
    }

    fn message(&mut self, message: &DbcMessage) -> Result<&mut MessageUse, Misfit> {
        let highest = if message.extended { 0x1fff_ffff } else { 0x7ff };
        if message.id > highest || message.length > 64 {
            return Err(Misfit::Message);
        }
        let known = self.messages.iter().position(|known| known.name == message.name);
        let place = known.unwrap_or_else(|| {
            self.messages.push(MessageUse {
                name: message.name.clone(),
                id: message.id,
                extended: message.extended,
                length: message.length,
                bindings: Vec::new(),
                counters: Vec::new(),
            });
            self.messages.len() - 1
        });
        Ok(&mut self.messages[place])
    }

    /// The map, if it is complete.
    ///
    /// # Errors
    /// [`Misfit`] for the first thing that is missing.
    pub fn finish(self) -> Result<SignalMap, Misfit> {
        let has = |role: Role| {
            self.messages
                .iter()
                .flat_map(|of| &of.bindings)
                .any(|of| of.role == role)
        };
        if let Some(missing) = Role::NEEDED.into_iter().find(|&role| !has(role)) {
            return Err(Misfit::Missing(missing.key()));
        }
        for message in &self.messages {
            for (n, one) in message.bindings.iter().enumerate() {
                let same = |other: &&Binding| {
                    other.signal.layout == one.signal.layout && other.signal.selectors == one.signal.selectors
                };
                if let Some(other) = message.bindings[..n].iter().find(same) {
                    return Err(Misfit::Shared(other.role.key(), one.role.key()));
                }
            }
        }
        match (has(Role::CommandPosition), has(Role::CommandSpeed), has(Role::Mode)) {
            (false, false, _) => return Err(Misfit::NoCommand),
            (true, true, false) => return Err(Misfit::NoMode),
            _ => {}
        }
        let bits = || {
            let counters = self.messages.iter().flat_map(|of| &of.counters);
            counters.map(|of| of.layout.size)
        };
        let (Some(narrowest), Some(widest)) = (bits().min(), bits().max()) else {
            return Err(Misfit::NoCounter);
        };
        Ok(SignalMap {
            messages: self.messages,
            modes: self.modes,
            counter_bits: (narrowest, widest),
        })
    }
}

impl SignalMap {
    /// The quantities that are mapped.
    pub fn roles(&self) -> impl Iterator<Item = Role> {
        self.messages.iter().flat_map(|of| &of.bindings).map(|of| of.role)
    }

    /// Whether a quantity is mapped.
    #[must_use]
    pub fn has(&self, role: Role) -> bool {
        self.roles().any(|known| known == role)
    }

    /// Messages with parts of a sample and without a counter: their frames are matched by their stamps.
    pub fn uncounted(&self) -> impl Iterator<Item = &MessageUse> {
        self.messages
            .iter()
            .filter(|of| of.is_sampled() && of.counters.is_empty())
    }
}

impl MessageUse {
    /// Its identifier as `candump` shows it: three or eight hexadecimal digits.
    #[must_use]
    pub fn shown_id(&self) -> String {
        let digits = if self.extended { 8 } else { 3 };
        format!("{:0digits$X}", self.id)
    }

    /// Whether it carries parts of a sample.
    #[must_use]
    pub fn is_sampled(&self) -> bool {
        !self.counters.is_empty() || self.bindings.iter().any(|of| of.role.is_sampled())
    }

    /// Number of its frames in one sample: one for each selection of its multiplexors.
    #[must_use]
    pub fn frames_per_sample(&self) -> usize {
        let sampled = self.bindings.iter().filter(|of| of.role.is_sampled());
        let mut selections: Vec<_> = sampled
            .map(|of| &of.signal.selectors)
            .filter(|of| !of.is_empty())
            .collect();
        selections.dedup();
        let distinct = (0..selections.len()).filter(|&n| !selections[..n].contains(&selections[n]));
        if self.is_sampled() { distinct.count().max(1) } else { 0 }
    }
}
