//! Parameters of a commissioned unit against those of its type.

use hmd_core::commissioning::{Findings, FoundParameter, UnitCalibration, UnitEstimator};

use super::super::markup::table;
use super::super::plot::{Axis, Plot, escaped, number};
use super::super::sections::figure;
use super::super::words::NORMAL_95;

/// Distances in tolerances up to which the axis reaches, at least and at most.
const TOLERANCES_SHOWN: [f64; 2] = [2.5, 6.0];

/// The parameters against their type, as intervals and numbers: what the type has a value of, then effects that it does not have.
pub(super) fn parameters(unit: &UnitCalibration, findings: &Findings) -> String {
    let rows = &findings.parameters;
    if rows.is_empty() {
        return "<p>None was learnt.</p>\n".to_owned();
    }
    let (of_type, effects): (Vec<&FoundParameter>, Vec<&FoundParameter>) =
        rows.iter().partition(|row| row.of_type > 0.0);
    let text: String = rows
        .iter()
        .map(|row| {
            let unit = if row.unit.is_empty() {
                String::new()
            } else {
                format!(", {}", row.unit)
            };
            let open = if row.is_open() { "; open" } else { "" };
            format!(
                "<tr><th scope=\"row\">{} {}{unit}</th><td class=\"n\">{} ± {}</td><td class=\"n\">{} ± {}</td>\
                 <td class=\"n\">{:+.1}</td><td>{}{open}</td></tr>\n",
                escaped(row.symbol),
                row.name,
                number(row.of_type),
                number(row.tolerance),
                number(row.found),
                number(row.sigma),
                row.tolerances_off(),
                row.found_by,
            )
        })
        .collect();
    let listed = table(
        "Type and unit with one standard deviation each. Torques by the relations are relative to the type's k; T_c and ε are amplitudes. \
         Open: the windows say little more than the tolerance",
        &[
            ("Parameter", ""),
            ("Type", "n"),
            ("Unit", "n"),
            ("Tolerances off", "n"),
            ("Found by", ""),
        ],
        &text,
    );
    let note = match (unit.estimator, &unit.monitor) {
        (UnitEstimator::Relations, Some(_)) => {
            " The monitor's values are for comparison: it does not assess this unit."
        }
        _ => "",
    };
    let drawn: String = [&of_type, &effects].into_iter().map(|rows| intervals(rows)).collect();
    format!(
        "<div class=\"plots\">{drawn}</div>\n<p class=\"faint\">Dot and line: unit with its 95 % interval; band: one tolerance of the type \
         to either side. What lies outside the axis stands at its end.{note}</p>\n{listed}"
    )
}

/// Intervals of parameters in tolerances from the type.
fn intervals(rows: &[&FoundParameter]) -> String {
    if rows.is_empty() {
        return String::new();
    }
    // From the top to the bottom.
    let names: Vec<String> = rows.iter().rev().map(|row| label(row, rows)).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let [least, most] = TOLERANCES_SHOWN;
    let reach = rows
        .iter()
        .map(|row| row.tolerances_off().abs() + NORMAL_95 * row.sigma / row.tolerance)
        .fold(least, f64::max)
        .min(most);
    let mut plot = Plot::new(
        "Parameters of the unit against those of its type",
        ROW_HEIGHT * rows.len() as f64 + 60.0,
        Axis::between("distance from the type, tolerances", -1.05 * reach, 1.05 * reach),
        Axis::with_names("", &names),
    );
    let whole = (-0.5, rows.len() as f64 - 0.5);
    plot.band("band", [(-1.0, Some(whole)), (1.0, Some(whole))].into_iter());
    plot.line("nominal", [(0.0, Some(whole.0)), (0.0, Some(whole.1))].into_iter());
    for (n, row) in rows.iter().enumerate() {
        let at = (rows.len() - 1 - n) as f64;
        let (centre, half) = (row.tolerances_off(), NORMAL_95 * row.sigma / row.tolerance);
        plot.line(
            "value",
            [(centre - half, Some(at)), (centre + half, Some(at))].into_iter(),
        );
        plot.dots("dots", std::iter::once((centre, at)));
    }
    let what = if rows[0].of_type <= 0.0 {
        "Effects"
    } else {
        "Parameters"
    };
    figure(&plot, what)
}

/// Height of a parameter's row in the drawing.
const ROW_HEIGHT: f64 = 22.0;

/// The symbol; with the estimator where both found the parameter.
fn label(row: &FoundParameter, rows: &[&FoundParameter]) -> String {
    let is_found_twice = rows.iter().filter(|other| other.symbol == row.symbol).count() > 1;
    match (is_found_twice, row.found_by.chars().next()) {
        (true, Some(initial)) => format!("{} ({initial}.)", row.symbol),
        _ => row.symbol.to_owned(),
    }
}
