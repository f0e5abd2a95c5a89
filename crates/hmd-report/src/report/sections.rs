//! The plots of a report.

use ema_models::FaultVector;

use super::history::{History, Point};
use super::plot::{Axis, Plot, escaped, significant};
use hmd_core::record::Window;

pub(super) const HEIGHT: f64 = 230.0;

/// Most samples of a window, and most windows of a history, that are drawn; then every n-th, and the last.
pub(super) const SAMPLES_MAX: usize = 1200;
const POINTS_MAX: usize = 400;

/// Factor on a standard deviation for 95 %.
pub(super) const NORMAL_95: f64 = 1.96;

/// States of health as they stand in the timeline.
const STATES: [&str; 5] = ["unknown", "nominal", "watch", "warning", "critical"];

/// A drawing with the sentence below it; what is in the sentence is HTML.
pub(super) fn figure(plot: &Plot, caption: &str) -> String {
    format!("<figure>{}<figcaption>{caption}</figcaption></figure>\n", plot.svg())
}

/// Measured against fitted current, speed and position, each with its residual.
pub(super) fn fit(window: &Window) -> String {
    let mut text = String::new();
    for (name, unit, measured, fitted) in [
        ("quadrature current", "A", &window.measured_i_q_a, &window.fitted_i_q_a),
        (
            "motor speed",
            "rad/s",
            &window.measured_speed_rad_s,
            &window.fitted_speed_rad_s,
        ),
        (
            "output position",
            "rad",
            &window.measured_position_rad,
            &window.fitted_position_rad,
        ),
    ] {
        let time: Vec<f64> = window.time_s.iter().map(|t| f64::from(*t)).collect();
        let rows: Vec<(f64, f64, f64)> = time
            .iter()
            .zip(measured)
            .zip(fitted)
            .map(|((t, m), f)| (*t, f64::from(*m), f64::from(*f)))
            .collect();
        let drawn = thinned(&rows, SAMPLES_MAX);
        let along = || Axis::over("time, s", time.iter().copied());
        let label = format!("{name}, {unit}");
        let mut both = Plot::new(
            &format!("Measured and fitted {name}"),
            HEIGHT,
            along(),
            Axis::over(&label, rows.iter().flat_map(|r| [r.1, r.2])),
        );
        both.line("measured", drawn.iter().map(|r| (r.0, Some(r.1))));
        both.line("fitted", drawn.iter().map(|r| (r.0, Some(r.2))));
        text += &figure(
            &both,
            &format!("<span class=\"key\">measured</span> <span class=\"key f\">fitted</span> {name}"),
        );

        let mut residual = Plot::new(
            &format!("Residual of the {name}"),
            HEIGHT,
            along(),
            Axis::over(&format!("residual, {unit}"), rows.iter().flat_map(|r| [r.1 - r.2, 0.0])),
        );
        residual.line("residual", drawn.iter().map(|r| (r.0, Some(r.1 - r.2))));
        let square: f64 = rows.iter().map(|r| (r.1 - r.2).powi(2)).sum();
        let rms = (square / rows.len().max(1) as f64).sqrt();
        text += &figure(
            &residual,
            &format!(
                "<span class=\"key r\">residual</span>, measured minus fitted: {} {unit} rms",
                significant(rms)
            ),
        );
    }
    text
}

/// Position of a window: after some operating hours, or, while they do not count, by its number.
fn place(history: &History) -> (&'static str, Vec<f64>) {
    let hours: Option<Vec<f64>> = history.points.iter().map(|point| point.used_h).collect();
    match hours {
        Some(hours) if hours.last().is_some_and(|last| *last >= 1.0) => ("operating time, h", hours),
        _ => (
            "window",
            history.points.iter().map(|point| point.window as f64).collect(),
        ),
    }
}

/// Windows that are drawn, with their place.
fn drawn(history: &History) -> (Axis, Vec<(f64, &Point)>) {
    let (label, places) = place(history);
    let all: Vec<(f64, &Point)> = places.iter().copied().zip(&history.points).collect();
    (Axis::over(label, places.into_iter()), thinned(&all, POINTS_MAX))
}

