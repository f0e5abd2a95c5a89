//! The result of the suite as Markdown.

use super::{Group, SensorsReport};

/// Rates over all mistakes, then of the windows without one, then of each mistake.
#[must_use]
pub fn sensors_table(report: &SensorsReport) -> String {
    let mut text = "| mistake | units: named, % | wrongly named, % | windows: accused, % | named, % | wrongly named, % | found, % | before: judged, % | accused, % | named, % | found, % | after: judged, % | accused, % | named, % | found, % |\n\
                    |---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n"
        .to_owned();
    row(&mut text, "**all**", &report.mistakes);
    for of_mistake in &report.by_mistake {
        row(&mut text, &of_mistake.mistake, &of_mistake.group);
    }
    text.truncate(text.trim_end().len());
    text
}

fn row(text: &mut String, name: &str, group: &Group) {
    let percent = |rate: f64| format!("{:.1}", 100.0 * rate);
    let all = &group.all;
    let mut cells = vec![
        all.units_named_rate,
        all.units_wrongly_named_rate,
        all.accused_rate,
        all.named_rate,
        all.wrongly_named_rate,
        all.found_rate,
    ];
    for rates in [&group.before, &group.after] {
        cells.extend([
            rates.judged_rate,
            rates.accused_rate,
            rates.named_rate,
            rates.found_rate,
        ]);
    }
    let cells: Vec<String> = cells.into_iter().map(percent).collect();
    *text += &format!("| {name} | {} |\n", cells.join(" | "));
}
