//! What each actuator costs, by how many there are.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type DrawingError<'a> = DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>;

// Legible on white and on black.
const COLOURS: [RGBColor; 3] = [RGBColor(214, 93, 14), RGBColor(69, 133, 136), RGBColor(160, 120, 190)];
const TEXT: RGBColor = RGBColor(110, 118, 129);

/// Cost of each actuator, % of a core: its name, and a point for each number of actuators.
pub(crate) struct Curve {
    pub(crate) name: &'static str,
    pub(crate) points: Vec<(u64, f64)>,
}

/// Draws the costs of both halves of the daemon, one below the other.
pub(crate) fn draw(path: &Path, front: &[Curve], identification: &[Curve]) -> anyhow::Result<()> {
    let area = SVGBackend::new(path, (900, 560)).into_drawing_area();
    let drawn = draw_on(&area, front, identification);
    drawn.map_err(|error| anyhow::anyhow!("{}: {error}", path.display()))
}

fn draw_on<'a>(area: &Area<'a>, front: &[Curve], identification: &[Curve]) -> Result<(), DrawingError<'a>> {
    let (upper, lower) = area.split_vertically(280);
    curves(&upper, "all but identification, % of a core for each actuator", front)?;
    curves(
        &lower,
        "identification of a window each minute, % of a core for each actuator",
        identification,
    )?;
    area.present()
}

fn curves<'a>(area: &Area<'a>, title: &str, curves: &[Curve]) -> Result<(), DrawingError<'a>> {
    let style = ("sans-serif", 15).into_font().color(&TEXT);
    let all = || curves.iter().flat_map(|curve| &curve.points);
    let most = all().fold(0.0, |most: f64, &(_, cost)| most.max(cost));
    let last = all().fold(1, |last: u64, &(actuators, _)| last.max(actuators));
    // Each number of actuators is a step of a factor of four.
    let place = |actuators: u64| (actuators as f64).ln() / 4f64.ln();
    let mut chart = ChartBuilder::on(area)
        .margin(6)
        .margin_right(30)
        .caption(title, style.clone())
        .x_label_area_size(42)
        .y_label_area_size(56)
        .build_cartesian_2d(0.0..place(last), 0.0..1.5 * most)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(TEXT.mix(0.25))
        .axis_style(TEXT)
        .label_style(style.clone())
        .x_desc("actuators")
        .x_labels(place(last) as usize + 1)
        .y_labels(5)
        .x_label_formatter(&|place| format!("{:.0}", 4f64.powf(*place)))
        .draw()?;
    for (curve, colour) in curves.iter().zip(COLOURS) {
        let points = curve.points.iter().map(|&(actuators, cost)| (place(actuators), cost));
        chart.draw_series(points.clone().map(|point| Circle::new(point, 3, colour.filled())))?;
        chart
            .draw_series(LineSeries::new(points, colour.stroke_width(2)))?
            .label(curve.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(3)));
    }
    chart
        .configure_series_labels()
        .label_font(style)
        .position(SeriesLabelPosition::UpperRight)
        .draw()?;
    Ok(())
}
