//! What may be wrong besides the actuator: sensors, wires, configured numbers.

use std::fmt;

use crate::window::{Defect, Invalidity, Signal};

/// A sensor, a wire or a configured number that may be wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Suspect {
    /// Load torque at the output.
    LoadSensor,
    /// DC link voltage.
    DcLink,
    /// Winding temperature.
    WindingTemperature,
    /// Zero of one or several phase currents.
    CurrentOffset,
    /// Gain of all phase currents alike.
    CurrentGain,
    /// Unit of the phase currents.
    CurrentUnit,
    /// Gain of one phase current.
    PhaseGain,
    /// Two phase currents in each other's place.
    PhaseOrder,
    /// Sign of one or all phase currents.
    CurrentSign,
    /// One or all phase currents stand still.
    CurrentFrozen,
    /// Zero of the resolver.
    ResolverZero,
    /// Sign of the resolver's angle.
    ResolverDirection,
    /// Resolver counts per motor turn.
    ResolverCounts,
    /// The resolver's angle stands still.
    ResolverFrozen,
    /// Pole pairs of the motor.
    PolePairs,
    /// Inertia at the motor shaft.
    Inertia,
    /// Sign of the output angle.
    EncoderDirection,
    /// Zero of the output angle.
    EncoderZero,
    /// Encoder counts per output turn.
    EncoderCounts,
    /// The output angle stands still.
    EncoderFrozen,
    /// Gear ratio.
    GearRatio,
    /// Unit of the set point.
    SetpointUnit,
    /// Set point before or behind currents and angles.
    SetpointDelay,
    /// Mode of the drive.
    Mode,
    /// Samples that repeat the one before.
    RepeatedSamples,
    /// Currents and angles that are not of one instant.
    SampleOrder,
}

impl Suspect {
    /// All.
    pub const ALL: [Self; 26] = [
        Self::LoadSensor,
        Self::DcLink,
        Self::WindingTemperature,
        Self::CurrentOffset,
        Self::CurrentGain,
        Self::CurrentUnit,
        Self::PhaseGain,
        Self::PhaseOrder,
        Self::CurrentSign,
        Self::CurrentFrozen,
        Self::ResolverZero,
        Self::ResolverDirection,
        Self::ResolverCounts,
        Self::ResolverFrozen,
        Self::PolePairs,
        Self::Inertia,
        Self::EncoderDirection,
        Self::EncoderZero,
        Self::EncoderCounts,
        Self::EncoderFrozen,
        Self::GearRatio,
        Self::SetpointUnit,
        Self::SetpointDelay,
        Self::Mode,
        Self::RepeatedSamples,
        Self::SampleOrder,
    ];

    /// The suspect with which every sentence about it begins.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::LoadSensor => "load sensor",
            Self::DcLink => "dc link",
            Self::WindingTemperature => "winding temperature",
            Self::CurrentOffset => "current offset",
            Self::CurrentGain => "current gain",
            Self::CurrentUnit => "current unit",
            Self::PhaseGain => "phase gain",
            Self::PhaseOrder => "phase order",
            Self::CurrentSign => "current sign",
            Self::CurrentFrozen => "frozen current",
            Self::ResolverZero => "resolver zero",
            Self::ResolverDirection => "resolver direction",
            Self::ResolverCounts => "resolver counts",
            Self::ResolverFrozen => "frozen resolver",
            Self::PolePairs => "pole pairs",
            Self::Inertia => "inertia",
            Self::EncoderDirection => "encoder direction",
            Self::EncoderZero => "encoder zero",
            Self::EncoderCounts => "encoder counts",
            Self::EncoderFrozen => "frozen encoder",
            Self::GearRatio => "gear ratio",
            Self::SetpointUnit => "set point unit",
            Self::SetpointDelay => "set point delay",
            Self::Mode => "mode",
            Self::RepeatedSamples => "repeated samples",
            Self::SampleOrder => "sample order",
        }
    }

    /// The suspect of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|suspect| suspect.name() == name)
    }

    /// What to look at, for a mechanic: goes on after "check".
    #[must_use]
    pub const fn to_check(self) -> &'static str {
        match self {
            Self::LoadSensor => "the load sensor and its wiring",
            Self::DcLink => "the sensor of the DC link voltage",
            Self::WindingTemperature => "the sensor of the winding temperature and its wiring",
            Self::CurrentOffset | Self::CurrentGain | Self::PhaseGain | Self::CurrentFrozen => {
                "the phase current sensors of the drive and their wiring"
            }
            Self::CurrentUnit => "the configured unit of the phase currents",
            Self::PhaseOrder | Self::CurrentSign => "the wires of the phase current sensors: order and direction",
            Self::ResolverZero => "the seat of the resolver on the motor shaft",
            Self::ResolverDirection | Self::ResolverFrozen => "the resolver and its wiring",
            Self::EncoderZero => "the seat of the output encoder",
            Self::EncoderDirection | Self::EncoderFrozen => "the output encoder and its wiring",
            Self::ResolverCounts => "the configured resolver counts",
            Self::PolePairs => "the configured pole pairs",
            Self::Inertia => "what the output moves: its inertia is not that of commissioning",
            Self::EncoderCounts => "the configured encoder counts",
            Self::GearRatio => "the configured gear ratio",
            Self::SetpointUnit => "the configured unit of the set point",
            Self::SetpointDelay => "when the drive sends, or the logger stamps, its set point",
            Self::Mode => "the mode that the drive sends",
            Self::RepeatedSamples => "whether the drive repeats samples",
            Self::SampleOrder => "whether the drive sends currents and angles of one instant",
        }
    }

    /// What an invalid window points at by itself.
    #[must_use]
    pub fn of_invalidity(invalidity: &Invalidity) -> Option<Self> {
        match invalidity {
            Invalidity::Stuck(Signal::Currents) => Some(Self::CurrentFrozen),
            Invalidity::Stuck(Signal::Motor) => Some(Self::ResolverFrozen),
            Invalidity::Stuck(Signal::Output) => Some(Self::EncoderFrozen),
            Invalidity::TooManyFlawed {
                defect: Defect::Repeated,
                ..
            }
            | Invalidity::Held { .. } => Some(Self::RepeatedSamples),
            Invalidity::CounterJumped { .. }
            | Invalidity::CutShort(_)
            | Invalidity::ModeChanged
            | Invalidity::CommandInGap { .. }
            | Invalidity::TooManyFlawed { .. }
            | Invalidity::CountersDisagree { .. }
            | Invalidity::StartInMotion { .. }
            | Invalidity::TimeJitter { .. }
            | Invalidity::SampleRate { .. } => None,
        }
    }
}

impl fmt::Display for Suspect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// A suspect, and the evidence in one sentence that begins with its name.
#[derive(Clone, Debug, PartialEq)]
pub struct Suspicion {
    /// What is suspected.
    pub suspect: Suspect,
    /// The sentence, with its numbers.
    pub sentence: String,
}

impl fmt::Display for Suspicion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.sentence)
    }
}
