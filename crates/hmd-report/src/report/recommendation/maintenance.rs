//! What to do about worn parts, and by when.

use ema_models::FaultId;
use hmd_core::catalogue::FaultMode;
use hmd_core::health::HealthState;

use super::super::history::{History, hours_of, is_elapsed};
use super::super::words::{duration, with_capital};
use super::super::zone::Zone;
use super::left::{HOURS_TO_PLAN, Left};

/// Nanoseconds of an hour.
const NS_PER_H: f64 = 3.6e12;

/// A sentence for each state, the worst first, with all parts that are in it; parts without a forecast have one of their own.
pub(super) fn maintenance(history: &History, left: &Left, modes: &[FaultMode; FaultId::COUNT], zone: &Zone) -> String {
    let mut sentences = Vec::new();
    if left.in_state(left.state).is_empty() {
        sentences.push(sentence(history, left.state, "actuator", None, modes, zone));
    }
    for state in [HealthState::Critical, HealthState::Warning, HealthState::Watch] {
        let deadline = |fault: FaultId| match state {
            HealthState::Critical => None,
            _ => hours_until_critical(history, left, fault, modes),
        };
        let with_deadline = left.in_state(state).into_iter().map(|fault| (fault, deadline(fault)));
        let (planned, open): (Vec<_>, Vec<_>) = with_deadline.partition(|(_, deadline)| deadline.is_some());
        for faults in [planned, open].iter().filter(|faults| !faults.is_empty()) {
            let mut parts: Vec<&str> = Vec::new();
            for part in faults.iter().map(|(fault, _)| fault.part()) {
                if !parts.contains(&part) {
                    parts.push(part);
                }
            }
            let deadline = faults
                .iter()
                .filter_map(|(_, deadline)| *deadline)
                .min_by(f64::total_cmp);
            sentences.push(sentence(history, state, &parts.join("; "), deadline, modes, zone));
        }
    }
    sentences.join(" ")
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

/// Hours after which one of ten such actuators is `critical` by a fault: the share of the 10 % quantile to the end of life that its damage has left
/// to that level. A damage that grows ever faster takes longer for it. Derived here.
fn hours_until_critical(
    history: &History,
    left: &Left,
    fault: FaultId,
    modes: &[FaultMode; FaultId::COUNT],
) -> Option<f64> {
    let rul = &history.newest.rul;
    let is_first = left.ends_first == Some(fault);
    let [p10, ..] = rul.faults()[fault.index()].or(left.hours.filter(|_| is_first))?;
    let mode = &modes[fault.index()];
    let critical = mode
        .severity
        .iter()
        .find(|severity| severity.class == HealthState::Critical)?;
    let damage = history.newest.shown.of(fault).map_or(0.0, |shown| shown.damage);
    let share = (critical.damage - damage) / (mode.end_of_life - damage).max(f64::MIN_POSITIVE);
    let by_damage = p10 * share.clamp(0.0, 1.0);
    // A requirement of the specification may end the life before.
    Some(
        left.hours
            .filter(|_| is_first)
            .map_or(by_damage, |[p10, ..]| by_damage.min(p10)),
    )
}

fn sentence(
    history: &History,
    state: HealthState,
    parts: &str,
    deadline_h: Option<f64>,
    modes: &[FaultMode; FaultId::COUNT],
    zone: &Zone,
) -> String {
    let action_of = |state: HealthState| {
        // The same for all faults.
        let class = modes[0].severity.iter().find(|severity| severity.class == state);
        with_capital(class.map_or("", |severity| severity.action))
    };
    let action = action_of(state);
    let within = |hours: f64| {
        let rul = &history.newest.rul;
        let date = is_elapsed(rul).then(|| {
            let end_ns = rul.t_start_ns.saturating_add((hours * NS_PER_H) as u64);
            format!(", by {}", zone.minute(end_ns))
        });
        format!(
            "within {}{}{}",
            duration(hours),
            hours_of(rul),
            date.unwrap_or_default()
        )
    };
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
                within(hours)
            )
        }
        (HealthState::Warning, Some(hours)) => {
            format!("{action}: {parts}, {}: it may be critical then.", within(hours))
        }
        (HealthState::Warning, None) => {
            format!("{action}: {parts}, at the next scheduled maintenance at the latest, for want of a forecast.")
        }
        _ => format!("{action}: {parts}."),
    }
}
