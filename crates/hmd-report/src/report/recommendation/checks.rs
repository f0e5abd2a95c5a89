//! What to look at besides worn parts: sensors, and what hinders the motion.

use hmd_core::assess::LOCKED;
use hmd_core::health::HealthState;
use hmd_core::history::{FELL, FELL_ADVICE};
use hmd_core::sensor_checks::Suspect;
use hmd_core::sensor_health::SensorQuantity;

use super::super::history::{History, Unassessed};

/// What to do where no sensor is named and windows in a row could not be assessed; their reason stands beside it.
pub(super) const CHECK_WHAT_HINDERS: &str = "Check sensors, wiring and supply, and for a jam, before the next use.";

/// What to do where the motor did not turn in the newest window.
pub(super) const CHECK_FOR_A_JAM: &str = "Check for a jam before the next use.";

/// The same where no window was assessed ever: the configuration may be wrong as well.
pub(super) const CHECK_ALL: &str = "Check sensors, wiring, supply and configuration, and for a jam.";

/// Whether these checks do not wait for maintenance.
pub(super) fn is_before_next_use(checks: &str) -> bool {
    [CHECK_WHAT_HINDERS, CHECK_FOR_A_JAM]
        .iter()
        .any(|urgent| checks.starts_with(urgent))
}

/// What to check, in sentences; empty if nothing is.
pub(super) fn checks(history: &History, unassessed: Option<Unassessed>) -> String {
    let mut sentences = of_sensors(history, unassessed);
    if history.has_fallen() {
        let space = if sentences.is_empty() { "" } else { " " };
        sentences += &format!("{space}A {FELL}: {FELL_ADVICE}.");
    }
    sentences
}

fn of_sensors(history: &History, unassessed: Option<Unassessed>) -> String {
    let health = &history.newest.0;
    let suspects = health.suspects.iter().filter_map(|name| Suspect::from_name(name));
    let drifting = history
        .sensors
        .drifting
        .iter()
        .filter_map(|name| SensorQuantity::from_name(name));
    let mut found: Vec<&str> = Vec::new();
    for what in suspects
        .map(Suspect::to_check)
        .chain(drifting.map(SensorQuantity::to_check))
    {
        if !found.contains(&what) {
            found.push(what);
        }
    }
    let is_jammed = unassessed.is_some() && health.reason.contains(LOCKED);
    let is_known = HealthState::named(&health.health) != HealthState::Unknown;
    match unassessed {
        _ if is_jammed && found.is_empty() => CHECK_FOR_A_JAM.to_owned(),
        _ if is_jammed => format!("{CHECK_FOR_A_JAM} Check {}.", found.join("; ")),
        _ if !found.is_empty() => format!("Check {}, before any part.", found.join("; ")),
        Some(Unassessed { windows: 2.., .. }) if is_known => CHECK_WHAT_HINDERS.to_owned(),
        Some(Unassessed { windows: 2.., .. }) => CHECK_ALL.to_owned(),
        _ => String::new(),
    }
}