/// The fault vector over the life, with its 95 % intervals.
pub(super) fn fault_vector(history: &History) -> String {
    let (x, points) = drawn(history);
    let mut text = String::new();
    for p in 0..FaultVector::NAMES.len() {
        let name = FaultVector::NAMES[p].replace('_', " ");
        let interval = |point: &Point| {
            let estimate = point.estimate.as_ref()?;
            let half = NORMAL_95 * estimate.sigma[p]?;
            let k = estimate.k[p];
            Some(((k - half).max(0.0), (k + half).min(1.0)))
        };
        // What a window does not show has no line.
        let value = |point: &Point| point.estimate.as_ref().filter(|e| e.observable[p]).map(|e| e.k[p]);
        let nominal = if p >= 6 { 0.5 } else { 0.0 };
        let values = points.iter().filter_map(|(_, point)| value(point));
        let bounds = points
            .iter()
            .filter_map(|(_, point)| interval(point))
            .flat_map(|(low, high)| [low, high]);
        let y = Axis::over(&format!("k{}", p + 1), values.chain(bounds).chain([nominal]));
        let mut plot = Plot::new(
            &format!("History of k{}, {name}, with its interval", p + 1),
            HEIGHT,
            x.clone(),
            y,
        );
        plot.line("nominal", points.iter().map(|(at, _)| (*at, Some(nominal))));
        plot.band("band", points.iter().map(|(at, point)| (*at, interval(point))));
        plot.line("value", points.iter().map(|(at, point)| (*at, value(point))));
        plot.dots(
            "dots",
            points.iter().filter_map(|(at, point)| Some((*at, value(point)?))),
        );
        let newest = points
            .iter()
            .rev()
            .find_map(|(_, point)| Some((value(point)?, interval(point))));
        let summary = match newest {
            Some((k, Some((low, high)))) => format!("newest {k:.3}, 95 % between {low:.3} and {high:.3}"),
            Some((k, None)) => format!("newest {k:.3}"),
            None => "no window shows it".to_owned(),
        };
        text += &figure(&plot, &format!("k{} {}: {summary}", p + 1, escaped(&name)));
    }
    text
}

/// State of health over the life.
pub(super) fn timeline(history: &History) -> String {
    let (x, points) = drawn(history);
    let mut plot = Plot::new(
        "State of health over the life",
        HEIGHT,
        x,
        Axis::with_names("", &STATES),
    );
    let level = |state: &str| STATES.iter().position(|known| *known == state).unwrap_or(0) as f64;
    let levels: Vec<(f64, f64)> = points.iter().map(|(at, point)| (*at, level(&point.health))).collect();
    plot.steps("value", &levels);
    plot.dots("dots", levels.iter().copied());
    figure(&plot, "State of health after each window")
}

/// Hours left over the life, with the 80 % interval.
pub(super) fn remaining(history: &History) -> String {
    let (x, points) = drawn(history);
    let values = points.iter().filter_map(|(_, point)| point.left_h).flatten();
    let mut plot = Plot::new(
        "Remaining useful life with its 80 % interval",
        HEIGHT,
        x,
        Axis::over("hours left", values).down_to_zero(),
    );
    plot.band(
        "band",
        points
            .iter()
            .map(|(at, point)| (*at, point.left_h.map(|h| (h[0], h[2])))),
    );
    plot.line(
        "value",
        points.iter().map(|(at, point)| (*at, point.left_h.map(|h| h[1]))),
    );
    figure(
        &plot,
        "Remaining useful life: <span class=\"key\">median</span>, band from the 10 % to the 90 % quantile",
    )
}

/// Root mean square of the current residual over the life.
pub(super) fn residuals(history: &History) -> String {
    let (x, points) = drawn(history);
    let values = points.iter().filter_map(|(_, point)| point.residual_rms_a);
    let y = Axis::over("residual, A rms", values).down_to_zero();
    let mut plot = Plot::new("Current residual over the life", HEIGHT, x, y);
    plot.line("value", points.iter().map(|(at, point)| (*at, point.residual_rms_a)));
    figure(&plot, "What the fit leaves of the current, in each window")
}

/// Every n-th, so that no more than about `most` are left, and the last.
pub(super) fn thinned<T: Copy>(all: &[T], most: usize) -> Vec<T> {
    let step = all.len().div_ceil(most).max(1);
    let mut left: Vec<T> = all.iter().copied().step_by(step).collect();
    if all.len() % step != 1 % step {
        left.extend(all.last().copied());
    }
    left
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_is_always_drawn_once() {
        for length in 0..50 {
            let all: Vec<usize> = (0..length).collect();
            let left = thinned(&all, 7);
            assert!(left.len() <= 8 && left.last() == all.last(), "{length}: {left:?}");
            assert!(left.is_sorted_by(|a, b| a < b), "{length}: {left:?}");
        }
    }
}
