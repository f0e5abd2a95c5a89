//! What is known of the selected actuator.

use super::model::Row;
use hmd_core::counted::counted;
use hmd_core::record::Estimate;
use hmd_core::timestamp::minute;

/// Names of k1…k8 that fit beside a bar.
const NAMES: [&str; 8] = [
    "k1 friction",
    "k2 backlash",
    "k3 short A",
    "k4 short B",
    "k5 short C",
    "k6 eccentr.",
    "k7 ecc.dir.",
    "k8 gain",
];

/// Characters of a bar.
const BAR: usize = 10;

/// Lines of [`lines`].
pub(super) const LINES: u16 = 8;

/// Four lines with two bars each, then window, remaining life, use and last change.
pub(super) fn lines(row: &Row<'_>) -> Vec<String> {
    let Some(known) = row.known else {
        let mut lines = vec!["no window yet, or none in what was read".to_owned()];
        lines.extend(row.changed.iter().map(|changed| format!("changed  {changed}")));
        return lines;
    };
    let estimate = known.assessed.as_ref().and_then(|health| health.estimate());
    let mut lines: Vec<String> = (0..4)
        .map(|n| format!("{}  {}", bar(estimate.as_ref(), n), bar(estimate.as_ref(), n + 4)))
        .collect();
    lines.push(window(row));
    lines.push(remaining_life(row));
    lines.push(used(row));
    lines.extend(row.changed.iter().map(|changed| format!("changed  {changed}")));
    lines
}

/// `k1 friction [####......] 0.396 +-0.011`: value and 95 % half width; k7 and k8 are healthy in the middle.
fn bar(estimate: Option<&Estimate>, n: usize) -> String {
    let name = NAMES[n];
    let Some(estimate) = estimate else {
        return format!("{name:<11} {:38}", "[          ] unknown")
            .chars()
            .take(38)
            .collect();
    };
    let k = estimate.k[n];
    let full = (k.clamp(0.0, 1.0) * BAR as f64).round() as usize;
    let bar = format!("{}{}", "#".repeat(full), ".".repeat(BAR - full));
    let value = match (estimate.tells_of(n), estimate.sigma[n]) {
        (true, Some(sigma)) => format!("{k:.3} +-{:.3}", 1.96 * sigma),
        (true, None) => format!("{k:.3}"),
        (false, _) => "not shown".to_owned(),
    };
    // What is too uncertain has no bar.
    let bar = if estimate.observable[n] { bar } else { " ".repeat(BAR) };
    format!("{name:<11} [{bar}] {value:<13}")
}

fn window(row: &Row<'_>) -> String {
    let Some(known) = row.known else { return String::new() };
    let health = &known.health;
    let mut text = format!("window   {} {}", health.window, health.status);
    if !health.reason.is_empty() {
        text += &format!(" ({})", health.reason);
    }
    if let Some(assessed) = known
        .assessed
        .as_ref()
        .filter(|assessed| assessed.window != health.window)
    {
        text += &format!(", k of window {}", assessed.window);
    }
    text += &format!(", began {}", minute(health.t_start_ns));
    if let Some(window) = known.window.as_ref().filter(|window| window.window == health.window) {
        text += &format!(", {} of {} samples", window.samples, window.samples_expected);
    }
    if let Some(residual) = health.residual_rms_a {
        text += &format!(", residual {residual:.3} A");
    }
    text
}

fn remaining_life(row: &Row<'_>) -> String {
    let Some(rul) = row.known.and_then(|known| known.rul.as_ref()) else {
        return "left     unknown".to_owned();
    };
    let (Some(p10), Some(p50), Some(p90)) = (rul.rul_p10_h, rul.rul_p50_h, rul.rul_p90_h) else {
        let why = if rul.reason.is_empty() { "no trend" } else { &rul.reason };
        return format!("left     unknown: {why}");
    };
    let mut text = format!(
        "left     {p50:.0} h, 80 % in {p10:.0}..{p90:.0} h, by {}",
        rul.governed_by
    );
    if rul.governed_by == "damage" {
        text += &format!(" of {}", rul.dominant_fault);
    }
    if let (Some(probability), Some(horizon)) = (rul.failure_probability, rul.horizon_h) {
        text += &format!("; P {probability:.2} in {horizon:.0} h");
    }
    text
}

fn used(row: &Row<'_>) -> String {
    let Some(rul) = row.known.and_then(|known| known.rul.as_ref()) else {
        return "used     unknown".to_owned();
    };
    let [hours, cycles] = [rul.operating_h, rul.operating_cycles];
    let value =
        |value: Option<f64>, unit| value.map_or_else(|| format!("? {unit}"), |value| format!("{value:.1} {unit}"));
    let mut text = format!("used     {}, {}", value(hours, "h"), value(cycles, "cycles"));
    if row.persistence > 0 {
        text += &format!(
            "; {} for a worse state",
            counted(row.persistence, "window asks", "windows in a row ask")
        );
    }
    if let Some(known) = row.known.filter(|known| !known.sensors.drifting.is_empty()) {
        text += &format!(
            "; sensors {}: {}",
            known.sensors.level,
            known.sensors.drifting.join(", ")
        );
    }
    if row.passive {
        text += "; passive: raises no alarm";
    }
    text
}

/// A time in at most six characters.
pub(super) fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 99.5 => format!("{s:.0} s"),
        s if s < 99.5 * 60.0 => format!("{:.0} min", s / 60.0),
        s if s < 99.5 * 3600.0 => format!("{:.0} h", s / 3600.0),
        s => format!("{:.0} d", s / 86_400.0),
    }
}
