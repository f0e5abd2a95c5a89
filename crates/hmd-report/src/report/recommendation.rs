//! One recommendation per actuator: which part, what to do, until when, since when. Overview and page print the same one.

use ema_models::FaultId;
use hmd_core::catalogue::FaultMode;
use hmd_core::health::HealthState;
use hmd_core::record::Rul;

use super::axis::{Mark, marks_before};
use super::history::History;

/// What a mechanic needs to know of one actuator.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Recommendation {
    /// State of health after the newest window.
    pub(super) state: HealthState,
    /// The fault that the state is about; `None` where no part is worn.
    pub(super) fault: Option<FaultId>,
    /// What to do, a sentence.
    pub(super) action: String,
    /// Hours left to the end of life: median and 80 % interval.
    pub(super) hours_left: Option<[f64; 3]>,
    /// Start of the first window since which the state was this or worse, UTC ns.
    pub(super) since_ns: Option<u64>,
}

/// The recommendation after the newest window; `modes` has the levels, in the order of [`FaultId::ALL`].
pub(super) fn recommendation(history: &History, modes: &[FaultMode; FaultId::COUNT]) -> Recommendation {
    let (health, rul) = &history.newest;
    let state = HealthState::named(&health.health);
    let fault = worst_fault(history, modes);
    let what = fault.map_or("actuator", FaultId::part);
    let action = match state {
        HealthState::Unknown if health.reason.is_empty() => "Nothing is known yet: no window was assessed.".to_owned(),
        HealthState::Unknown => format!("Nothing is known yet: {}.", health.reason),
        HealthState::Nominal => "No action.".to_owned(),
        _ => {
            let severity = modes[fault.map_or(0, FaultId::index)].severity;
            let class = severity.iter().find(|severity| severity.class == state);
            let action = class.map_or("", |severity| severity.action);
            format!("{}: {what}.", with_capital(action))
        }
    };
    Recommendation {
        state,
        fault: fault.filter(|_| state > HealthState::Nominal),
        action,
        hours_left: hours_left(rul),
        since_ns: since(history, state),
    }
}

/// Hours left: 10 %, 50 % and 90 % quantile.
fn hours_left(rul: &Rul) -> Option<[f64; 3]> {
    Some([rul.rul_p10_h?, rul.rul_p50_h?, rul.rul_p90_h?])
}

/// The reported fault with the highest level, then the largest damage; without one, the fault whose trend ends the life first.
fn worst_fault(history: &History, modes: &[FaultMode; FaultId::COUNT]) -> Option<FaultId> {
    let (health, rul) = &history.newest;
    let damages = health.damages();
    let reported = FaultId::ALL
        .into_iter()
        .filter(|fault| health.fault_list.iter().any(|name| name == fault.name()));
    let rank = |fault: FaultId| {
        let damage = damages[fault.index()].unwrap_or(0.0);
        let levels = modes[fault.index()].severity;
        (levels.iter().filter(|level| damage >= level.damage).count(), damage)
    };
    reported
        .max_by(|a, b| {
            let ((level_a, damage_a), (level_b, damage_b)) = (rank(*a), rank(*b));
            level_a.cmp(&level_b).then(damage_a.total_cmp(&damage_b))
        })
        .or_else(|| FaultId::from_name(&rul.dominant_fault))
}

/// Start of the oldest window of the newest run of windows in this state or a worse one, since the last reset.
fn since(history: &History, state: HealthState) -> Option<u64> {
    let mut since = None;
    for n in (0..history.points.len()).rev() {
        let point = &history.points[n];
        if HealthState::named(&point.health) < state {
            break;
        }
        since = Some(point.t_start_ns);
        if n > 0 && marks_before(history, n).contains(&Mark::Reset) {
            break;
        }
    }
    since
}

/// Hours left as people read them.
pub(super) fn hours(left: [f64; 3]) -> String {
    let [p10, p50, p90] = left;
    format!("{p50:.0} h ({p10:.0} … {p90:.0})")
}

fn with_capital(text: &str) -> String {
    let mut chars = text.chars();
    chars
        .next()
        .map_or_else(String::new, |first| first.to_uppercase().chain(chars).collect())
}

#[cfg(test)]
mod tests {
    use super::super::history::Point;
    use super::*;
    use hmd_core::catalogue::catalogue;
    use hmd_core::health::Levels;
    use hmd_core::record::Health;

    fn history(states: &[&str], faults: &[FaultId], damages: [f64; FaultId::COUNT]) -> History {
        let points = states.iter().enumerate().map(|(n, state)| Point {
            window: n as u64,
            t_start_ns: n as u64,
            health: (*state).to_owned(),
            used_h: Some(n as f64),
            ..Point::default()
        });
        let mut health = Health {
            health: states.last().map_or_else(String::new, |state| (*state).to_owned()),
            ..Health::default()
        };
        health.set_damage(damages.map(Some));
        health.set_faults(faults);
        History {
            points: points.collect(),
            newest: (health, Rul::default()),
            ..History::default()
        }
    }

    fn of(history: &History) -> Recommendation {
        recommendation(history, &catalogue(&[Levels::default(); FaultId::COUNT]).fault_modes)
    }

    #[test]
    fn the_worst_part_is_named_with_the_action_of_the_catalogue() {
        use FaultId::{Backlash, Friction};
        let worn = [0.4, 0.7, 0.0, 0.0, 0.0, 0.0, 0.0];
        let found = of(&history(
            &["nominal", "warning", "critical", "critical"],
            &[Friction, Backlash],
            worn,
        ));
        assert_eq!(found.fault, Some(Backlash));
        assert_eq!(found.action, "Repair before the next use: gear and screw.");
        assert_eq!(found.since_ns, Some(2));
        let well = of(&history(&["nominal"], &[], [0.0; FaultId::COUNT]));
        assert_eq!((well.fault, &*well.action), (None, "No action."));
    }

    #[test]
    fn a_state_by_the_remaining_life_names_the_part_that_ends_it() {
        let mut history = history(&["critical"], &[], [0.04; FaultId::COUNT]);
        history.newest.1.dominant_fault = "friction".to_owned();
        let found = of(&history);
        assert_eq!(found.action, "Repair before the next use: bearings, gear and screw.");
    }

    #[test]
    fn a_reset_begins_a_new_since() {
        let mut history = history(&["watch", "watch", "watch"], &[FaultId::Gain], [0.1; FaultId::COUNT]);
        history.points[2].used_h = Some(0.0);
        assert_eq!(of(&history).since_ns, Some(2));
    }
}
