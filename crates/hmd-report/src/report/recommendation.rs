//! One recommendation per actuator: which part, what to do, until when, since when. Overview and page print the same one.

use ema_models::FaultId;
use hmd_core::catalogue::FaultMode;
use hmd_core::health::HealthState;
use hmd_core::history::ReplacedPart;
use hmd_core::record::Rul;
use hmd_core::sensor_checks::Suspect;

use super::axis::{Mark, marks_before};
use super::history::{History, Point, Unassessed, hours_of};
use super::words::{duration, hours, with_capital};

/// What a mechanic needs to know of one actuator.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Recommendation {
    /// State of health after the newest window.
    pub(super) state: HealthState,
    /// The fault that the state is about; `None` where no part is worn.
    pub(super) fault: Option<FaultId>,
    /// What to do, a sentence.
    pub(super) action: String,
    /// Hours left to the end of life, 10 %, 50 % and 90 % quantile; or why there is no number.
    pub(super) hours_left: Result<[f64; 3], String>,
    /// Start of the first window since which the state was this or worse (`nominal`: was this), UTC ns.
    pub(super) since_ns: Option<u64>,
    /// The newest windows, where they could not be assessed.
    pub(super) unassessed: Option<Unassessed>,
    /// Faults that no window has shown, in the order of [`FaultId::ALL`].
    pub(super) unknown: Vec<FaultId>,
}

/// Below so many hours there is nothing to plan.
const HOURS_TO_PLAN: f64 = 1.0;

/// What to do where no sensor is named and windows in a row could not be assessed; their reason stands beside it.
const CHECK_WHAT_HINDERS: &str = "Check sensors, wiring and supply, and for a jam, before the next use.";

impl Recommendation {
    /// Life left, or why there is no number.
    pub(super) fn life_left(&self) -> String {
        match &self.hours_left {
            Ok([.., p90]) if *p90 <= 0.0 => "none: its end of life is reached".to_owned(),
            Ok(left) => hours(*left),
            Err(reason) => format!("no number: {reason}"),
        }
    }
}

/// The recommendation after the newest window; `modes` has the levels, in the order of [`FaultId::ALL`].
pub(super) fn recommendation(history: &History, modes: &[FaultMode; FaultId::COUNT]) -> Recommendation {
    let (health, rul) = &history.newest;
    let state = HealthState::named(&health.health);
    let worst = worst_fault(history, |_| true);
    // What a new part leaves to be done; of its own faults nothing is known before the next window.
    let is_left = |fault: FaultId| !history.replaced_since.iter().any(|part| clears(*part, fault));
    let left = worst_fault(history, is_left);
    let replaced = replaced(&history.replaced_since);
    let unassessed = history.unassessed();
    let states = history.states();
    let is_unknown = |fault: &FaultId| states[fault.index()] == HealthState::Unknown;
    let unknown: Vec<FaultId> = FaultId::ALL.into_iter().filter(is_unknown).collect();
    let checks = match (checks(&health.suspects), &unassessed) {
        (checks, _) if !checks.is_empty() => format!("Check {checks}."),
        (_, Some(Unassessed { windows: 2.., .. })) if state != HealthState::Unknown => CHECK_WHAT_HINDERS.to_owned(),
        _ => String::new(),
    };
    let action = match (state, left) {
        (HealthState::Unknown | HealthState::Nominal, _) | (_, None) if !replaced.is_empty() => String::new(),
        (HealthState::Unknown, _) if !checks.is_empty() => "Nothing is known yet.".to_owned(),
        (HealthState::Unknown, _) if unknown.len() < FaultId::COUNT => {
            "Not everything is known yet: see what no window has shown.".to_owned()
        }
        (HealthState::Unknown, _) if health.reason.is_empty() => {
            "Nothing is known yet: no window was assessed.".to_owned()
        }
        (HealthState::Unknown, _) => format!("Nothing is known yet: {}.", health.reason),
        (HealthState::Nominal, _) if !checks.is_empty() => String::new(),
        (HealthState::Nominal, _) if unassessed.is_some() => "Nothing before the next actuation.".to_owned(),
        (HealthState::Nominal, _) => "No action.".to_owned(),
        (_, Some(fault)) if left != worst => {
            let state = history.states()[fault.index()].max(HealthState::Watch);
            let hours = rul.faults()[fault.index()];
            let life_left = hours.map(|hours| LifeLeft {
                hours,
                of: hours_of(rul),
            });
            maintenance(left, state, life_left, modes)
        }
        _ => maintenance(left, state, life_left(rul), modes),
    };
    let sentences = [action, replaced, checks];
    let fault = left.or(worst).filter(|_| state > HealthState::Nominal);
    Recommendation {
        state,
        fault,
        action: sentences
            .into_iter()
            .filter(|text| !text.is_empty())
            .collect::<Vec<_>>()
            .join(" "),
        hours_left: life_left(rul).map(|left| left.hours).ok_or_else(|| match &*rul.reason {
            "" => "none was recorded".to_owned(),
            reason => reason.to_owned(),
        }),
        since_ns: since(history, state, fault),
        unassessed,
        unknown,
    }
}

