//! What a mechanic reads first: the recommendation, and each fault with its damage.

use std::fmt::Write;

use ema_models::FaultId;
use hmd_core::assess::LOCKED;
use hmd_core::catalogue::FaultMode;
use hmd_core::counted::counted;
use hmd_core::health::HealthState;
use hmd_core::record::{Rul, Shown};

use super::history::{History, Unassessed, hours_of, is_elapsed};
use super::markup::wide_table;
use super::plot::escaped;
use super::recommendation::{Recommendation, clears};
use super::sections::NORMAL_95;
use super::words::{duration, durations, hours, with_capital};
use super::zone::Zone;

/// Part and serial number, number of windows and the time they span.
pub(super) fn period(history: &History, zone: &Zone) -> String {
    let (Some(first), Some(last)) = (history.points.first(), history.points.last()) else {
        return String::new();
    };
    let identity = match &*history.identity {
        "" => String::new(),
        identity => format!("{}<br>", escaped(&with_capital(identity))),
    };
    format!(
        "<p class=\"faint\">{identity}{} from {} to {}</p>\n",
        counted(history.points.len() as u64, "window", "windows"),
        zone.minute(first.t_start_ns),
        zone.minute(last.t_start_ns)
    )
}

/// State, what to do, since when, and how long the actuator lasts.
pub(super) fn headline(advice: &Recommendation, history: &History, zone: &Zone) -> String {
    let health = &history.newest.0;
    let state = advice.state.name();
    let mut text = format!(
        "<p class=\"assessment {state}\"><strong>{state}</strong><br>{}",
        escaped(&advice.action)
    );
    if !advice.faults.is_empty() {
        let found = advice.faults.iter().map(|fault| with_damage(history, *fault));
        let found = found.collect::<Vec<_>>().join(", ");
        let _ = write!(
            text,
            " {}: {}.",
            if advice.faults.len() > 1 { "Faults" } else { "Fault" },
            escaped(&found)
        );
    }
    if let Some(since) = advice.since_ns.filter(|_| advice.state != HealthState::Unknown) {
        let _ = write!(text, "<br>{} since {}.", with_capital(state), zone.minute(since));
    }
    if let Some(Unassessed { windows, since_ns }) = advice.unassessed {
        let which = match windows {
            1 => "The newest window could not be assessed".to_owned(),
            _ => format!(
                "The newest {windows} windows, since {}, could not be assessed",
                zone.minute(since_ns)
            ),
        };
        let reason = if health.reason.is_empty() { "" } else { ": " };
        let _ = write!(
            text,
            "<br>{which}{reason}{}.",
            escaped(&first_what_hinders(&health.reason))
        );
    } else if !health.reason.is_empty() {
        let status = &health.status;
        let _ = write!(
            text,
            "<br>The newest window is {}: {}.",
            escaped(status),
            escaped(&health.reason)
        );
    }
    if let Some(since) = advice.suspected_since_ns {
        let _ = write!(text, "<br>Sensors suspected since {}.", zone.minute(since));
    }
    if !history.sensors.drifting.is_empty() {
        let (names, level) = (history.sensors.drifting.join(", "), &history.sensors.level);
        let _ = write!(text, "<br>Drift of sensors {}: {}.", escaped(level), escaped(&names));
    }
    if !advice.unknown.is_empty() && advice.unknown.len() < FaultId::COUNT {
        let names: Vec<&str> = advice.unknown.iter().map(|fault| fault.plain_name()).collect();
        let _ = write!(text, "<br>No window has shown: {}.", escaped(&names.join(", ")));
    }
    if let Some(by_life) = state_by_life(advice, history) {
        let _ = write!(text, "<br>{by_life}");
    }
    let _ = writeln!(text, "<br>{}</p>", escaped(&remaining_life(advice, history)));
    text
}

/// A fault with its damage.
fn with_damage(history: &History, fault: FaultId) -> String {
    let damage = history
        .shown
        .of(fault)
        .map(|shown| format!(" {}", percent_of(shown.damage)));
    format!("{}{}", fault.plain_name(), damage.unwrap_or_default())
}

/// The reason of a window, a motor that does not turn first.
fn first_what_hinders(reason: &str) -> String {
    let (first, then): (Vec<&str>, Vec<&str>) = reason.split("; ").partition(|part| part.contains(LOCKED));
    [first, then].concat().join("; ")
}

/// Why the state is worse than that of every fault.
fn state_by_life(advice: &Recommendation, history: &History) -> Option<String> {
    let worst = history.states().into_iter().max().unwrap_or_default();
    let is_worse = advice.state > worst && advice.state >= HealthState::Watch;
    is_worse.then(|| format!("{} by the short remaining life.", with_capital(advice.state.name())))
}

