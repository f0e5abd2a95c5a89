//! What to do about worn parts, and by when.

use ema_models::FaultId;
use hmd_core::catalogue::FaultMode;
use hmd_core::health::HealthState;

use super::super::history::{History, hours_of, is_elapsed};
use super::super::words::{duration, with_capital};
use super::super::zone::Zone;
use super::left::Left;

/// Below so many hours there is nothing to plan.
const HOURS_TO_PLAN: f64 = 1.0;

/// Nanoseconds of an hour.
const NS_PER_H: f64 = 3.6e12;

/// A sentence for each state, the worst first, with all parts that are in it.
pub(super) fn maintenance(history: &History, left: &Left, modes: &[FaultMode; FaultId::COUNT], zone: &Zone) -> String {
    let states = [HealthState::Critical, HealthState::Warning, HealthState::Watch];
    let sentences: Vec<String> = states
        .into_iter()
        .map(|state| (state, left.in_state(state)))
        .filter(|(_, faults)| !faults.is_empty())
        .map(|(state, faults)| {
            let mut parts: Vec<&str> = Vec::new();
            for part in faults.iter().map(|fault| fault.part()) {
                if !parts.contains(&part) {
                    parts.push(part);
                }
            }
            let until_critical = faults
                .iter()
                .filter_map(|fault| hours_until_critical(history, left, *fault, modes));
            let deadline = until_critical.min_by(f64::total_cmp);
            sentence(history, state, &parts.join("; "), deadline, modes, zone)
        })
        .collect();
    if sentences.is_empty() {
        return sentence(history, left.state, "actuator", None, modes, zone);
    }
    sentences.join(" ")
}

/// Hours after which one of ten such actuators is `critical` by a fault: the share of the 10 % quantile to the end of life that its damage has left
/// to that level. A damage that grows ever faster takes longer for it. Derived here.
fn hours_until_critical(
    history: &History,
    left: &Left,
    fault: FaultId,
    modes: &[FaultMode; FaultId::COUNT],
) -> Option<f64> {
    let rul = &history.newest.1;
    let is_first = left.ends_first == Some(fault);
    let [p10, ..] = rul.faults()[fault.index()].or(left.hours.filter(|_| is_first))?;
    let mode = &modes[fault.index()];
    let critical = mode
        .severity
        .iter()
        .find(|severity| severity.class == HealthState::Critical)?;
    let damage = history.shown.of(fault).map_or(0.0, |shown| shown.damage);
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
        let rul = &history.newest.1;
        let newest = history.points.last().map(|point| point.t_start_ns);
        let date = newest.filter(|_| is_elapsed(rul)).map(|t_ns| {
            let end_ns = t_ns.saturating_add((hours * NS_PER_H) as u64);
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
