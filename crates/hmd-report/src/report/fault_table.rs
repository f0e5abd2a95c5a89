//! The table of the faults: what is known of each, and how long it lasts by itself.

use ema_models::FaultId;
use hmd_core::catalogue::FaultMode;
use hmd_core::health::HealthState;
use hmd_core::record::{Rul, Shown};

use super::doubt::{in_doubt, is_shown_before};
use super::history::{History, hours_of};
use super::markup::{time, wide_table};
use super::plot::escaped;
use super::recommendation::friction_replaced;
use super::rules::{Rules, level_of};
use super::words::{NORMAL_95, hours, percent_of, range_of};
use super::zone::Zone;

/// Each fault: part, symptom, damage, level, and the hours left by it alone or why there is no number.
pub(super) fn faults(history: &History, rules: &Rules, zone: &Zone) -> String {
    let rul = &history.newest.rul;
    let (states, left) = (history.states(), rul.faults());
    let newest_ns = history.newest.health.t_start_ns;
    let row = |fault: FaultId| {
        let (mode, state) = (rules.of(fault), states[fault.index()]);
        if history.is_replaced_since(fault) {
            let parts: Vec<_> = history
                .replaced_since
                .iter()
                .map(|replacement| replacement.part)
                .collect();
            let half = friction_replaced(&parts).filter(|_| fault == FaultId::Friction);
            let what = half.map_or_else(|| "replaced".to_owned(), |half| format!("{} replaced", half.part));
            let cells = [
                fault.plain_name(),
                mode.item,
                &what,
                "unknown",
                "not yet",
                "–",
                mode.symptom,
            ];
            return cells.map(escaped).to_vec();
        }
        let shown = history.newest.shown.of(fault);
        let above = shown.and_then(|shown| rules.level_above(fault, shown, state));
        let left = match (left[fault.index()], above) {
            (Some(left), _) => hours(left),
            (None, Some(_)) => format!("no trend: {state} by the levels of the files"),
            (None, None) => without_trend(shown, rules.of_windows(fault), state, rul),
        };
        let level = above.map_or_else(
            || level(shown, rules.of_windows(fault), state, newest_ns),
            |level| format!("{state} by the levels of the files, {level} by those of this page"),
        );
        vec![
            escaped(fault.plain_name()),
            escaped(mode.item),
            shown.map_or_else(|| "not known".to_owned(), damage),
            escaped(&level),
            match (shown, in_doubt(history, fault)) {
                (Some(shown), _) => time(&zone.minute(shown.t_start_ns)),
                (None, Some(point)) => format!("in doubt since {}", time(&zone.minute(point.t_start_ns))),
                (None, None) if is_shown_before(history, fault) => "not since the replacement".to_owned(),
                (None, None) => "no window shows it".to_owned(),
            },
            escaped(&left),
            escaped(mode.symptom),
        ]
    };
    let rows: Vec<Vec<String>> = FaultId::ALL.into_iter().map(row).collect();
    let of = hours_of(rul);
    wide_table(
        &format!(
            "Damage by the newest window that shows it, and between which values it is with 95 % probability. Life left: hours{of} to the \
             end of life by this fault alone, median and 80 % interval"
        ),
        &[
            ("Fault", ""),
            ("Part", ""),
            ("Damage", "n"),
            ("Level", ""),
            ("Shown", ""),
            ("Life left", ""),
            ("Symptom", ""),
        ],
        &rows,
    )
}

/// A damage with its range beneath.
fn damage(shown: Shown) -> String {
    let range = range_of(shown).map_or_else(String::new, |range| format!("<br><span class=\"faint\">{range}</span>"));
    percent_of(shown.damage) + &range
}

/// The level of a fault after the newest window, UTC ns; where it is another than that of the damage, why. Without a mode the levels are not known.
fn level(shown: Option<Shown>, mode: Option<&FaultMode>, state: HealthState, newest_ns: u64) -> String {
    let (Some(shown), Some(mode)) = (shown, mode) else {
        return state.to_string();
    };
    let by_damage = level_of(shown.damage, mode);
    if state > by_damage && by_damage >= HealthState::Nominal {
        let level = mode.severity.iter().find(|severity| severity.class == state);
        let level = percent_of(level.map_or(0.0, |severity| severity.damage));
        format!("{state}: it was {level} or more, and is not surely less")
    } else if state < by_damage && state != HealthState::Unknown {
        match shown.sigma {
            Some(sigma) if shown.damage < mode.significance_sigmas * sigma => {
                format!("{state}: not certain yet, ± {}", percent_of(NORMAL_95 * sigma))
            }
            _ if mode.persistence_windows > 1 => {
                format!(
                    "{state}: {by_damage} takes {} windows in a row",
                    mode.persistence_windows
                )
            }
            // A window improves a state also where it is too uncertain to show a damage.
            _ if shown.t_start_ns < newest_ns => {
                format!("{state}: later windows show less, too uncertain for a number")
            }
            _ => format!("{state}: recorded by other levels than those of this page, by which it is {by_damage}"),
        }
    } else {
        state.to_string()
    }
}

