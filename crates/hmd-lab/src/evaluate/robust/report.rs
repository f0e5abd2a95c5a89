//! What the suite found: over all units, for each actuator type and for each entry.

use std::collections::BTreeMap;

use serde::Serialize;

use super::entries::EntryKind;
use super::score::{Rates, Tally};
use super::state::FinishedUnit;

/// Result of `hmd evaluate robust`.
#[derive(Clone, Debug, Serialize)]
pub struct RobustReport {
    /// Name of the suite.
    pub suite: &'static str,
    /// Sample rate, Hz.
    pub rate_hz: f64,
    /// Healthy windows of each unit.
    pub n: u64,
    /// Suite seed.
    pub seed: u64,
    /// Before and after calibration, over all units.
    #[serde(flatten)]
    pub all: Group,
    /// The same for each actuator type.
    pub actuators: Vec<OfType>,
    /// The same for each entry.
    pub entries: Vec<EntryReport>,
}

/// Rates of a group of units.
#[derive(Clone, Debug, Serialize)]
pub struct Group {
    /// Units.
    pub units: u64,
    /// Assessed with the type's calibration.
    pub before: Rates,
    /// Assessed with the unit's calibration; as before where there is none.
    pub after: Rates,
    /// Healthy windows of motions that the calibration has not seen, with the unit's calibration; with the type's where there is none.
    pub elsewhere: Rates,
    /// Units whose calibration was refused.
    pub refused: u64,
}

/// Rates of the units of an actuator type.
#[derive(Clone, Debug, Serialize)]
pub struct OfType {
    /// Name of the type.
    pub actuator: String,
    /// Its rates.
    #[serde(flatten)]
    pub group: Group,
}

/// Rates of the units of an entry.
#[derive(Clone, Debug, Serialize)]
pub struct EntryReport {
    /// Name of the entry.
    pub entry: String,
    /// What it consists of.
    pub kind: EntryKind,
    /// Its rates.
    #[serde(flatten)]
    pub group: Group,
    /// One unit for each type.
    pub of_units: Vec<UnitReport>,
}

/// One unit.
#[derive(Clone, Debug, Serialize)]
pub struct UnitReport {
    /// Name of its type.
    pub actuator: String,
    /// Its effects by name.
    pub effects: BTreeMap<&'static str, f64>,
    /// Assessed with the type's calibration.
    pub before: Rates,
    /// Assessed with its own.
    pub after: Rates,
    /// The same in motions that the calibration has not seen.
    pub elsewhere: Rates,
    /// Why its calibration was refused, if it was.
    pub reason: Option<String>,
}

impl Group {
    pub(super) fn of<'a>(units: impl Iterator<Item = &'a FinishedUnit> + Clone) -> Self {
        Self {
            units: units.clone().count() as u64,
            before: Tally::sum(units.clone().map(|unit| &unit.before)).rates(),
            after: Tally::sum(units.clone().map(|unit| &unit.after)).rates(),
            elsewhere: Tally::sum(units.clone().map(|unit| &unit.elsewhere)).rates(),
            refused: units.filter(|unit| unit.refused.is_some()).count() as u64,
        }
    }
}
