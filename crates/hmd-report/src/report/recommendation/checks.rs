//! What to look at besides worn parts: sensors, and what hinders the motion.

use hmd_core::assess::LOCKED;
use hmd_core::health::HealthState;
use hmd_core::history::{FELL, FELL_ADVICE, ReplacedPart};
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

/// The sensors, wires and numbers that the newest window suspects, without those replaced since.
pub(super) fn suspects(history: &History) -> Vec<Suspect> {
    let names = &history.newest.health.suspects;
    let is_left = |suspect: &Suspect| !is_replaced(history, |part| part.suspects().contains(suspect));
    let found = names.iter().filter_map(|name| Suspect::from_name(name));
    found.filter(is_left).collect()
}

/// The quantities of sensors that drift, without those replaced since.
pub(in super::super) fn drifting(history: &History) -> Vec<SensorQuantity> {
    let names = &history.sensors.drifting;
    let is_left = |quantity: &SensorQuantity| !is_replaced(history, |part| part.sensors().contains(quantity));
    let found = names.iter().filter_map(|name| SensorQuantity::from_name(name));
    found.filter(is_left).collect()
}

/// Whether the actuator was replaced after the newest window, or such a part.
fn is_replaced(history: &History, is_meant: impl Fn(ReplacedPart) -> bool) -> bool {
    let mut since = history.replaced_since.iter();
    since.any(|replacement| replacement.part.is_none_or(&is_meant))
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
    let health = &history.newest.health;
    let mut found: Vec<&str> = Vec::new();
    let suspects = suspects(history).into_iter().map(Suspect::to_check);
    for what in suspects.chain(drifting(history).into_iter().map(SensorQuantity::to_check)) {
        if !found.contains(&what) {
            found.push(what);
        }
    }
    // A jam sits in motor or gear. Of another actuator, old windows say nothing.
    let is_another = is_replaced(history, |_| false);
    let moves_anew = is_replaced(history, |part| part != ReplacedPart::Controller);
    let unassessed = unassessed.filter(|_| !is_another);
    let is_jammed = unassessed.is_some() && health.reason.contains(LOCKED);
    let is_known = HealthState::named(&health.health) != HealthState::Unknown
        || history.points.iter().any(|point| point.estimate.is_some());
    match unassessed {
        _ if is_jammed && !moves_anew && found.is_empty() => CHECK_FOR_A_JAM.to_owned(),
        _ if is_jammed && !moves_anew => format!("{CHECK_FOR_A_JAM} Check {}.", found.join("; ")),
        _ if !found.is_empty() => format!("Check {}, before any part.", found.join("; ")),
        _ if is_jammed => String::new(),
        Some(Unassessed { windows: 2.., .. }) if is_known => CHECK_WHAT_HINDERS.to_owned(),
        Some(Unassessed { windows: 2.., .. }) => CHECK_ALL.to_owned(),
        _ => String::new(),
    }
}
