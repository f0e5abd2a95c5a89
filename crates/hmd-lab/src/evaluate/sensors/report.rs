//! What the suite found: over all mistakes, for each one, and of every window.

use serde::Serialize;

use super::score::Rates;

/// Result of `hmd evaluate sensors`.
#[derive(Clone, Debug, Serialize)]
pub struct SensorsReport {
    /// Name of the suite.
    pub suite: &'static str,
    /// Healthy units of each mistake and type.
    pub n: u64,
    /// Suite seed.
    pub seed: u64,
    /// Units that could not be commissioned.
    pub refused: u64,
    /// Over all mistakes.
    #[serde(flatten)]
    pub mistakes: Group,
    /// The same for each, the windows without a mistake first.
    pub by_mistake: Vec<OfMistake>,
    /// Every window.
    pub cases: Vec<Case>,
}

/// Rates of a group of windows.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Group {
    /// Before and after commissioning.
    #[serde(flatten)]
    pub all: Rates,
    /// Assessed with the type's calibration.
    pub before: Rates,
    /// Assessed with the unit's.
    pub after: Rates,
}

/// Rates of one mistake.
#[derive(Clone, Debug, Serialize)]
pub struct OfMistake {
    /// Name of the entry.
    pub mistake: String,
    /// Its rates.
    #[serde(flatten)]
    pub group: Group,
}

/// One window, assessed before or after commissioning.
#[derive(Clone, Debug, Serialize)]
pub struct Case {
    /// Name of the entry.
    pub mistake: &'static str,
    /// Type of the actuator.
    pub actuator: String,
    /// Its unit: the same for the windows of one.
    pub unit: String,
    /// Profile, rate and drive.
    pub circumstances: String,
    /// Whether the unit was commissioned.
    pub commissioned: bool,
    /// Whether the motion shows the mistake.
    pub is_shown: bool,
    /// The worn part.
    pub worn: Option<&'static str>,
    /// Status of the window; none where none was cut.
    pub status: Option<String>,
    /// Faults that were named.
    pub faults: Vec<String>,
    /// Sensors, wires and numbers that were named.
    pub suspects: Vec<&'static str>,
    /// The reason of the window, or what the pipeline reported.
    pub reason: String,
}
