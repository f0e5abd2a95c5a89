//! Health records as lines for people.

use hmd_core::record;
use hmd_storage::printable;

/// Head of the table that [`health_row`] fills.
pub(super) const HEALTH_HEAD: &str =
    "actuator window status   health   friction backlash short A short B short C eccentr.    gain  faults";

/// Hours left: median and the 80 % interval, a dot where there is no trend.
pub(super) fn left_cell(rul: &record::Rul) -> String {
    match (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) {
        (Some(p10), Some(p50), Some(p90)) => format!("{p50:.0} ({p10:.0}…{p90:.0})"),
        _ => "·".to_owned(),
    }
}

/// One window: status, state, damage of each fault in percent (a dot where the window does not show it), faults and reason.
pub(super) fn health_row(health: &record::Health) -> String {
    let mut row = format!(
        "{:<8} {:>6} {:<8} {:<8}",
        health.actuator, health.window, health.status, health.health
    );
    for damage in health.damages() {
        let cell = damage.map_or_else(|| "·".to_owned(), |damage| format!("{:.1} %", 100.0 * damage));
        row += &format!(" {cell:>7}");
    }
    row += &format!("  {}", health.faults);
    if !health.reason.is_empty() {
        row += &format!("  ({})", health.reason);
    }
    printable(&row).into_owned()
}
