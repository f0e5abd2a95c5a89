//! Tracks the health state of each actuator, and the last change of it.

use std::collections::{BTreeMap, BTreeSet};

use ema_models::FaultId;
use hmd_core::health::HealthState;
use hmd_core::history::ResumedState;
use hmd_core::record::{Health, LogLevel, Sensors};
use hmd_core::windows_in_a_row::News;

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
    /// Takes an assessment with the 10 % quantile of the hours left, and what became news by it. Returns notices for an operator: of a change to report, and of that news; those of
    /// a passive actuator are no warnings.
    pub(super) fn update(
        &mut self,
        health: &Health,
        left_p10_h: Option<f64>,
        news: &[News],
        persistence: u32,
        passive: bool,
    ) -> Vec<(LogLevel, String)> {
        let change = self.change(health, left_p10_h, persistence, passive);
        let news = news.iter().map(|news| {
            let is_warning = news.for_the_worse && !passive;
            let level = if is_warning { LogLevel::Warning } else { LogLevel::Info };
            let passive = if passive { " (passive)" } else { "" };
            (level, format!("{}: {}{passive}", health.actuator, news.text))
        });
        change.into_iter().chain(news).collect()
    }

    fn change(
        &mut self,
        health: &Health,
        left_p10_h: Option<f64>,
        persistence: u32,
        passive: bool,
    ) -> Option<(LogLevel, String)> {
        let tracked = self.tracked(&health.actuator);
        tracked.persistence = persistence;
        if tracked.health == health.health {
            return None;
        }
        let from = std::mem::replace(&mut tracked.health, health.health.clone());
        let damage = health.damages().into_iter().flatten().fold(0.0, f64::max);
        let level = reported_level(&from, &health.health, passive);
        let unknown = unknown(health);
        let what = match &*health.faults {
            "" if health.health == ORDER[0] && !unknown.is_empty() => format!("not known: {}", unknown.join(", ")),
            "" => format!("no fault at its level watch (largest damage {damage:.2})"),
            faults => format!("{faults}, largest damage {damage:.2}"),
        };
        let by_life = match left_p10_h {
            Some(p10) if is_by_life(health) => format!(", by its remaining life (p10 {p10:.0} h)"),
            _ => String::new(),
        };
        let message = format!(
            "{}: {from} to {} in window {}: {what}{by_life}{}",
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

    /// What held of an actuator when an earlier run ended.
    pub(super) fn resume(&mut self, actuator: &str, state: &ResumedState) {
        let tracked = self.tracked(actuator);
        tracked.health = state.health.name().to_owned();
        tracked.sensors = state.sensors.name().to_owned();
        tracked.persistence = state.pending;
    }

    /// Notices about actuators at `watch` or worse by an earlier run, of which no window has come yet; those of `passive` ones are no
    /// warnings.
    pub(super) fn resumed(&self, passive: &BTreeSet<String>) -> Vec<(LogLevel, String)> {
        let of_before = self.0.iter().filter(|(_, tracked)| tracked.changed.is_none());
        let is_news = |health: &str| HealthState::named(health) >= HealthState::Watch;
        let of_before = of_before.filter(|(_, tracked)| is_news(&tracked.health));
        of_before
            .map(|(actuator, tracked)| {
                let (level, end) = if passive.contains(actuator) {
                    (LogLevel::Info, " (passive)")
                } else {
                    (LogLevel::Warning, "")
                };
                let health = &tracked.health;
                (
                    level,
                    format!("{actuator}: {health}, as when the run before ended{end}"),
                )
            })
            .collect()
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

/// Whether the state is worse than that of every fault.
fn is_by_life(health: &Health) -> bool {
    let state = HealthState::named(&health.health);
    let worst = health.states().and_then(|states| states.into_iter().max());
    state >= HealthState::Watch && worst.is_some_and(|worst| state > worst)
}

/// The faults that no window has shown.
fn unknown(health: &Health) -> Vec<&'static str> {
    let states = health.states().unwrap_or([HealthState::Nominal; FaultId::COUNT]);
    let named = FaultId::NAMES.into_iter().zip(states);
    named
        .filter(|(_, state)| *state == HealthState::Unknown)
        .map(|(name, _)| name)
        .collect()
}

/// How a change of a state is reported: as a warning where it is for the worse; between `unknown` and `nominal` only what was known and is
/// not any more.
fn reported_level(from: &str, to: &str, passive: bool) -> Option<LogLevel> {
    let rank = |state: &str| ORDER.iter().position(|of| *of == state);
    let worse = rank(to) > rank(from) && !passive;
    let level = if worse { LogLevel::Warning } else { LogLevel::Info };
    let is_news = rank(from) >= rank("watch") || rank(to) >= rank("watch") || to == ORDER[0];
    is_news.then_some(level)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hmd_core::last_window::LastWindow;

    fn assessed(window: u64, health: &str, friction: f64) -> Health {
        let mut health = Health {
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
        };
        let estimate = hmd_core::record::Estimate {
            k: [friction, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.505],
            sigma: [None; 8],
            observable: [true; 8],
        };
        health.set_estimate(Some(&estimate));
        health
    }

    /// The first notice.
    fn update(
        tracker: &mut HealthTracker,
        health: &Health,
        persistence: u32,
        passive: bool,
    ) -> Option<(LogLevel, String)> {
        tracker
            .update(health, Some(200.4), &[], persistence, passive)
            .into_iter()
            .next()
    }

    #[test]
    fn a_health_that_is_no_longer_known_says_of_what() {
        let mut tracker = HealthTracker::default();
        update(&mut tracker, &assessed(0, "nominal", 0.0), 0, false);
        let mut health = assessed(1, "unknown", 0.0);
        let mut states = [HealthState::Nominal; FaultId::COUNT];
        states[6] = HealthState::Unknown;
        health.set_states(&states);
        let (level, message) = update(&mut tracker, &health, 0, false).unwrap();
        assert_eq!(level, LogLevel::Info);
        assert_eq!(message, "ema3: nominal to unknown in window 1: not known: gain");
    }

    #[test]
    fn a_state_by_the_remaining_life_says_so() {
        let mut tracker = HealthTracker::default();
        let mut health = assessed(1, "critical", 0.3);
        let mut states = [HealthState::Nominal; FaultId::COUNT];
        states[0] = HealthState::Watch;
        health.set_states(&states);
        let (_, message) = update(&mut tracker, &health, 0, false).unwrap();
        assert_eq!(
            message,
            "ema3: unknown to critical in window 1: friction, largest damage 0.30, by its remaining life (p10 200 h)"
        );
    }

    #[test]
    fn a_change_is_reported_and_its_values_stay() {
        let mut tracker = HealthTracker::default();
        assert_eq!(tracker.health_of("ema3").health, "unknown");
        assert_eq!(update(&mut tracker, &assessed(0, "nominal", 0.0), 0, false), None);
        assert_eq!(update(&mut tracker, &assessed(1, "nominal", 0.3), 1, false), None);
        assert_eq!(tracker.health_of("ema3").persistence, 1);
        let (level, message) = update(&mut tracker, &assessed(2, "watch", 0.31), 2, false).unwrap();
        assert_eq!(level, LogLevel::Warning);
        assert_eq!(
            message,
            "ema3: nominal to watch in window 2: friction, largest damage 0.31"
        );
        assert_eq!(update(&mut tracker, &assessed(3, "watch", 0.35), 0, false), None);
        let changed = tracker.health_of("ema3").changed.unwrap();
        let expected = Change {
            t_ns: 1002,
            from: "nominal".to_owned(),
            faults: "friction".to_owned(),
            damage: 0.31,
        };
        assert_eq!(changed, expected, "the last change, not the last window");
        let (level, _) = update(&mut tracker, &assessed(4, "nominal", 0.0), 0, false).unwrap();
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
    fn what_an_earlier_run_left_is_told() {
        let mut tracker = HealthTracker::default();
        let state = |health| ResumedState {
            health,
            sensors: HealthState::Watch,
            pending: 1,
            last_window: LastWindow::default(),
        };
        tracker.resume("ema3", &state(HealthState::Critical));
        tracker.resume("ema4", &state(HealthState::Nominal));
        let resumed = tracker.health_of("ema4");
        assert_eq!((&*resumed.sensors, resumed.persistence), ("watch", 1));
        let told = "ema3: critical, as when the run before ended";
        let none = BTreeSet::new();
        assert_eq!(tracker.resumed(&none), [(LogLevel::Warning, told.to_owned())]);
        let passive = BTreeSet::from(["ema3".to_owned()]);
        let expected = (LogLevel::Info, format!("{told} (passive)"));
        assert_eq!(tracker.resumed(&passive), [expected], "no alarm");
        update(&mut tracker, &assessed(0, "warning", 0.3), 0, false);
        assert!(tracker.resumed(&none).is_empty());
    }

    #[test]
    fn a_passive_actuator_raises_no_warning() {
        let mut tracker = HealthTracker::default();
        let (level, message) = update(&mut tracker, &assessed(0, "critical", 0.9), 0, true).unwrap();
        assert_eq!(level, LogLevel::Info);
        assert!(message.ends_with("(passive)"), "{message}");
    }
}