/// The forecast in one or two sentences that do not contradict the action.
fn remaining_life(advice: &Recommendation, history: &History) -> String {
    let rul = &history.newest.1;
    let of = hours_of(rul);
    let [p10, p50, p90] = match &advice.hours_left {
        Ok(left) => durations(*left),
        Err(reason) => return format!("Remaining life: no number ({reason})."),
    };
    let mut text = if p10 == p90 {
        format!("Remaining life: {p50}{of}")
    } else {
        format!("Remaining life: nine of ten such actuators last {p10}{of}, half of them {p50}, one of ten {p90}")
    };
    if let Some(fault) = advice.ends_first {
        let _ = write!(text, "; {} ends it first", fault.plain_name());
    }
    let without = without_forecast(advice, rul);
    if !without.is_empty() {
        let names: Vec<&str> = without.iter().map(|fault| fault.plain_name()).collect();
        let _ = write!(text, "; without {}, of which there is no forecast", names.join(" and "));
    }
    if let Some(operation) = little_operation(history) {
        let _ = write!(text, "; {operation}");
    }
    if advice.state == HealthState::Critical {
        text += ". These hours are a forecast; they do not permit another use.";
        return text;
    }
    let is_recorded = advice
        .ends_first
        .is_some_and(|fault| fault.name() == rul.dominant_fault);
    let is_of_all = is_recorded && without.is_empty();
    if let (Some(probability), Some(horizon), true) = (rul.failure_probability, rul.horizon_h, is_of_all) {
        let _ = write!(text, "; it ends within {horizon:.0} h with {}", percent(probability));
    }
    text + "."
}

/// Worn faults that the remaining life knows nothing of: they may end it earlier.
fn without_forecast(advice: &Recommendation, rul: &Rul) -> Vec<FaultId> {
    let left = rul.faults();
    let is_open = |fault: &&FaultId| left[fault.index()].is_none() && Some(**fault) != advice.ends_first;
    advice.faults.iter().filter(is_open).copied().collect()
}

/// Share of the time that the windows span below which their operation is told: logs of single movements hold little of it.
const LITTLE_OPERATION: f64 = 0.01;

/// How much operation the windows hold, where hours are of operation and these are a small part of the time.
fn little_operation(history: &History) -> Option<String> {
    if is_elapsed(&history.newest.1) {
        return None;
    }
    let (first, last) = (history.points.first()?, history.points.last()?);
    let span_h = last.t_start_ns.saturating_sub(first.t_start_ns) as f64 / 3.6e12;
    let used_h = history
        .points
        .iter()
        .filter_map(|point| point.used_h)
        .fold(0.0, f64::max);
    (used_h < LITTLE_OPERATION * span_h).then(|| {
        let (used, span) = (duration(used_h), duration(span_h));
        format!("hours of operation, of which the windows hold {used} within {span}; rul.hours = \"elapsed\" counts those of the clock")
    })
}

/// A probability in words that never say impossible or certain.
fn percent(probability: f64) -> String {
    match 100.0 * probability {
        p if p < 0.1 => "less than 0.1 % probability".to_owned(),
        p if p > 99.9 => "more than 99.9 % probability".to_owned(),
        p => format!("{p:.1} % probability"),
    }
}

