//! The result of the suite as Markdown.

use super::{Group, Rates, RobustReport};

/// Rates of each actuator type, then of each entry, before and after the calibration of the unit.
#[must_use]
pub fn robust_table(report: &RobustReport) -> String {
    let mut text = String::new();
    head(&mut text, "actuator");
    for of_type in &report.actuators {
        row(&mut text, &format!("`{}`", of_type.actuator), &of_type.group);
    }
    row(&mut text, "**all**", &report.all);
    text.push('\n');
    head(&mut text, "entry");
    for entry in &report.entries {
        row(&mut text, &entry.entry, &entry.group);
    }
    text.truncate(text.trim_end().len());
    text
}

fn head(text: &mut String, first: &str) {
    *text += &format!(
        "| {first} | before: judged, % | false, % | named, % | wrong, % | refused | after: judged, % | false, % | named, % | wrong, % | \
         median error | covers, % | other motion: judged, % | false, % |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n"
    );
}

fn row(text: &mut String, name: &str, group: &Group) {
    let percent = |rate: f64| format!("{:.1}", 100.0 * rate);
    let four = |rates: &Rates| {
        [
            rates.judged_rate,
            rates.false_fault_rate,
            rates.named_rate,
            rates.wrong_rate,
        ]
        .map(percent)
        .join(" | ")
    };
    let none = || "–".to_owned();
    *text += &format!(
        "| {name} | {} | {} of {} | {} | {} | {} | {} | {} |\n",
        four(&group.before),
        group.refused,
        group.units,
        four(&group.after),
        group
            .after
            .median_error
            .map_or_else(none, |error| format!("{error:.3}")),
        group.after.coverage_95.map_or_else(none, percent),
        percent(group.elsewhere.judged_rate),
        percent(group.elsewhere.false_fault_rate),
    );
}