/// Why a fault has no hours left.
fn without_trend(shown: Option<Shown>, mode: Option<&FaultMode>, state: HealthState, rul: &Rul) -> String {
    match shown {
        None => "no trend: not shown".to_owned(),
        // The record has one reason for all faults: that of the one nearest to a number.
        Some(_) if state >= HealthState::Watch && !rul.reason.is_empty() => format!("of the actuator: {}", rul.reason),
        Some(_) if state >= HealthState::Watch => {
            "no trend: the damage does not grow, has jumped, or the windows are too few".to_owned()
        }
        Some(shown) => match mode.map(|mode| (level_of(shown.damage, mode), mode.significance_sigmas)) {
            None => "no trend: below the watch level, or within its uncertainty".to_owned(),
            Some((HealthState::Nominal, _)) => "no trend: below the watch level".to_owned(),
            Some((_, sigmas)) if shown.sigma.is_some_and(|sigma| shown.damage < sigmas * sigma) => {
                "no trend: the damage is within its uncertainty".to_owned()
            }
            Some(_) => "no trend: the watch level is not reached for long enough".to_owned(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::super::history::Replacement;
    use super::*;
    use hmd_core::history::ReplacedPart;

    #[test]
    fn the_row_of_a_replaced_part_says_so() {
        let history = History {
            replaced_since: vec![Replacement {
                part: Some(ReplacedPart::Gearbox),
                t_ns: 0,
                note: String::new(),
            }],
            ..History::default()
        };
        let table = faults(&history, &Rules::default(), &Zone::utc());
        // Friction and backlash are of the gear, friction of the motor as well.
        let rows = |cell: &str| table.matches(&format!(">{cell}<")).count();
        let found = ["replaced", "gearbox replaced", "not known"].map(rows);
        assert_eq!(found, [1, 1, 5], "{table}");
    }

    #[test]
    fn a_level_that_a_single_window_reaches_is_not_waited_for() {
        let rules = Rules::default();
        let shown = Shown {
            damage: 0.4,
            sigma: Some(0.01),
            t_start_ns: 0,
        };
        let mode = rules.of_windows(FaultId::Friction);
        assert_eq!(
            level(Some(shown), mode, HealthState::Watch, 0),
            "watch: recorded by other levels than those of this page, by which it is warning"
        );
        assert_eq!(
            level(Some(shown), mode, HealthState::Watch, 1),
            "watch: later windows show less, too uncertain for a number"
        );
        // Levels that the recording does not say explain nothing.
        let unknown = Rules {
            are_levels_of_windows: false,
            ..rules
        };
        let mode = unknown.of_windows(FaultId::Friction);
        assert_eq!(level(Some(shown), mode, HealthState::Critical, 0), "critical");
        let of_another = Rul {
            reason: "no trend yet: 2 of 6 estimates".to_owned(),
            ..Rul::default()
        };
        let text = without_trend(Some(shown), mode, HealthState::Watch, &of_another);
        assert_eq!(text, "of the actuator: no trend yet: 2 of 6 estimates");
        let text = without_trend(Some(shown), mode, HealthState::Nominal, &Rul::default());
        assert_eq!(text, "no trend: below the watch level, or within its uncertainty");
        let mode = Rules::default();
        let without = |sigma: f64| {
            let shown = Shown {
                sigma: Some(sigma),
                ..shown
            };
            let mode = mode.of_windows(FaultId::Friction);
            without_trend(Some(shown), mode, HealthState::Nominal, &Rul::default())
        };
        assert_eq!(without(0.2), "no trend: the damage is within its uncertainty");
        assert_eq!(
            without(0.01),
            "no trend: the watch level is not reached for long enough"
        );
    }
}