/// What to do about the part of a fault, or about the actuator, in this state and with these hours left (quantiles).
fn maintenance(
    fault: Option<FaultId>,
    state: HealthState,
    life_left: Option<LifeLeft>,
    modes: &[FaultMode; FaultId::COUNT],
) -> String {
    let what = fault.map_or("actuator", FaultId::part);
    let severity = modes[fault.map_or(0, FaultId::index)].severity;
    let action_of = |state: HealthState| {
        let class = severity.iter().find(|severity| severity.class == state);
        with_capital(class.map_or("", |severity| severity.action))
    };
    let action = action_of(state);
    // By when nine of ten such actuators still work.
    match (state, life_left) {
        (HealthState::Watch | HealthState::Warning, Some(LifeLeft { hours: [p10, ..], .. })) if p10 < HOURS_TO_PLAN => {
            let action = match state {
                HealthState::Watch => "Inspect before the next use".to_owned(),
                _ => action_of(HealthState::Critical),
            };
            format!("{action}: {what}. It may last less than {HOURS_TO_PLAN:.0} h more.")
        }
        (HealthState::Watch, Some(LifeLeft { hours: [p10, ..], of })) => {
            format!("{action}: {what}, at the latest within {}{of}.", duration(p10))
        }
        (HealthState::Warning, Some(LifeLeft { hours: [p10, ..], of })) => {
            format!("{action}: {what}, within {}{of}.", duration(p10))
        }
        (HealthState::Warning, None) => {
            format!("{action}: {what}, at the next scheduled maintenance at the latest, for want of a forecast.")
        }
        _ => format!("{action}: {what}."),
    }
}

/// Whether nothing is known of this fault once the part, or the actuator (`None`), is another one.
fn clears(part: Option<ReplacedPart>, fault: FaultId) -> bool {
    part.is_none_or(|part| part.faults().contains(&fault))
}

/// What was replaced since the newest window, a sentence; empty if nothing was.
fn replaced(parts: &[Option<ReplacedPart>]) -> String {
    let (verb, shows) = match parts.len() {
        0 => return String::new(),
        1 => ("was", "its"),
        _ => ("were", "their"),
    };
    let names: Vec<&str> = parts
        .iter()
        .map(|part| part.map_or("actuator", ReplacedPart::name))
        .collect();
    let names = names.join(" and the ");
    format!("The {names} {verb} replaced after the last window: the next actuation shows {shows} health.")
}

/// What to look at besides the actuator, for these suspects of a record; each once.
fn checks(suspects: &[String]) -> String {
    let mut found: Vec<&str> = Vec::new();
    for suspect in suspects.iter().filter_map(|name| Suspect::from_name(name)) {
        if !found.contains(&suspect.to_check()) {
            found.push(suspect.to_check());
        }
    }
    found.join("; ")
}

/// Hours left: 10 %, 50 % and 90 % quantile, and what they are hours of, as words that follow a number.
#[derive(Clone, Copy)]
struct LifeLeft {
    hours: [f64; 3],
    of: &'static str,
}

fn life_left(rul: &Rul) -> Option<LifeLeft> {
    let hours = [rul.rul_p10_h?, rul.rul_p50_h?, rul.rul_p90_h?];
    Some(LifeLeft {
        hours,
        of: hours_of(rul),
    })
}

/// Of the faults that count, the reported one with the worst state, then the largest damage. Where no fault at all is reported, the one
/// whose trend ends the life first.
fn worst_fault(history: &History, counts: impl Fn(FaultId) -> bool) -> Option<FaultId> {
    let states = history.states();
    let is_reported = |fault: &FaultId| states[fault.index()] >= HealthState::Watch;
    if !FaultId::ALL.iter().any(is_reported) {
        return FaultId::from_name(&history.newest.1.dominant_fault).filter(|fault| counts(*fault));
    }
    let reported = FaultId::ALL
        .into_iter()
        .filter(|fault| is_reported(fault) && counts(*fault));
    let damage = |fault: FaultId| history.shown.of(fault).map_or(0.0, |shown| shown.damage);
    reported.max_by(|a, b| {
        let by_state = states[a.index()].cmp(&states[b.index()]);
        by_state.then(damage(*a).total_cmp(&damage(*b)))
    })
}

/// Start of the oldest window of the newest run of windows in this state or a worse one (`nominal`: in this state) that reported the fault where the newest did, since the
/// last reset.
fn since(history: &History, state: HealthState, fault: Option<FaultId>) -> Option<u64> {
    let reports = |point: &Point| fault.is_some_and(|fault| point.faults.iter().any(|name| name == fault.name()));
    let assessed = history.points.iter().rfind(|point| point.estimate.is_some());
    let is_reported = assessed.or(history.points.last()).is_some_and(reports);
    let mut since = None;
    for n in (0..history.points.len()).rev() {
        let point = &history.points[n];
        // One that did not show it says nothing of it.
        let was_silent = point.estimate.is_none();
        let of_point = HealthState::named(&point.health);
        if of_point == HealthState::Unknown && was_silent && state != HealthState::Unknown {
            continue;
        }
        let is_another = match state {
            HealthState::Nominal => of_point != state,
            _ => of_point < state,
        };
        if is_another || (is_reported && !was_silent && !reports(point)) {
            break;
        }
        since = Some(point.t_start_ns);
        let begins_anew = |mark: &Mark| matches!(mark, Mark::Unit | Mark::Reset);
        if n > 0 && marks_before(history, n).iter().any(begins_anew) {
            break;
        }
    }
    since
}

#[cfg(test)]
mod tests;
