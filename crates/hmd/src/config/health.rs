//! Section `[health]`: the levels of damage, for all faults and for each.

use std::collections::BTreeMap;

use serde::{Serialize, Serializer};

use super::ConfigError;
use super::reader::Section;
use crate::record::FAULT_NAMES;

/// Levels of damage d of one fault, in ascending order.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct HealthLevels {
    /// Worth a look.
    pub watch: f64,
    /// Plan a repair.
    pub warning: f64,
    /// Repair now.
    pub critical: f64,
    /// Where the remaining useful life ends.
    pub end_of_life: f64,
    /// How far d must fall below a level before the state steps down; less than `watch`.
    pub hysteresis: f64,
    /// Windows in a row that a new state needs, at least 1.
    pub persistence: u32,
}

impl Default for HealthLevels {
    fn default() -> Self {
        Self {
            watch: 0.05,
            warning: 0.3,
            critical: 0.6,
            end_of_life: 0.8,
            hysteresis: 0.02,
            persistence: 1,
        }
    }
}

impl HealthLevels {
    const KEYS: &[&str] = &[
        "watch",
        "warning",
        "critical",
        "end_of_life",
        "hysteresis",
        "persistence",
    ];

    fn read(section: &Section<'_>, default: Self) -> Result<Self, ConfigError> {
        // Below 0.001 there is nothing to see, whatever the sensors.
        let level = |key, default| section.number(key, default, 0.001..=1.0);
        let levels = Self {
            watch: level("watch", default.watch)?,
            warning: level("warning", default.warning)?,
            critical: level("critical", default.critical)?,
            end_of_life: level("end_of_life", default.end_of_life)?,
            hysteresis: section.number("hysteresis", default.hysteresis, 0.0..=1.0)?,
            persistence: section.whole("persistence", 1..=1_000)?.unwrap_or(default.persistence),
        };
        let ascending = [
            ("watch", levels.watch),
            ("warning", levels.warning),
            ("critical", levels.critical),
            ("end_of_life", levels.end_of_life),
        ];
        for pair in ascending.windows(2) {
            let ((lower, least), (upper, value)) = (pair[0], pair[1]);
            if value <= least {
                let effective = format!("{value} (not set here)");
                return Err(section.refuse_effective(upper, &format!("more than {lower} = {least}"), &effective));
            }
        }
        if levels.hysteresis >= levels.watch {
            let effective = format!("{} (not set here)", levels.hysteresis);
            let expected = format!("less than watch = {}", levels.watch);
            return Err(section.refuse_effective("hysteresis", &expected, &effective));
        }
        Ok(levels)
    }
}

/// The levels of every fault.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct HealthConfig {
    /// In the order of [`FAULT_NAMES`].
    levels: [HealthLevels; FAULT_NAMES.len()],
}

impl HealthConfig {
    pub(super) const KEYS: &[&str] = &[
        "watch",
        "warning",
        "critical",
        "end_of_life",
        "hysteresis",
        "persistence",
        "fault",
    ];

    pub(super) fn read(section: &Section<'_>) -> Result<Self, ConfigError> {
        let common = HealthLevels::read(section, HealthLevels::default())?;
        let faults = section.section("fault", &FAULT_NAMES)?;
        let mut levels = [common; FAULT_NAMES.len()];
        for (own, name) in levels.iter_mut().zip(FAULT_NAMES) {
            *own = HealthLevels::read(&faults.section(name, HealthLevels::KEYS)?, common)?;
        }
        Ok(Self { levels })
    }

    /// Levels of every fault, in the order of [`FAULT_NAMES`].
    #[must_use]
    pub fn levels(&self) -> &[HealthLevels; FAULT_NAMES.len()] {
        &self.levels
    }

    /// Levels of the fault called `name`.
    #[must_use]
    pub fn levels_of(&self, name: &str) -> Option<&HealthLevels> {
        FAULT_NAMES
            .iter()
            .position(|fault| *fault == name)
            .map(|i| &self.levels[i])
    }
}

impl Serialize for HealthConfig {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        FAULT_NAMES
            .iter()
            .zip(&self.levels)
            .collect::<BTreeMap<_, _>>()
            .serialize(serializer)
    }
}
