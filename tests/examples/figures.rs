//! Draws `docs/img/fit.svg`: one window of a worn actuator, measured and fitted.
//!
//! `cargo run --release -p hmd-tests --example figures`

use std::error::Error;
use std::ops::Range;
use std::path::Path;

use ema_identify::calibration::{MonitorForm, TypeCalibration};
use ema_identify::{Fit, Identifier, Method};
use ema_models::reference::{CurrentSensing, Scenario};
use ema_models::{ActuatorParams, FaultVector, MotorKnowledge, Tolerances};
use hmd_lab::simulated::SimulatedWindow;
use plotters::coord::Shift;
use plotters::prelude::*;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

// Legible on white and on black.
const MEASURED: RGBColor = RGBColor(160, 174, 192);
const FITTED: RGBColor = RGBColor(214, 93, 14);
const TEXT: RGBColor = RGBColor(110, 118, 129);

fn main() -> Result<(), Box<dyn Error>> {
    let params = ActuatorParams::bench();
    let calibration = TypeCalibration::built_in("bench", MonitorForm::ThreePhase).ok_or("no built-in calibration")?;
    let identifier = Identifier {
        params,
        calibration,
        method: Method::hybrid(),
        motor: MotorKnowledge::default(),
        tolerances: Tolerances::NONE,
    };
    let worn = FaultVector {
        friction: 0.4,
        backlash: 0.1,
        short_b: 0.15,
        ..FaultVector::NOMINAL
    };
    let window = SimulatedWindow::first_of(&Scenario {
        sensing: CurrentSensing {
            quantised: true,
            noise_rms: 0.03,
        },
        ..Scenario::new(params, worn, 7)
    });
    let estimate = identifier.identify(&window.prepared, window.conditions, 1)?;
    let residuals = identifier.residuals(&window.prepared, window.conditions, &estimate);
    let fit = Fit::new(&window.prepared, &residuals);

    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/img/fit.svg");
    draw(&path, &fit, 1.0 / params.sensors.sample_rate)
}

fn draw(path: &Path, fit: &Fit, period: f64) -> Result<(), Box<dyn Error>> {
    let area = SVGBackend::new(path, (900, 620)).into_drawing_area();
    let (upper, lower) = area.split_vertically(400);
    let (middle, bottom) = lower.split_vertically(100);
    curves(
        &upper,
        "quadrature current i_q, A",
        -12.0..12.0,
        &fit.i_q_measured,
        &fit.i_q_fitted,
        period,
    )?;
    let residual: Vec<f32> = fit
        .i_q_measured
        .iter()
        .zip(&fit.i_q_fitted)
        .map(|(m, f)| m - f)
        .collect();
    curves(&middle, "residual, A", -0.3..0.3, &residual, &[], period)?;
    curves(
        &bottom,
        "motor speed, rad/s",
        -220.0..220.0,
        &fit.omega_measured,
        &fit.omega_fitted,
        period,
    )?;
    area.present()?;
    Ok(())
}

fn curves(
    area: &Area<'_>,
    title: &str,
    range: Range<f64>,
    measured: &[f32],
    fitted: &[f32],
    period: f64,
) -> Result<(), Box<dyn Error>> {
    let style = ("sans-serif", 15).into_font().color(&TEXT);
    let end = measured.len() as f64 * period;
    let mut chart = ChartBuilder::on(area)
        .margin(6)
        .margin_right(30)
        .caption(title, style.clone())
        .x_label_area_size(22)
        .y_label_area_size(48)
        .build_cartesian_2d(0.0..end, range)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(TEXT.mix(0.25))
        .axis_style(TEXT)
        .label_style(style.clone())
        .y_labels(4)
        .x_label_formatter(&|t| format!("{:.0} ms", 1e3 * t))
        .draw()?;
    // Broad under thin, so that both are seen where they lie on each other; alone a curve is thin.
    let broad = if fitted.is_empty() { 1 } else { 5 };
    for (name, values, color, width) in [("measured", measured, MEASURED, broad), ("fitted", fitted, FITTED, 1)] {
        if values.is_empty() {
            continue;
        }
        let points = values
            .iter()
            .enumerate()
            .map(|(n, v)| (n as f64 * period, f64::from(*v)));
        let drawn = chart.draw_series(LineSeries::new(points, color.stroke_width(width)))?;
        drawn
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(3)));
    }
    if !fitted.is_empty() {
        chart
            .configure_series_labels()
            .label_font(style)
            .position(SeriesLabelPosition::UpperRight)
            .draw()?;
    }
    Ok(())
}
