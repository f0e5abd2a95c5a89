//! One row per actuator, the worst first.

use std::cmp::Ordering;

use ema_models::FaultId;
use hmd_core::health::HealthState;

use super::history::History;
use super::markup::{time, wide_table};
use super::plot::escaped;
use super::recommendation::{Recommendation, recommendation};
use super::rules::Rules;
use super::zone::Zone;

/// The table of all actuators; each name leads to the actuator's part of the page.
pub(super) fn overview(histories: &[&History], rules: &Rules, zone: &Zone) -> String {
    let mut all: Vec<(usize, &History, Recommendation)> = histories
        .iter()
        .enumerate()
        .map(|(n, history)| (n, *history, recommendation(history, rules, zone)))
        .collect();
    all.sort_by(|a, b| by_urgency((a.1, &a.2), (b.1, &b.2)).then(a.0.cmp(&b.0)));
    let newest_ns = histories
        .iter()
        .filter_map(|history| newest(history))
        .max()
        .unwrap_or(0);
    let row = |(n, history, advice): &(usize, &History, Recommendation)| {
        let state = advice.state.name();
        let time = |t_ns: Option<u64>| t_ns.map_or_else(|| "–".to_owned(), |t_ns| time(&zone.minute(t_ns)));
        vec![
            format!("<a href=\"#actuator-{n}\">{}</a>", escaped(&history.actuator)),
            format!("<span class=\"state {state}\">{state}</span>"),
            escaped(&advice.action),
            escaped(&names(&advice.faults)),
            escaped(&advice.life_left()),
            time(advice.since_ns),
            time(newest(history)) + &age(newest(history), newest_ns),
        ]
    };
    let rows: Vec<Vec<String>> = all.iter().map(row).collect();
    wide_table(
        "Worst first. Life left: hours to the end of life, which is later than critical; median and 80 % interval",
        &[
            ("Actuator", ""),
            ("State", ""),
            ("What to do", ""),
            ("Fault", ""),
            ("Life left", ""),
            ("State since", ""),
            ("Newest window", ""),
        ],
        &rows,
    )
}

/// Start of the newest window, UTC ns.
fn newest(history: &History) -> Option<u64> {
    history.points.last().map(|point| point.t_start_ns)
}

/// Nanoseconds of a day, and days from which on a window is called old.
const NS_PER_DAY: u64 = 86_400_000_000_000;
const OLD_DAYS: u64 = 7;

/// How much older a window is than the newest one of all actuators, where it is much older.
fn age(of_ns: Option<u64>, newest_ns: u64) -> String {
    let days = of_ns.map_or(0, |of_ns| newest_ns.saturating_sub(of_ns) / NS_PER_DAY);
    if days < OLD_DAYS {
        return String::new();
    }
    format!(", {days} days before the newest of this page")
}

fn names(faults: &[FaultId]) -> String {
    if faults.is_empty() {
        return "–".to_owned();
    }
    let names: Vec<&str> = faults.iter().map(|fault| fault.plain_name()).collect();
    names.join("; ")
}

/// Order of the rows: by state, then by the life left, then by the damage. What is to be checked before the next use stands above what can wait,
/// any other check above what is not known, and that above what is well.
fn by_urgency((a, of_a): (&History, &Recommendation), (b, of_b): (&History, &Recommendation)) -> Ordering {
    let p10 = |advice: &Recommendation| advice.hours_left.as_ref().map_or(f64::INFINITY, |hours| hours[0]);
    let damage = |history: &History, advice: &Recommendation| {
        let damages = advice.faults.iter().filter_map(|fault| history.newest.shown.of(*fault));
        damages.map(|shown| shown.damage).fold(0.0, f64::max)
    };
    rank(of_b)
        .cmp(&rank(of_a))
        .then(p10(of_a).total_cmp(&p10(of_b)))
        .then(damage(b, of_b).total_cmp(&damage(a, of_a)))
}

fn rank(advice: &Recommendation) -> u8 {
    match advice.state {
        HealthState::Critical => 7,
        HealthState::Warning => 6,
        HealthState::Watch if advice.is_before_next_use => 5,
        HealthState::Unknown | HealthState::Nominal if advice.is_before_next_use => 4,
        HealthState::Watch => 3,
        HealthState::Unknown | HealthState::Nominal if advice.has_checks || advice.unassessed.is_some() => 2,
        HealthState::Unknown => 1,
        HealthState::Nominal => 0,
    }
}
