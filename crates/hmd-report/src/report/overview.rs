//! One row per actuator, the worst first.

use std::fmt::Write;

use ema_models::FaultId;
use hmd_core::catalogue::FaultMode;
use hmd_core::health::HealthState;

use super::history::History;
use super::markup::table;
use super::plot::escaped;
use super::recommendation::{Recommendation, hours, recommendation};
use super::zone::Zone;

/// The table of all actuators; each name leads to the actuator's part of the page.
pub(super) fn overview(histories: &[&History], modes: &[FaultMode; FaultId::COUNT], zone: &Zone) -> String {
    let mut all: Vec<(usize, &History, Recommendation)> = histories
        .iter()
        .enumerate()
        .map(|(n, history)| (n, *history, recommendation(history, modes)))
        .collect();
    all.sort_by(|a, b| urgency(&b.2).cmp(&urgency(&a.2)).then(a.0.cmp(&b.0)));
    let mut rows = String::new();
    for (n, history, advice) in &all {
        let state = advice.state.name();
        let fault = advice.fault.map_or("–", FaultId::plain_name);
        let left = advice.hours_left.map_or_else(|| "–".to_owned(), hours);
        let since = advice
            .since_ns
            .map_or_else(|| "–".to_owned(), |since| zone.minute(since));
        let newest = history.points.last();
        let newest = newest.map_or_else(|| "–".to_owned(), |point| zone.minute(point.t_start_ns));
        let _ = writeln!(
            rows,
            "<tr><th scope=\"row\"><a href=\"#actuator-{n}\">{}</a></th><td class=\"state {state}\">{state}</td><td>{}</td>\
             <td>{}</td><td class=\"n\">{left}</td><td>{since}</td><td>{newest}</td></tr>",
            escaped(&history.actuator),
            escaped(fault),
            escaped(&advice.action),
        );
    }
    table(
        "Worst first. Hours left: median and 80 % interval",
        &[
            ("Actuator", ""),
            ("State", ""),
            ("Fault", ""),
            ("What to do", ""),
            ("Hours left", "n"),
            ("Since", ""),
            ("Newest window", ""),
        ],
        &rows,
    )
}

/// Order of the rows: by state; what is not known stands above what is well.
fn urgency(advice: &Recommendation) -> u8 {
    match advice.state {
        HealthState::Critical => 4,
        HealthState::Warning => 3,
        HealthState::Watch => 2,
        HealthState::Unknown => 1,
        HealthState::Nominal => 0,
    }
}
