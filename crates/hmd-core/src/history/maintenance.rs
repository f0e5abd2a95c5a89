//! Maintenance events: a part was replaced, and the history of the unit starts again; or the frames of a time shall be kept.

use std::collections::BTreeSet;
use std::fmt;

use ema_models::FaultId;
use serde::{Deserialize, Serialize};

use crate::config::Config;
use crate::counted::counted;
use crate::sensor_checks::Suspect;
use crate::sensor_health::SensorQuantity;

/// One event.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Event {
    /// When, UTC ns.
    pub t_ns: u64,
    /// Which actuator.
    pub actuator: String,
    /// What happened.
    pub event: EventKind,
    /// Of a reset, the part that was replaced; without it the whole unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<ReplacedPart>,
    /// What the person who entered it wrote; older files had none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

impl Event {
    /// Whether it is about a unit of this name. `serial_number` is that of the unit where recordings hold several of the name: it is then about
    /// the one that the configuration has, without one there about each.
    #[must_use]
    pub fn is_about(&self, actuator: &str, serial_number: Option<&str>, config: &Config) -> bool {
        let configured = config
            .actuator_named(actuator)
            .and_then(|of| of.serial_number.as_deref());
        self.actuator == actuator
            && serial_number.is_none_or(|number| configured.is_none_or(|configured| configured == number))
    }
}

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EventKind {
    /// The unit, or a part of it, was replaced or overhauled: what was known of its wear is void.
    Reset,
    /// The frames around this time shall be stored by a daemon that does not store all; the history goes on.
    Keep,
}

/// What is replaced of a unit in one piece.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ReplacedPart {
    /// Motor with its windings, rotor and bearings.
    Motor,
    /// Gear and screw with their bearings.
    Gearbox,
    /// Position controller.
    Controller,
}

impl ReplacedPart {
    /// Number of parts.
    pub const COUNT: usize = 3;

    /// All of them.
    pub const ALL: [Self; Self::COUNT] = [Self::Motor, Self::Gearbox, Self::Controller];

    /// Its name in options and records.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Motor => "motor",
            Self::Gearbox => "gearbox",
            Self::Controller => "controller",
        }
    }

    /// The part of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|part| part.name() == name)
    }

    /// What a record says was replaced before its window: parts, or the unit (`None`). Other names are left out.
    pub fn in_text(replaced: &str) -> impl Iterator<Item = Option<Self>> {
        let named = replaced.split(',').map(|name| (name, Self::from_name(name)));
        named.filter_map(|(name, part)| (part.is_some() || name == "unit").then_some(part))
    }

    /// The faults whose damage a new part changes. Bearings of motor and gear add to one friction.
    #[must_use]
    pub const fn faults(self) -> &'static [FaultId] {
        match self {
            Self::Motor => &[
                FaultId::Friction,
                FaultId::ShortA,
                FaultId::ShortB,
                FaultId::ShortC,
                FaultId::Eccentricity,
            ],
            Self::Gearbox => &[FaultId::Friction, FaultId::Backlash],
            Self::Controller => &[FaultId::Gain],
        }
    }

    /// Whether nothing is known of a fault once a part, or the unit (`None`), is another.
    #[must_use]
    pub fn renews(part: Option<Self>, fault: FaultId) -> bool {
        part.is_none_or(|part| part.faults().contains(&fault))
    }

    /// What is tracked of the sensors in it: the resolver sits on the motor's shaft, the current sensors and the link in the controller.
    #[must_use]
    pub const fn sensors(self) -> &'static [SensorQuantity] {
        use SensorQuantity as Of;
        match self {
            Self::Motor => &[Of::Resolver1Cos, Of::Resolver1Sin, Of::Resolver2Cos, Of::Resolver2Sin],
            Self::Gearbox => &[],
            Self::Controller => &[
                Of::CurrentSum,
                Of::OffsetAlpha,
                Of::OffsetBeta,
                Of::GainA,
                Of::GainB,
                Of::GainC,
                Of::Latency,
                Of::DcLink,
            ],
        }
    }

    /// What a window may suspect of the sensors and wires in it. What is configured, and the load sensor and output encoder beside it, stay.
    #[must_use]
    pub const fn suspects(self) -> &'static [Suspect] {
        use Suspect as Of;
        match self {
            Self::Motor => &[
                Of::WindingTemperature,
                Of::ResolverZero,
                Of::ResolverDirection,
                Of::ResolverFrozen,
            ],
            Self::Gearbox => &[],
            Self::Controller => &[
                Of::DcLink,
                Of::CurrentOffset,
                Of::CurrentGain,
                Of::PhaseGain,
                Of::PhaseOrder,
                Of::CurrentSign,
                Of::CurrentFrozen,
                Of::SetpointDelay,
                Of::Mode,
                Of::RepeatedSamples,
                Of::SampleOrder,
            ],
        }
    }
}

