//! Section `[health]`: the levels of damage, for all faults and for each.

use std::collections::BTreeMap;

use serde::{Serialize, Serializer};

use super::ConfigError;
use super::reader::Section;
use crate::health::Levels;
use ema_models::FaultId;

/// The keys of one fault.
const KEYS: &[&str] = &[
    "watch",
    "warning",
    "critical",
    "end_of_life",
    "hysteresis",
    "persistence",
];

/// The levels that a section sets, the others from `default`.
fn levels(section: &Section<'_>, default: Levels) -> Result<Levels, ConfigError> {
    let level = |key, default| section.number(key, default, Levels::LEVEL);
    let levels = Levels {
        watch: level("watch", default.watch)?,
        warning: level("warning", default.warning)?,
        critical: level("critical", default.critical)?,
        end_of_life: level("end_of_life", default.end_of_life)?,
        hysteresis: section.number("hysteresis", default.hysteresis, Levels::HYSTERESIS)?,
        persistence: section
            .integer("persistence", Levels::PERSISTENCE)?
            .unwrap_or(default.persistence),
    };
    levels.checked().map_err(|refused| section.refuse_setting(&refused))
}

/// The levels of every fault.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct HealthConfig {
    /// In the order of [`FaultId::ALL`].
    levels: [Levels; FaultId::COUNT],
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
        let common = levels(section, Levels::default())?;
        let faults = section.section("fault", &FaultId::NAMES)?;
        let mut of_faults = [common; FaultId::COUNT];
        for (own, name) in of_faults.iter_mut().zip(FaultId::NAMES) {
            *own = levels(&faults.section(name, KEYS)?, common)?;
        }
        Ok(Self { levels: of_faults })
    }

    /// Levels of every fault, in the order of [`FaultId::ALL`].
    #[must_use]
    pub fn levels(&self) -> &[Levels; FaultId::COUNT] {
        &self.levels
    }

    /// Levels of the fault called `name`.
    #[must_use]
    pub fn levels_of(&self, name: &str) -> Option<&Levels> {
        FaultId::from_name(name).map(|fault| &self.levels[fault.index()])
    }
}

impl Serialize for HealthConfig {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        FaultId::NAMES
            .iter()
            .zip(&self.levels)
            .collect::<BTreeMap<_, _>>()
            .serialize(serializer)
    }
}
