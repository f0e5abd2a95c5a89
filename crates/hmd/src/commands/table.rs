//! Health records as lines for people.

use ema_models::FaultId;
use hmd_core::health::significance;
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

/// Damage from which on a healthy unit is asked for it.
const NOTICED: f64 = 0.05;

/// A damage in percent; with its standard deviation where it would be noticed and is within what chance explains.
fn damage_cell(fault: FaultId, damage: Option<f64>, sigma: Option<f64>) -> String {
    match (damage, sigma) {
        (None, _) => "·".to_owned(),
        (Some(damage), Some(sigma)) if damage >= NOTICED && damage < significance(fault) * sigma => {
            format!("{:.0}±{:.0} %", 100.0 * damage, 100.0 * sigma)
        }
        (Some(damage), _) => format!("{:.1} %", 100.0 * damage),
    }
}

/// One window: status, state, damage of each fault in percent (a dot where the window does not show it), faults and reason.
pub(super) fn health_row(health: &record::Health) -> String {
    let mut row = format!(
        "{:<8} {:>6} {:<8} {:<8}",
        health.actuator, health.window, health.status, health.health
    );
    let sigmas = health.damage_sigmas();
    for (fault, damage) in FaultId::ALL.into_iter().zip(health.damages()) {
        let cell = damage_cell(fault, damage, sigmas[fault.index()]);
        row += &format!(" {cell:>7}");
    }
    row += &format!("  {}", health.faults);
    if !health.reason.is_empty() {
        row += &format!("  ({})", health.reason);
    }
    printable(&row).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_damage_that_chance_explains_has_its_deviation() {
        let cell = |damage: f64, sigma: f64| damage_cell(FaultId::ShortB, Some(damage), Some(sigma));
        assert_eq!(cell(0.15, 0.07), "15±7 %");
        assert_eq!(cell(0.15, 0.04), "15.0 %");
        assert_eq!(cell(0.004, 0.01), "0.4 %");
        assert_eq!(damage_cell(FaultId::ShortB, Some(0.15), None), "15.0 %");
        assert_eq!(damage_cell(FaultId::ShortB, None, None), "·");
    }
}