/// The events of a file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Events {
    /// In the order of time.
    pub list: Vec<Event>,
    /// Lines that were never finished, as when the power went while one was written; from 1.
    pub unfinished: Vec<usize>,
    /// Lines that are no event.
    pub unreadable: Vec<UnreadableLine>,
    /// Lines of both kinds beyond [`Events::BAD_LINES_MAX`].
    pub more_bad_lines: u64,
}

impl Events {
    /// Most lines that were never finished or are no event that are listed; the others are counted.
    pub const BAD_LINES_MAX: usize = 100;

    /// Most events of unknown actuators that are told one by one; the others are counted.
    const UNKNOWN_REPORTED_MAX: usize = 100;

    /// Whether one more bad line is listed; counts it if not.
    pub fn takes_bad_line(&mut self) -> bool {
        let takes = self.unfinished.len() + self.unreadable.len() < Self::BAD_LINES_MAX;
        self.more_bad_lines += u64::from(!takes);
        takes
    }

    /// What an operator should read of lines that do not count, and of events of actuators that this configuration does not have; `before` was told.
    #[must_use]
    pub fn ignored_entries(&self, before: &Self, config: &Config) -> Vec<String> {
        let mut told = Vec::new();
        for line in self.unfinished.iter().filter(|line| !before.unfinished.contains(line)) {
            told.push(format!(
                "rul.events, line {line}: never finished and ignored; record that event again"
            ));
        }
        let new = self.unreadable.iter().filter(|bad| !before.unreadable.contains(bad));
        told.extend(new.map(ToString::to_string));
        if self.more_bad_lines > before.more_bad_lines {
            let more = counted(self.more_bad_lines, "more line", "more lines");
            told.push(format!(
                "rul.events: {more} never finished or no event, ignored; correct the file"
            ));
        }
        let of_nobody = |event: &&Event| config.actuator_named(&event.actuator).is_none();
        let reported: BTreeSet<&Event> = before.list.iter().filter(of_nobody).collect();
        let new = self.list.iter().filter(of_nobody);
        let mut new = new.filter(|event| !reported.contains(event));
        for event in new.by_ref().take(Self::UNKNOWN_REPORTED_MAX) {
            let name = &event.actuator;
            told.push(format!(
                "rul.events: expected an actuator of this configuration, found {name:?}; that event is ignored"
            ));
        }
        let more = new.count();
        if more > 0 {
            let more = counted(more as u64, "more event", "more events");
            told.push(format!(
                "rul.events: {more} of actuators that are not in this configuration, ignored"
            ));
        }
        told
    }
}

/// A line of the file that is no event; its text says so.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnreadableLine {
    /// Its number, from 1.
    pub line: usize,
    /// Error of the reader.
    pub found: String,
}

impl fmt::Display for UnreadableLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { line, found } = self;
        write!(
            f,
            "rul.events, line {line}: expected a maintenance event, found none ({found}); the line is ignored: correct it"
        )
    }
}
