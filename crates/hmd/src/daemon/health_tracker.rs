//! Tracks the health state of each actuator, and the last change of it.

use std::collections::BTreeMap;

use hmd_core::health::HealthState;
use hmd_core::record::{Health, LogLevel, Sensors};

/// Health of all actuators with an assessment.
#[derive(Debug, Default)]
pub(super) struct HealthTracker(BTreeMap<String, TrackedHealth>);

/// One actuator.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct TrackedHealth {
    /// `nominal`, `watch`, `warning`, `critical` or `unknown`.
    pub(super) health: String,
    /// Windows in a row that ask for a worse state, the most of any fault; the state is reached when they are as many as
    /// the `persistence` of that fault.
    pub(super) persistence: u32,
    /// Level of its sensors, as `health`.
    pub(super) sensors: String,
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
    /// Largest damage in its window; 0 when none was assessed.
    pub(super) damage: f64,
}

/// From good to bad.
const ORDER: [&str; 5] = ["unknown", "nominal", "watch", "warning", "critical"];

impl HealthTracker {
    /// Takes an assessment. Returns a notice for an operator on a change to report; that of a passive actuator is no warning.
    pub(super) fn update(&mut self, health: &Health, persistence: u32, passive: bool) -> Option<(LogLevel, String)> {
        let tracked = self.tracked(&health.actuator);
        tracked.persistence = persistence;
        if tracked.health == health.health {
            return None;
        }
        let from = std::mem::replace(&mut tracked.health, health.health.clone());
        let damage = health.damages().into_iter().flatten().fold(0.0, f64::max);
        let level = reported_level(&from, &health.health, passive);
        let faults = if health.faults.is_empty() {
            "no fault"
        } else {
            &health.faults
        };
        let message = format!(
            "{}: {from} to {} in window {}: {faults}, largest damage {damage:.2}{}",
            health.actuator,
            health.health,
            health.window,
            if passive { " (passive)" } else { "" }
        );
        tracked.changed = Some(Change {
            t_ns: health.t_start_ns,
            from,
            faults: health.faults.clone(),
            damage,
        });
        Some((level?, message))
    }

    /// Takes the health of the sensors after a window, which is news of its own. Returns a notice as [`HealthTracker::update`] does.
    pub(super) fn update_sensors(&mut self, sensors: &Sensors, passive: bool) -> Option<(LogLevel, String)> {
        let tracked = self.tracked(&sensors.actuator);
        if tracked.sensors == sensors.level {
            return None;
        }
        let from = std::mem::replace(&mut tracked.sensors, sensors.level.clone());
        let level = reported_level(&from, &sensors.level, passive)?;
        let drifting = if sensors.drifting.is_empty() {
            "none drifts".to_owned()
        } else {
            format!("{} drifts", sensors.drifting.join(", "))
        };
        let message = format!(
            "{}: sensors {from} to {} in window {}: {drifting}{}",
            sensors.actuator,
            sensors.level,
            sensors.window,
            if passive { " (passive)" } else { "" }
        );
        Some((level, message))
    }

    /// The state that an actuator had when an earlier run ended.
    pub(super) fn resume(&mut self, actuator: &str, state: HealthState) {
        self.tracked(actuator).health = state.name().to_owned();
    }

    fn tracked(&mut self, actuator: &str) -> &mut TrackedHealth {
        self.0.entry(actuator.to_owned()).or_insert_with(TrackedHealth::unknown)
    }

    /// Health of one actuator; `unknown` before its first assessment.
    pub(super) fn health_of(&self, actuator: &str) -> TrackedHealth {
        self.0.get(actuator).cloned().unwrap_or_else(TrackedHealth::unknown)
    }
}

impl TrackedHealth {
    fn unknown() -> Self {
        Self {
            health: ORDER[0].to_owned(),
            sensors: ORDER[0].to_owned(),
            ..Self::default()
        }
    }
}

/// Whether a state is reported, and worse than the one before.
pub(super) fn is_worse(from: &str, to: &str) -> bool {
    reported_level(from, to, false) == Some(LogLevel::Warning)
}

/// How a change of a state is reported: not at all below `watch`, as a warning where it is for the worse.
fn reported_level(from: &str, to: &str, passive: bool) -> Option<LogLevel> {
    let rank = |state: &str| ORDER.iter().position(|of| *of == state);
    let worse = rank(to) > rank(from) && !passive;
    let level = if worse { LogLevel::Warning } else { LogLevel::Info };
    (rank(from) >= rank("watch") || rank(to) >= rank("watch")).then_some(level)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assessed(window: u64, health: &str, friction: f64) -> Health {
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
    fn a_change_is_reported_and_its_values_stay() {
        let mut tracker = HealthTracker::default();
        assert_eq!(tracker.health_of("ema3").health, "unknown");
        assert_eq!(tracker.update(&assessed(0, "nominal", 0.0), 0, false), None);
        assert_eq!(tracker.update(&assessed(1, "nominal", 0.3), 1, false), None);
        assert_eq!(tracker.health_of("ema3").persistence, 1);
        let (level, message) = tracker.update(&assessed(2, "watch", 0.31), 2, false).unwrap();
        assert_eq!(level, LogLevel::Warning);
        assert_eq!(
            message,
            "ema3: nominal to watch in window 2: friction, largest damage 0.31"
        );
        assert_eq!(tracker.update(&assessed(3, "watch", 0.35), 0, false), None);
        let changed = tracker.health_of("ema3").changed.unwrap();
        let expected = Change {
            t_ns: 1002,
            from: "nominal".to_owned(),
            faults: "friction".to_owned(),
            damage: 0.31,
        };
        assert_eq!(changed, expected, "the last change, not the last window");
        let (level, _) = tracker.update(&assessed(4, "nominal", 0.0), 0, false).unwrap();
        assert_eq!(level, LogLevel::Info);
    }

    #[test]
    fn a_drifting_sensor_is_news_of_its_own() {
        let mut tracker = HealthTracker::default();
        let sensors = |level: &str, drifting: &[&str]| Sensors {
            actuator: "ema3".to_owned(),
            window: 12,
            level: level.to_owned(),
            drifting: drifting.iter().map(ToString::to_string).collect(),
            ..Sensors::default()
        };
        assert_eq!(tracker.update_sensors(&sensors("nominal", &[]), false), None);
        let (level, message) = tracker
            .update_sensors(&sensors("watch", &["current_sum_a"]), false)
            .unwrap();
        assert_eq!(level, LogLevel::Warning);
        assert_eq!(
            message,
            "ema3: sensors nominal to watch in window 12: current_sum_a drifts"
        );
        let tracked = tracker.health_of("ema3");
        assert_eq!((&*tracked.health, &*tracked.sensors), ("unknown", "watch"));
        assert_eq!(tracker.update_sensors(&sensors("watch", &[]), false), None);
        let (level, _) = tracker.update_sensors(&sensors("nominal", &[]), false).unwrap();
        assert_eq!(level, LogLevel::Info);
    }

    #[test]
    fn a_passive_actuator_raises_no_warning() {
        let mut tracker = HealthTracker::default();
        let (level, message) = tracker.update(&assessed(0, "critical", 0.9), 0, true).unwrap();
        assert_eq!(level, LogLevel::Info);
        assert!(message.ends_with("(passive)"), "{message}");
    }
}
