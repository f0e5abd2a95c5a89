//! Where each actuator stands by its last verdict, and how it came there.

use std::collections::BTreeMap;

use hmd_core::record::{Health, LogLevel};

/// The verdicts of all actuators that had one.
#[derive(Debug, Default)]
pub(super) struct Standings(BTreeMap<String, Standing>);

/// One actuator.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Standing {
    /// `nominal`, `watch`, `warning`, `critical` or `unknown`.
    pub(super) health: String,
    /// Windows in a row that ask for a worse state, the most of any fault; the state is reached when they are as many as
    /// the `persistence` of that fault.
    pub(super) persistence: u32,
    /// The last change of the state; `None` before the first.
    pub(super) changed: Option<Change>,
}

/// A change of the state, with the values that made it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Change {
    /// Start of its window, UTC, ns.
    pub(super) t_ns: u64,
    /// State before.
    pub(super) from: String,
    /// Faults after, joined by commas.
    pub(super) faults: String,
    /// Largest damage in its window; 0 when none was judged.
    pub(super) damage: f64,
}

/// From good to bad.
const ORDER: [&str; 5] = ["unknown", "nominal", "watch", "warning", "critical"];

impl Standings {
    /// Takes a verdict. What an operator should read about it; the change of a passive actuator is for the record alone.
    pub(super) fn take(&mut self, health: &Health, persistence: u32, passive: bool) -> Option<(LogLevel, String)> {
        let standing = self.0.entry(health.actuator.clone()).or_insert_with(|| Standing {
            health: ORDER[0].to_owned(),
            ..Standing::default()
        });
        standing.persistence = persistence;
        if standing.health == health.health {
            return None;
        }
        let from = std::mem::replace(&mut standing.health, health.health.clone());
        let damage = health.damages().into_iter().flatten().fold(0.0, f64::max);
        let rank = |state: &str| ORDER.iter().position(|of| *of == state);
        let told = rank(&from) >= rank("watch") || rank(&health.health) >= rank("watch");
        let worse = rank(&health.health) > rank(&from);
        let level = if worse && !passive {
            LogLevel::Warning
        } else {
            LogLevel::Info
        };
        let faults = if health.faults.is_empty() {
            "no fault"
        } else {
            &health.faults
        };
        let said = format!(
            "{}: {from} to {} in window {}: {faults}, largest damage {damage:.2}{}",
            health.actuator,
            health.health,
            health.window,
            if passive { " (passive)" } else { "" }
        );
        standing.changed = Some(Change {
            t_ns: health.t_start_ns,
            from,
            faults: health.faults.clone(),
            damage,
        });
        told.then_some((level, said))
    }

    /// That of one actuator; an unknown one before its first verdict.
    pub(super) fn of(&self, actuator: &str) -> Standing {
        self.0.get(actuator).cloned().unwrap_or_else(|| Standing {
            health: ORDER[0].to_owned(),
            ..Standing::default()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(window: u64, health: &str, friction: f64) -> Health {
        Health {
            actuator: "ema3".to_owned(),
            window,
            t_start_ns: 1000 + window,
            health: health.to_owned(),
            faults: if friction > 0.2 {
                "friction".to_owned()
            } else {
                String::new()
            },
            damage_friction: Some(friction),
            damage_gain: Some(0.01),
            ..Health::default()
        }
    }

    #[test]
    fn a_change_is_told_and_its_values_stay() {
        let mut standings = Standings::default();
        assert_eq!(standings.of("ema3").health, "unknown");
        assert_eq!(standings.take(&verdict(0, "nominal", 0.0), 0, false), None);
        assert_eq!(standings.take(&verdict(1, "nominal", 0.3), 1, false), None);
        assert_eq!(standings.of("ema3").persistence, 1);
        let (level, said) = standings.take(&verdict(2, "watch", 0.31), 2, false).unwrap();
        assert_eq!(level, LogLevel::Warning);
        assert_eq!(
            said,
            "ema3: nominal to watch in window 2: friction, largest damage 0.31"
        );
        assert_eq!(standings.take(&verdict(3, "watch", 0.35), 0, false), None);
        let changed = standings.of("ema3").changed.unwrap();
        let expected = Change {
            t_ns: 1002,
            from: "nominal".to_owned(),
            faults: "friction".to_owned(),
            damage: 0.31,
        };
        assert_eq!(changed, expected, "the last change, not the last window");
        let (level, _) = standings.take(&verdict(4, "nominal", 0.0), 0, false).unwrap();
        assert_eq!(level, LogLevel::Info);
    }

    #[test]
    fn a_passive_actuator_alarms_nobody() {
        let mut standings = Standings::default();
        let (level, said) = standings.take(&verdict(0, "critical", 0.9), 0, true).unwrap();
        assert_eq!(level, LogLevel::Info);
        assert!(said.ends_with("(passive)"), "{said}");
    }
}