/// Each fault: part, symptom, damage, level, and the hours left by it alone or why there is no number.
pub(super) fn faults(history: &History, modes: &[FaultMode; FaultId::COUNT], zone: &Zone) -> String {
    let rul = &history.newest.1;
    let (states, left) = (history.states(), rul.faults());
    let row = |fault: FaultId| {
        let (mode, state) = (&modes[fault.index()], states[fault.index()]);
        if clears(&history.replaced_since, fault) {
            let cells = [
                fault.plain_name(),
                mode.item,
                "replaced",
                "unknown",
                "not yet",
                "–",
                mode.symptom,
            ];
            return cells.map(escaped).to_vec();
        }
        let shown = history.shown.of(fault);
        let left = left[fault.index()].map_or_else(|| without_trend(shown, mode, state, rul), hours);
        vec![
            escaped(fault.plain_name()),
            escaped(mode.item),
            shown.map_or_else(|| "not known".to_owned(), |shown| percent_of(shown.damage)),
            escaped(&level(shown, mode, state)),
            shown.map_or_else(
                || "no window shows it".to_owned(),
                |shown| zone.minute(shown.t_start_ns),
            ),
            escaped(&left),
            escaped(mode.symptom),
        ]
    };
    let rows: Vec<Vec<String>> = FaultId::ALL.into_iter().map(row).collect();
    let of = hours_of(rul);
    wide_table(
        &format!(
            "Damage by the newest window that shows it. Life left: hours{of} to the end of life by this fault alone, median and \
             80 % interval"
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

fn percent_of(damage: f64) -> String {
    format!("{:.1} %", 100.0 * damage)
}

/// The level of a fault; where it is another than that of the damage, why.
fn level(shown: Option<Shown>, mode: &FaultMode, state: HealthState) -> String {
    let Some(shown) = shown else { return state.to_string() };
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
            _ => format!(
                "{state}: {by_damage} takes {}",
                counted(mode.persistence_windows.into(), "window", "windows in a row")
            ),
        }
    } else {
        state.to_string()
    }
}

/// The level of a damage by itself.
fn level_of(damage: f64, mode: &FaultMode) -> HealthState {
    let reached = mode.severity.iter().rfind(|severity| damage >= severity.damage);
    reached.map_or(HealthState::Nominal, |severity| severity.class)
}

/// Why a fault has no hours left.
fn without_trend(shown: Option<Shown>, mode: &FaultMode, state: HealthState, rul: &Rul) -> String {
    match shown {
        None => "no trend: no window shows it".to_owned(),
        Some(_) if state >= HealthState::Watch && !rul.reason.is_empty() => rul.reason.clone(),
        Some(_) if state >= HealthState::Watch => {
            "no trend: the damage does not grow, or the windows are too few".to_owned()
        }
        Some(shown) if level_of(shown.damage, mode) == HealthState::Nominal => {
            "no trend: below the watch level".to_owned()
        }
        Some(_) => "no trend: the damage is within its uncertainty".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::history::Replacement;
    use super::*;
    use hmd_core::catalogue::catalogue;
    use hmd_core::health::Levels;
    use hmd_core::history::ReplacedPart;
    use hmd_core::record::Health;

    fn advice(state: HealthState) -> Recommendation {
        Recommendation {
            state,
            faults: vec![FaultId::Friction],
            action: "Act.".to_owned(),
            hours_left: Ok([90.0, 100.0, 110.0]),
            ends_first: Some(FaultId::Friction),
            since_ns: Some(0),
            suspected_since_ns: None,
            unassessed: None,
            unknown: Vec::new(),
            has_checks: false,
            is_before_next_use: false,
        }
    }

    #[test]
    fn the_row_of_a_replaced_part_says_so() {
        let modes = catalogue(&[Levels::default(); FaultId::COUNT]).fault_modes;
        let history = History {
            replaced_since: vec![Replacement {
                part: Some(ReplacedPart::Gearbox),
                t_ns: 0,
                note: String::new(),
            }],
            ..History::default()
        };
        let table = faults(&history, &modes, &Zone::utc());
        // Friction and backlash are of the gear.
        let rows = |cell: &str| table.matches(&format!(">{cell}<")).count();
        assert_eq!((rows("replaced"), rows("not known")), (2, 5), "{table}");
    }

    #[test]
    fn a_worn_part_without_a_forecast_is_not_in_the_remaining_life() {
        let mut rul = Rul {
            failure_probability: Some(0.0),
            horizon_h: Some(10.0),
            dominant_fault: "short_b".to_owned(),
            ..Rul::default()
        };
        rul.set_faults(FaultId::ALL.map(|fault| (fault == FaultId::ShortB).then_some(([90.0, 100.0, 110.0], 0.0))));
        let history = History {
            newest: (Health::default(), rul),
            ..History::default()
        };
        let advice = Recommendation {
            faults: vec![FaultId::Friction, FaultId::ShortB],
            ends_first: Some(FaultId::ShortB),
            ..advice(HealthState::Warning)
        };
        let text = remaining_life(&advice, &history);
        assert!(
            text.contains("without friction, of which there is no forecast"),
            "{text}"
        );
        assert!(!text.contains("probability"), "{text}");
    }

    #[test]
    fn a_critical_state_has_no_probability_beside_it() {
        let rul = Rul {
            failure_probability: Some(0.0),
            horizon_h: Some(10.0),
            dominant_fault: "friction".to_owned(),
            ..Rul::default()
        };
        let history = History {
            newest: (Health::default(), rul),
            ..History::default()
        };
        let critical = headline(&advice(HealthState::Critical), &history, &Zone::utc());
        assert!(
            !critical.contains("ends within") && critical.contains("do not permit"),
            "{critical}"
        );
        let watch = headline(&advice(HealthState::Watch), &history, &Zone::utc());
        assert!(watch.contains("less than 0.1 % probability"), "{watch}");
    }
}
