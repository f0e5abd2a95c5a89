//! Both sides of each relation between measured signals over one window.

use hmd_core::commissioning::{Curve, CurvePoint, Findings, Relation};

use super::super::plot::{Axis, Plot, significant};
use super::super::sections::{HEIGHT, SAMPLES_MAX, figure, thinned};

/// Both sides of each relation over one window, and what remains of it.
pub(super) fn relations(findings: &Findings) -> String {
    if findings.curves.is_empty() {
        return "<p>The relations were not learnt.</p>\n".to_owned();
    }
    let mut text = format!("<p>Window {}.</p>\n<div class=\"plots\">", findings.curves_window);
    for curve in &findings.curves {
        text += &both_sides(curve);
    }
    text + "</div>\n"
}

fn both_sides(curve: &Curve) -> String {
    // What is drawn, its unit and scale, and its caption.
    let (name, unit, scale, measured, modelled) = match curve.relation {
        Relation::TorqueBalance => (
            "Torque balance",
            "Nm",
            1.0,
            "torque by the currents",
            "inertia, friction and load",
        ),
        Relation::Controller => (
            "Controller",
            "Nm/s",
            1.0,
            "derivative of the torque",
            "law of the speed loop",
        ),
        Relation::Transmission => (
            "Play",
            "mrad",
            1e3,
            "output angle less motor angle, mean of 6 ms",
            "the same behind the unit's play",
        ),
    };
    let Some(rms) = curve.residual_rms() else {
        return format!("<p>{name}: not shown by this window.</p>\n");
    };
    let points: Vec<(f64, Option<[f64; 2]>)> = curve
        .points
        .iter()
        .map(|CurvePoint { time_s, sides }| (*time_s, sides.map(|sides| sides.map(|side| scale * side))))
        .collect();
    let drawn = thinned(&points, SAMPLES_MAX);
    let along = || Axis::over("time, s", points.iter().map(|point| point.0));
    let shown = || points.iter().filter_map(|point| point.1);
    let mut both = Plot::new(
        &format!("{name}: measured and modelled"),
        HEIGHT,
        along(),
        Axis::over(&format!("{name}, {unit}"), shown().flatten()),
    );
    both.line(
        "measured",
        drawn.iter().map(|(t, sides)| (*t, sides.map(|sides| sides[0]))),
    );
    both.line(
        "fitted",
        drawn.iter().map(|(t, sides)| (*t, sides.map(|sides| sides[1]))),
    );
    let caption = format!("<span class=\"key\">{measured}</span> <span class=\"key f\">{modelled}</span>");
    let mut residual = Plot::new(
        &format!("{name}: residual"),
        HEIGHT,
        along(),
        Axis::over(
            &format!("residual, {unit}"),
            shown().map(|[measured, modelled]| measured - modelled).chain([0.0]),
        ),
    );
    residual.line(
        "residual",
        drawn
            .iter()
            .map(|(t, sides)| (*t, sides.map(|[measured, modelled]| measured - modelled))),
    );
    let remains = format!(
        "<span class=\"key r\">residual</span>, measured minus modelled: {} {unit} rms",
        significant(scale * rms)
    );
    figure(&both, &caption) + &figure(&residual, &remains)
}
