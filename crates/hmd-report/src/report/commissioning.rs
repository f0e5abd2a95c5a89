//! The page of a commissioned unit: what was learnt of it, what remains, and what it will show.

mod parameters;
mod relations;

use std::fmt::Write;

use ema_models::{FaultId, FaultVector};
use hmd_core::commissioning::{Findings, HealthyWindow, UnitCalibration, UnitEstimator};

use super::markup::{document, table};
use super::plot::{Axis, Plot, escaped, number, significant};
use super::sections::{HEIGHT, figure};
use super::words::NORMAL_95;
use parameters::parameters;
use relations::relations;

/// The report of a commissioned unit as one HTML file.
#[must_use]
pub fn commissioning_page(actuator: &str, unit: &UnitCalibration, findings: &Findings) -> String {
    let title = format!("Commissioning of {}", escaped(actuator));
    let mut body = format!("<h1>{title}</h1>\n{}", summary(unit));
    let mut section = |heading: &str, content: String| {
        let _ = writeln!(body, "<section><h2>{heading}</h2>\n{content}</section>");
    };
    section("Smallest damage that shows", smallest_damage(unit, findings));
    section("Parameters", parameters(unit, findings));
    section("Measured against modelled", relations(findings));
    section("Apparent damage of healthy windows", apparent(unit, findings));
    section("What the windows could not show", open(unit, findings));
    document(&title, &body)
}

fn summary(unit: &UnitCalibration) -> String {
    let estimator = match unit.estimator {
        UnitEstimator::Monitor => "the monitor",
        UnitEstimator::Relations => "the relations between measured signals",
        UnitEstimator::Both => {
            "the relations between measured signals and the monitor, each fault by the one that shows it better"
        }
    };
    let identity: Vec<String> = [("part", &unit.part_number), ("serial", &unit.serial_number)]
        .into_iter()
        .filter_map(|(what, number)| Some(format!(", {what} {}", escaped(number.as_ref()?))))
        .collect();
    let range = |name: &str, unit: &str, [low, high]: [f64; 2]| {
        format!("{name} {} to {} {unit}", significant(low), significant(high))
    };
    let seen = &unit.seen;
    let mut conditions = vec![
        range("travel", "rad", seen.travel_rad),
        range("current", "A rms", seen.current_rms_a),
    ];
    conditions.extend(seen.winding_temp_deg_c.map(|of| range("winding", "°C", of)));
    conditions.extend(seen.load_torque_nm.map(|of| range("load", "Nm", of)));
    let modes: Vec<&str> = [(seen.position_mode, "position"), (seen.speed_mode, "speed")]
        .into_iter()
        .filter_map(|(is_seen, name)| is_seen.then_some(name))
        .collect();
    format!(
        "<p class=\"faint\">Type {}{}; {}</p>\n<p class=\"assessment\"><strong>{} healthy windows</strong><br>\
         Later windows are assessed by {estimator} ({}). Damage is the change since these windows.</p>\n\
         <p>Seen: {} mode; {}. Outside of that a window says so, and its sigmas are wider.</p>\n",
        escaped(&unit.actuator_type),
        identity.concat(),
        escaped(&unit.made_by),
        unit.windows,
        escaped(&unit.estimator_reason),
        modes.join(" and "),
        conditions.join("; "),
    )
}

/// Damage of each fault that one window shows, as bars and numbers.
fn smallest_damage(unit: &UnitCalibration, findings: &Findings) -> String {
    let of = |fault: FaultId| unit.smallest_damage.get(fault.name()).copied();
    let mut names = FaultId::ALL.map(short_name);
    // From the top to the bottom.
    names.reverse();
    let largest = FaultId::ALL.into_iter().filter_map(of).fold(0.1, f64::max);
    let mut plot = Plot::new(
        "Smallest damage of each fault that a window shows",
        HEIGHT,
        Axis::between("damage", 0.0, 1.05 * largest),
        Axis::with_names("", &names),
    );
    let mut rows = String::new();
    for (at, fault) in FaultId::ALL.into_iter().enumerate() {
        let at = (FaultId::COUNT - 1 - at) as f64;
        let text = match of(fault) {
            Some(damage) => {
                let bar = (at - BAR, at + BAR);
                plot.band("bar", [(0.0, Some(bar)), (damage, Some(bar))].into_iter());
                format!("{damage:.3}")
            }
            None => match findings.needed[fault.index()] {
                Some(needed) => format!("not shown: needs {needed}"),
                None => "not shown".to_owned(),
            },
        };
        let _ = writeln!(
            rows,
            "<tr><th scope=\"row\">{}</th><td class=\"n\">{text}</td></tr>",
            fault.plain_name()
        );
    }
    let drawn = figure(
        &plot,
        "Shown by one window with 99 % probability, at 0.1 % false alarms",
    );
    let listed = table("", &[("Fault", ""), ("Smallest damage", "n")], &rows);
    format!("<div class=\"plots\">{drawn}{listed}</div>\n")
}

