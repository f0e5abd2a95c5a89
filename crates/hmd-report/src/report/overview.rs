//! One row per actuator, the worst first.

use ema_models::FaultId;
use hmd_core::catalogue::FaultMode;
use hmd_core::health::HealthState;

use super::history::History;
use super::markup::wide_table;
use super::plot::escaped;
use super::recommendation::{Recommendation, recommendation};
use super::zone::Zone;

/// The table of all actuators; each name leads to the actuator's part of the page.
pub(super) fn overview(histories: &[&History], modes: &[FaultMode; FaultId::COUNT], zone: &Zone) -> String {
    let mut all: Vec<(usize, &History, Recommendation)> = histories
        .iter()
        .enumerate()
        .map(|(n, history)| (n, *history, recommendation(history, modes)))
        .collect();
    all.sort_by(|a, b| urgency(&b.2).cmp(&urgency(&a.2)).then(a.0.cmp(&b.0)));
    let row = |(n, history, advice): &(usize, &History, Recommendation)| {
        let state = advice.state.name();
        let time = |t_ns: Option<u64>| t_ns.map_or_else(|| "–".to_owned(), |t_ns| zone.minute(t_ns));
        vec![
            format!("<a href=\"#actuator-{n}\">{}</a>", escaped(&history.actuator)),
            format!("<span class=\"state {state}\">{state}</span>"),
            escaped(&advice.action),
            escaped(advice.fault.map_or("–", FaultId::plain_name)),
            escaped(&advice.life_left()),
            time(advice.since_ns),
            time(history.points.last().map(|point| point.t_start_ns)),
        ]
    };
    let rows: Vec<Vec<String>> = all.iter().map(row).collect();
    wide_table(
        "Worst first. Life left: median and 80 % interval",
        &[
            ("Actuator", ""),
            ("State", ""),
            ("What to do", ""),
            ("Fault", ""),
            ("Life left", ""),
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
        HealthState::Nominal if advice.unassessed.is_some() => 1,
        HealthState::Nominal => 0,
    }
}
