//! What a mechanic reads first: the recommendation, and each fault with its damage.

use std::fmt::Write;

use ema_models::FaultId;
use hmd_core::catalogue::FaultMode;
use hmd_core::health::HealthState;
use hmd_core::record::Rul;

use super::history::History;
use super::markup::table;
use super::plot::escaped;
use super::recommendation::{Recommendation, hours};
use super::zone::Zone;

/// Number of windows and the time they span.
pub(super) fn period(history: &History, zone: &Zone) -> String {
    let (Some(first), Some(last)) = (history.points.first(), history.points.last()) else {
        return String::new();
    };
    format!(
        "<p class=\"faint\">{} windows from {} to {}</p>\n",
        history.points.len(),
        zone.minute(first.t_start_ns),
        zone.minute(last.t_start_ns)
    )
}

/// State, what to do, since when, and how long the actuator lasts.
pub(super) fn headline(advice: &Recommendation, rul: &Rul, zone: &Zone) -> String {
    let state = advice.state.name();
    let mut text = format!(
        "<p class=\"assessment {state}\"><strong>{state}</strong><br>{}",
        escaped(&advice.action)
    );
    if let Some(fault) = advice.fault {
        let _ = write!(text, " Fault: {}.", escaped(fault.plain_name()));
    }
    if let Some(since) = advice.since_ns.filter(|_| advice.state != HealthState::Unknown) {
        let _ = write!(text, "<br>Since {}.", zone.minute(since));
    }
    let _ = writeln!(text, "<br>{}</p>", escaped(&remaining_life(advice, rul)));
    text
}

/// The forecast in one or two sentences that do not contradict the action.
fn remaining_life(advice: &Recommendation, rul: &Rul) -> String {
    let Some(left) = advice.hours_left else {
        let reason = if rul.reason.is_empty() {
            "none was recorded"
        } else {
            &rul.reason
        };
        return format!("Remaining life: no number ({reason}).");
    };
    let [p10, p50, p90] = left;
    let mut text = format!("Remaining life: {p50:.0} h, with 80 % probability between {p10:.0} and {p90:.0} h");
    if let Some(fault) = FaultId::from_name(&rul.dominant_fault) {
        let _ = write!(text, "; {fault} ends it first");
    }
    if advice.state == HealthState::Critical {
        text += ". These hours are a forecast; they do not permit another use.";
        return text;
    }
    if let (Some(probability), Some(horizon)) = (rul.failure_probability, rul.horizon_h) {
        let _ = write!(text, "; it ends within {horizon:.0} h with {}", percent(probability));
    }
    text + "."
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
pub(super) fn faults(history: &History, modes: &[FaultMode; FaultId::COUNT]) -> String {
    let (health, rul) = &history.newest;
    let mut rows = String::new();
    let all = FaultId::ALL
        .into_iter()
        .zip(modes)
        .zip(health.damages())
        .zip(rul.faults());
    for (((fault, mode), damage), left) in all {
        let reported = health.fault_list.iter().any(|name| name == fault.name());
        let left = left.map_or_else(|| without_trend(damage, mode, reported, rul), hours);
        let damage_text = damage.map_or_else(|| "not known".to_owned(), |damage| format!("{:.1} %", 100.0 * damage));
        let _ = writeln!(
            rows,
            "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td class=\"n\">{damage_text}</td><td>{}</td><td>{}</td></tr>",
            escaped(fault.plain_name()),
            escaped(mode.item),
            escaped(mode.symptom),
            level(damage, mode, reported),
            escaped(&left)
        );
    }
    table(
        "After the newest window. Hours left: to the end of life by this fault alone, median and 80 % interval",
        &[
            ("Fault", ""),
            ("Part", ""),
            ("Symptom", ""),
            ("Damage", "n"),
            ("Level", ""),
            ("Hours left", ""),
        ],
        &rows,
    )
}

/// The level that a damage has reached, as far as it was reported.
fn level(damage: Option<f64>, mode: &FaultMode, reported: bool) -> &'static str {
    let Some(damage) = damage else { return "unknown" };
    if !reported {
        return "nominal";
    }
    let reached = mode.severity.iter().rfind(|severity| damage >= severity.damage);
    // Reported below its level: within the hysteresis.
    reached.unwrap_or(&mode.severity[0]).class.name()
}

/// Why a fault has no hours left.
fn without_trend(damage: Option<f64>, mode: &FaultMode, reported: bool, rul: &Rul) -> String {
    match damage {
        None => "no trend: no window shows it".to_owned(),
        Some(damage) if !reported && damage < mode.severity[0].damage => "no trend: below the watch level".to_owned(),
        Some(_) if !reported => "no trend: the damage is within its uncertainty".to_owned(),
        Some(_) if !rul.reason.is_empty() => rul.reason.clone(),
        Some(_) => "no trend: the damage does not grow, or the windows are too few".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn advice(state: HealthState) -> Recommendation {
        Recommendation {
            state,
            fault: Some(FaultId::Friction),
            action: "Act.".to_owned(),
            hours_left: Some([90.0, 100.0, 110.0]),
            since_ns: Some(0),
        }
    }

    #[test]
    fn a_critical_state_has_no_probability_beside_it() {
        let rul = Rul {
            failure_probability: Some(0.0),
            horizon_h: Some(10.0),
            dominant_fault: "friction".to_owned(),
            ..Rul::default()
        };
        let critical = headline(&advice(HealthState::Critical), &rul, &Zone::utc());
        assert!(
            !critical.contains("ends within") && critical.contains("do not permit"),
            "{critical}"
        );
        let watch = headline(&advice(HealthState::Watch), &rul, &Zone::utc());
        assert!(watch.contains("less than 0.1 % probability"), "{watch}");
    }
}
