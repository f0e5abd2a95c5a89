//! One recommendation per actuator: which parts, what to do, until when, since when. Overview and page print the same one.

mod awaited;
mod checks;
mod friction;
mod left;
mod maintenance;
mod since;

use ema_models::FaultId;
use hmd_core::health::HealthState;
use hmd_core::history::ReplacedPart;

use super::history::{History, Replacement, Unassessed, hours_of_all};
use super::rules::Rules;
use super::zone::Zone;
use awaited::awaited;
pub(super) use checks::drifting;
use checks::{checks, is_before_next_use};
pub(super) use friction::friction_replaced;
use left::Left;
use maintenance::{at_once, maintenance};
use since::{since, suspected_since};

/// What a mechanic needs to know of one actuator.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Recommendation {
    /// State of health after the newest window, of what was not replaced since.
    pub(super) state: HealthState,
    /// The faults that the state is about, the worst first; none where no part is worn.
    pub(super) faults: Vec<FaultId>,
    /// What to do, in sentences.
    pub(super) action: String,
    /// Hours left to the end of life, 10 %, 50 % and 90 % quantile; or why there is no number.
    pub(super) hours_left: Result<[f64; 3], String>,
    /// The fault whose trend ends the life first.
    pub(super) ends_first: Option<FaultId>,
    /// The requirement of the specification that is missed then, in words, where a damage does not end the life.
    pub(super) requirement: Option<String>,
    /// Start of the first window since which the state was this or worse (`nominal`: was this), UTC ns.
    pub(super) since_ns: Option<u64>,
    /// Start of the first window since which a sensor is suspected in each, UTC ns.
    pub(super) suspected_since_ns: Option<u64>,
    /// The newest windows, where they could not be assessed.
    pub(super) unassessed: Option<Unassessed>,
    /// Faults that no window has shown, in the order of [`FaultId::ALL`].
    pub(super) unknown: Vec<FaultId>,
    /// Whether something besides a worn part is to be checked.
    pub(super) has_checks: bool,
    /// Whether that is to be done before the next use.
    pub(super) is_before_next_use: bool,
}

/// Why there are no hours of a part that was replaced.
const REPLACED: &str = "what ended it first was replaced";

/// The same where there were none before.
const PART_REPLACED: &str = "the actuator, or a part of it, was replaced since";

impl Recommendation {
    /// Life left, or why there is no number.
    pub(super) fn life_left(&self) -> String {
        match &self.hours_left {
            Ok([.., p90]) if *p90 <= 0.0 => "none: its end of life is reached".to_owned(),
            Ok(left) => super::words::hours(*left),
            Err(reason) => format!("no number: {reason}"),
        }
    }
}

/// The recommendation after the newest window.
pub(super) fn recommendation(history: &History, rules: &Rules, zone: &Zone) -> Recommendation {
    let (health, rul) = (&history.newest.health, &history.newest.rul);
    let left = Left::of(history);
    let unassessed = history.unassessed();
    let unknown: Vec<FaultId> = FaultId::ALL
        .into_iter()
        .filter(|fault| left.states[fault.index()] == HealthState::Unknown)
        .collect();
    let replaced = replaced(&history.replaced_since, zone);
    let checks = checks(history, unassessed);
    let friction_left = left.friction_left.map_or_else(String::new, |left| {
        format!("Friction was critical and may still come from {left}: check before the next use.")
    });
    let entered = entered(&history.entered_since, zone);
    let at_once = at_once(&left);
    let awaited = awaited(history, &left, rules);
    let action = match left.state {
        HealthState::Watch | HealthState::Warning | HealthState::Critical => maintenance(history, &left, rules, zone),
        _ if !replaced.is_empty() || !at_once.is_empty() => String::new(),
        HealthState::Unknown if unknown.len() < FaultId::COUNT => {
            "Not everything is known yet: scheduled inspections stand as they are.".to_owned()
        }
        HealthState::Unknown if !checks.is_empty() => "Nothing is known yet.".to_owned(),
        HealthState::Unknown if health.reason.is_empty() => "Nothing is known yet: no window was assessed.".to_owned(),
        HealthState::Unknown => format!("Nothing is known yet: {}.", health.reason),
        HealthState::Nominal if !checks.is_empty() || !awaited.is_empty() => String::new(),
        HealthState::Nominal if unassessed.is_some() => "Nothing before the next actuation.".to_owned(),
        HealthState::Nominal => "No action.".to_owned(),
    };
    let sentences = [
        &action,
        &at_once,
        &replaced,
        &friction_left,
        &entered,
        &awaited,
        &checks,
    ];
    let since_ns = since(history, &left);
    let faults = left.reported.clone();
    Recommendation {
        state: left.state,
        action: sentences
            .into_iter()
            .filter(|text| !text.is_empty())
            .map(String::as_str)
            .collect::<Vec<_>>()
            .join(" "),
        hours_left: match left.hours {
            Some(hours) => Ok(hours),
            None if hours_of_all(rul).is_some() => Err(REPLACED.to_owned()),
            // The reason may be that of the part.
            None if !history.replaced_since.is_empty() => Err(PART_REPLACED.to_owned()),
            None if rul.reason.is_empty() => Err("none was recorded".to_owned()),
            None => Err(rul.reason.clone()),
        },
        ends_first: left.ends_first,
        requirement: left.requirement,
        since_ns,
        suspected_since_ns: suspected_since(history),
        faults,
        unassessed,
        unknown,
        has_checks: !checks.is_empty() || !awaited.is_empty(),
        is_before_next_use: is_before_next_use(&checks) || !at_once.is_empty() || !friction_left.is_empty(),
    }
}

/// What was replaced since the newest window, when, and what was noted, a sentence; empty if nothing was.
fn replaced(parts: &[Replacement], zone: &Zone) -> String {
    let (verb, shows) = match parts.len() {
        0 => return String::new(),
        1 => ("was", "its"),
        _ => ("were", "their"),
    };
    let names = names(parts, zone);
    format!("The {names} {verb} replaced after the last window: the next actuation shows {shows} health.")
}

/// What was entered as replaced before windows that do not know of it, a sentence; empty if nothing was.
fn entered(parts: &[Replacement], zone: &Zone) -> String {
    if parts.is_empty() {
        return String::new();
    }
    let (names, verb) = (names(parts, zone), if parts.len() == 1 { "is" } else { "are" });
    format!(
        "The {names} {verb} entered as replaced, but these windows were assessed before that: hmd replay of the logs, or the next movement of a running hmd, takes it over."
    )
}

/// Parts with time and note, in words.
fn names(parts: &[Replacement], zone: &Zone) -> String {
    let name = |replacement: &Replacement| {
        let name = replacement.part.map_or("actuator", ReplacedPart::name);
        let note = match &*replacement.note {
            "" => String::new(),
            note => format!(", {note}"),
        };
        format!("{name} ({}{note})", zone.minute(replacement.t_ns))
    };
    let mut all: Vec<String> = parts.iter().map(name).collect();
    match all.pop() {
        Some(last) if !all.is_empty() => format!("{} and the {last}", all.join(", the ")),
        last => last.unwrap_or_default(),
    }
}

#[cfg(test)]
mod tests;