/// Half the height of a bar, in rows.
const BAR: f64 = 0.3;

fn short_name(fault: FaultId) -> &'static str {
    match fault {
        FaultId::Friction => "friction",
        FaultId::Backlash => "backlash",
        FaultId::ShortA => "short A",
        FaultId::ShortB => "short B",
        FaultId::ShortC => "short C",
        FaultId::Eccentricity => "eccentr.",
        FaultId::Gain => "gain",
    }
}

/// Apparent damage of each healthy window with its 95 % interval.
fn apparent(unit: &UnitCalibration, findings: &Findings) -> String {
    let windows = &findings.windows;
    let mut text = match unit.estimator {
        UnitEstimator::Relations => "<p>Each window is estimated by what was learnt from the others",
        UnitEstimator::Both => {
            "<p>Each window is estimated by relations that were learnt from the others, or by the monitor compared with the mean of the \
             others, its parameters fitted to all of them"
        }
        UnitEstimator::Monitor => {
            "<p>Each window is compared with the mean of the others; the parameters are fitted to all of them"
        }
    }
    .to_owned();
    text += ": what is not zero is error. Lines: 95 % interval.</p>\n<div class=\"plots\">";
    for fault in FaultId::ALL {
        text += &apparent_damage(fault, windows);
    }
    text + "</div>\n"
}

fn apparent_damage(fault: FaultId, windows: &[HealthyWindow]) -> String {
    let parameter = fault.parameter();
    let nominal = FaultVector::NOMINAL.to_array()[parameter];
    let shown: Vec<(f64, f64, f64)> = windows
        .iter()
        .enumerate()
        .filter_map(|(place, window)| {
            Some((
                1.0 + place as f64,
                window.k[parameter] - nominal,
                window.sigma[parameter]?,
            ))
        })
        .collect();
    let name = fault.plain_name();
    if shown.is_empty() {
        return format!("<figure><figcaption>{name}: no window shows it</figcaption></figure>\n");
    }
    let bounds = shown
        .iter()
        .flat_map(|&(_, value, sigma)| [value - NORMAL_95 * sigma, value + NORMAL_95 * sigma]);
    let mut plot = Plot::new(
        &format!("Apparent change of {name} in healthy windows"),
        HEIGHT,
        Axis::between("recording", 0.0, windows.len() as f64 + 1.0),
        Axis::over(&format!("change of k{}", parameter + 1), bounds.chain([0.0])),
    );
    plot.line(
        "nominal",
        [(0.0, Some(0.0)), (windows.len() as f64 + 1.0, Some(0.0))].into_iter(),
    );
    for &(at, value, sigma) in &shown {
        let half = NORMAL_95 * sigma;
        plot.line(
            "value",
            [(at, Some(value - half)), (at, Some(value + half))].into_iter(),
        );
    }
    plot.dots("dots", shown.iter().map(|&(at, value, _)| (at, value)));
    let n = shown.len() as f64;
    let rms = (shown.iter().map(|&(_, value, _)| value * value).sum::<f64>() / n).sqrt();
    let sigma = (shown.iter().map(|&(.., sigma)| sigma * sigma).sum::<f64>() / n).sqrt();
    figure(
        &plot,
        &format!("{name}: {} rms, sigma {}", significant(rms), significant(sigma)),
    )
}

/// Faults and parameters that the windows leave open, and conditions that they have not seen.
fn open(unit: &UnitCalibration, findings: &Findings) -> String {
    let mut items: Vec<String> = Vec::new();
    for fault in FaultId::ALL {
        if !unit.smallest_damage.contains_key(fault.name()) {
            let needed =
                findings.needed[fault.index()].map_or(String::new(), |needed| format!(": windows need {needed}"));
            items.push(format!("{}{needed}", fault.plain_name()));
        }
    }
    for row in findings.parameters.iter().filter(|row| row.is_open()) {
        items.push(format!(
            "{} ({}) stays at its tolerance: ± {} {}",
            row.name,
            row.found_by,
            number(row.sigma),
            row.unit
        ));
    }
    for (is_missing, what) in [
        (
            unit.seen.winding_temp_deg_c.is_none(),
            "winding temperature: not measured",
        ),
        (unit.seen.load_torque_nm.is_none(), "load: not measured"),
        (!unit.seen.position_mode, "position mode"),
        (!unit.seen.speed_mode, "speed mode"),
    ] {
        if is_missing {
            items.push(what.to_owned());
        }
    }
    let items: String = items
        .iter()
        .map(|item| format!("<li>{}</li>\n", escaped(item)))
        .collect();
    format!("<ul>\n{items}</ul>\n")
}
