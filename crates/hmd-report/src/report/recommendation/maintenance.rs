//! What to do about worn parts, and by when.

use ema_models::FaultId;
use hmd_core::health::HealthState;

use super::super::axis::continuous_hours;
use super::super::history::{History, hours_of, is_elapsed};
use super::super::rules::Rules;
use super::super::words::{duration, with_capital};
use super::super::zone::Zone;
use super::left::{HOURS_TO_PLAN, Left};

/// Nanoseconds of an hour.
const NS_PER_H: f64 = 3.6e12;

/// A sentence for each state, the worst first, with all parts that are in it; parts without a forecast have one of their own, and so has a
/// requirement that is missed before a part fails.
pub(super) fn maintenance(history: &History, left: &Left, rules: &Rules, zone: &Zone) -> String {
    let mut sentences = Vec::new();
    let mut named: Vec<&str> = Vec::new();
    if left.in_state(left.state).is_empty() {
        sentences.push(sentence(history, left.state, "actuator", None, rules, zone));
    }
    for state in [HealthState::Critical, HealthState::Warning, HealthState::Watch] {
        let deadline = |fault: FaultId| match state {
            HealthState::Critical => None,
            _ => hours_until_critical(history, left, fault, rules),
        };
        let with_deadline = left.in_state(state).into_iter().map(|fault| (fault, deadline(fault)));
        let (planned, open): (Vec<_>, Vec<_>) = with_deadline.partition(|(_, deadline)| deadline.is_some());
        for faults in [planned, open].iter().filter(|faults| !faults.is_empty()) {
            let mut parts: Vec<&str> = Vec::new();
            for part in faults.iter().map(|(fault, _)| fault.part()) {
                // A part of what a worse sentence names, as the gear is of "bearings, gear and screw", has one action.
                if !named.iter().any(|whole| whole.contains(part)) {
                    named.push(part);
                    parts.push(part);
                }
            }
            if parts.is_empty() {
                continue;
            }
            let deadline = faults
                .iter()
                .filter_map(|(_, deadline)| *deadline)
                .min_by(f64::total_cmp);
            sentences.push(sentence(history, state, &parts.join("; "), deadline, rules, zone));
        }
    }
    sentences.extend(by_requirement(history, left, rules, zone));
    sentences.join(" ")
}

/// By when the actuator may miss a requirement of its specification; `None` where [`at_once`] says it.
fn by_requirement(history: &History, left: &Left, rules: &Rules, zone: &Zone) -> Option<String> {
    let requirement = left.requirement.as_ref().filter(|_| !left.ends_at_once())?;
    let [p10, ..] = left.hours.filter(|_| left.state < HealthState::Critical)?;
    let hours = p10 - hours_between(history, forecast_ns(history), newest_ns(history)) - rules.critical_h;
    let what = if rules.critical_h > 0.0 {
        "be critical by"
    } else {
        "miss"
    };
    Some(format!(
        "Inspect the actuator {}: it may {what} the requirement {requirement} of its specification then.",
        within(history, hours.max(0.0), zone)
    ))
}

/// What to do where so little life is left, whatever the state by damage: a requirement that is missed, or a part that ends. Empty where there
/// is time, or another sentence says it.
pub(super) fn at_once(left: &Left) -> String {
    let Some([_, p50, _]) = left.hours.filter(|_| left.ends_at_once()) else {
        return String::new();
    };
    match (&left.requirement, left.ends_first) {
        (Some(requirement), _) if p50 <= 0.0 => {
            format!(
                "Inspect before the next use: the actuator misses the requirement {requirement} of its specification."
            )
        }
        (Some(requirement), _) => format!(
            "Inspect before the next use: the actuator may miss the requirement {requirement} of its specification in less than \
             {HOURS_TO_PLAN:.0} h."
        ),
        // A worn part has its own sentence.
        (None, Some(fault)) if left.reported.contains(&fault) => String::new(),
        (None, None) if left.state >= HealthState::Watch => String::new(),
        (None, fault) => {
            let part = fault.map_or("actuator", FaultId::part);
            format!("Inspect before the next use: {part}. Its life may end in less than {HOURS_TO_PLAN:.0} h.")
        }
    }
}

/// Hours from the newest window until one of ten such actuators is `critical` by a fault: the share of the 10 % quantile to the end of life that its
/// damage, as it was last shown, had left to that level; or until the hours left are fewer than `rul.critical_h`. A damage that grows ever faster
/// takes longer for it. Derived here. `None` without a forecast, and where the levels are not known and some life is left.
fn hours_until_critical(history: &History, left: &Left, fault: FaultId, rules: &Rules) -> Option<f64> {
    let rul = &history.newest.rul;
    // A requirement of the specification is missed by all faults together.
    let of_all = left
        .hours
        .filter(|_| left.ends_first == Some(fault) && left.requirement.is_none());
    let [p10, ..] = rul.faults()[fault.index()].or(of_all)?;
    let life = of_all.map_or(p10, |[of_all, ..]| of_all.min(p10));
    let (forecast, newest) = (forecast_ns(history), newest_ns(history));
    let until_end = life - hours_between(history, forecast, newest);
    if !rules.are_levels_of_windows {
        return Some(until_end).filter(|hours| *hours < HOURS_TO_PLAN);
    }
    let mode = rules.of(fault);
    let critical = mode
        .severity
        .iter()
        .find(|severity| severity.class == HealthState::Critical)?;
    let shown = history.newest.shown.of(fault);
    let (damage, shown) = shown.map_or((0.0, newest), |shown| (shown.damage, shown.t_start_ns));
    let share = (critical.damage - damage) / (mode.end_of_life - damage).max(f64::MIN_POSITIVE);
    // From when the damage was shown on, not from the newest window, which may not show it.
    let when_shown = p10 + hours_between(history, shown, forecast);
    let by_damage = when_shown * share.clamp(0.0, 1.0) - hours_between(history, shown, newest);
    Some(by_damage.min(until_end - rules.critical_h).max(0.0))
}

/// Start of the newest window, UTC ns.
fn newest_ns(history: &History) -> u64 {
    history.points.last().map_or(0, |point| point.t_start_ns)
}

/// Start of the window after which the remaining life was predicted, UTC ns.
fn forecast_ns(history: &History) -> u64 {
    match history.newest.rul.t_start_ns {
        0 => newest_ns(history),
        t_ns => t_ns,
    }
}

/// Hours of the kind that the forecast counts from one window to a later one, by their starts, UTC ns.
fn hours_between(history: &History, from_ns: u64, to_ns: u64) -> f64 {
    if is_elapsed(&history.newest.rul) {
        return to_ns.saturating_sub(from_ns) as f64 / NS_PER_H;
    }
    let hours = continuous_hours(history);
    let at = |t_ns: u64| {
        let n = history.points.iter().rposition(|point| point.t_start_ns == t_ns)?;
        Some(hours[n])
    };
    match (at(from_ns), at(to_ns)) {
        (Some(from), Some(to)) => (to - from).max(0.0),
        _ => 0.0,
    }
}

/// A time from the newest window on, in words, with its date where the clock counts it.
fn within(history: &History, hours: f64, zone: &Zone) -> String {
    let rul = &history.newest.rul;
    let date = is_elapsed(rul).then(|| {
        let end_ns = newest_ns(history).saturating_add((hours * NS_PER_H) as u64);
        format!(", by {}", zone.minute(end_ns))
    });
    format!(
        "within {}{}{}",
        duration(hours),
        hours_of(rul),
        date.unwrap_or_default()
    )
}

fn sentence(
    history: &History,
    state: HealthState,
    parts: &str,
    deadline_h: Option<f64>,
    rules: &Rules,
    zone: &Zone,
) -> String {
    let action_of = |state: HealthState| {
        // The same for all faults.
        let class = rules.modes[0].severity.iter().find(|severity| severity.class == state);
        with_capital(class.map_or("", |severity| severity.action))
    };
    let action = action_of(state);
    match (state, deadline_h) {
        (HealthState::Watch | HealthState::Warning, Some(hours)) if hours < HOURS_TO_PLAN => {
            let action = match state {
                HealthState::Watch => "Inspect before the next use".to_owned(),
                _ => action_of(HealthState::Critical),
            };
            format!("{action}: {parts}. It may be critical in less than {HOURS_TO_PLAN:.0} h.")
        }
        (HealthState::Watch, Some(hours)) => {
            format!(
                "{action}: {parts}, at the latest {}: it may be critical then.",
                within(history, hours, zone)
            )
        }
        (HealthState::Warning, Some(hours)) => {
            format!(
                "{action}: {parts}, to be done {}: it may be critical then.",
                within(history, hours, zone)
            )
        }
        (HealthState::Warning, None) => {
            let lacking = match rules.are_levels_of_windows {
                true => "a forecast",
                false => "a forecast by its own levels (-c CONFIG)",
            };
            format!("{action}: {parts}, at the next scheduled maintenance at the latest, for want of {lacking}.")
        }
        _ => format!("{action}: {parts}."),
    }
}
