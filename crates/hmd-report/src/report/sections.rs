//! The plots of a report.

use ema_models::{FaultId, FaultVector};
use hmd_core::catalogue::FaultMode;
use hmd_core::health::HealthState;
use hmd_core::history::ReplacedPart;
use hmd_core::record::Window;

use super::axis::{Mark, UseAxis};
use super::doubt::is_shown_before;
use super::history::{History, Point};
use super::plot::{Axis, Plot, escaped, significant};
use super::words::{NORMAL_95, percent_of, range_of};
use super::zone::Zone;

pub(super) const HEIGHT: f64 = 230.0;

/// Most samples of a window, and most windows of a history, that are drawn; then every n-th, and the last.
pub(super) const SAMPLES_MAX: usize = 1200;
const POINTS_MAX: usize = 400;

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

/// A window that is drawn: its index in the history and its place on the axis of use.
#[derive(Clone, Copy)]
struct Place<'a> {
    n: usize,
    at: f64,
    point: &'a Point,
}

/// The windows that are drawn over use, and the marks between them.
struct Drawn<'a> {
    x: Axis,
    points: Vec<Place<'a>>,
    /// Index of the window after it, place.
    marks: Vec<(usize, f64, Mark)>,
}

impl<'a> Drawn<'a> {
    fn new(history: &'a History) -> Self {
        let UseAxis { label, places, marks } = UseAxis::new(history);
        let all = places.iter().zip(&history.points).enumerate();
        let all: Vec<Place<'_>> = all.map(|(n, (&at, point))| Place { n, at, point }).collect();
        let marks: Vec<_> = marks.iter().map(|&(n, mark)| (n, places[n], mark)).collect();
        Self {
            x: Axis::over(label, places.into_iter()),
            points: thinned(&all, POINTS_MAX),
            marks: thinned(&marks, POINTS_MAX),
        }
    }

    /// An empty plot with the marks.
    fn plot(&self, title: &str, y: Axis) -> Plot {
        let mut plot = Plot::new(title, HEIGHT, self.x.clone(), y);
        // Of several parts that were replaced at once one line.
        let mut drawn: Vec<(usize, &str)> = Vec::new();
        for (n, at, mark) in &self.marks {
            let line = (*n, mark.class());
            if drawn.last() != Some(&line) {
                plot.mark(mark.class(), *at);
            }
            drawn.push(line);
        }
        plot
    }

    /// Values of all points that have one.
    fn values(&self, value: impl Fn(&Point) -> Option<f64>) -> impl Iterator<Item = (f64, f64)> {
        self.points
            .iter()
            .filter_map(move |place| Some((place.at, value(place.point)?)))
    }

    /// A value, or the two of a band, of each window, which a line joins; a reset breaks it, and so does a new part, of a damage one that its
    /// fault is of.
    fn line<T>(&self, damage_by: Option<FaultId>, value: impl Fn(&Point) -> Option<T>) -> Vec<(f64, Option<T>)> {
        let breaks = |mark| match (mark, damage_by) {
            (Mark::Restart, _) => false,
            (Mark::Replaced(part), Some(fault)) => ReplacedPart::renews(Some(part), fault),
            (Mark::Unit | Mark::Reset | Mark::Replaced(_), _) => true,
        };
        let resets = self.marks.iter().filter(|(_, _, mark)| breaks(*mark));
        let mut resets = resets.map(|(n, ..)| *n).peekable();
        let mut line = Vec::with_capacity(self.points.len());
        for place in &self.points {
            while resets.next_if(|reset| *reset <= place.n).is_some() {
                line.push((place.at, None));
            }
            line.push((place.at, value(place.point)));
        }
        line
    }
}

/// Most times that are listed of one kind of mark, the newest.
const TIMES_MAX: usize = 5;

/// Legend of the marks in the plots over use, with the windows that they precede; empty where there are none.
pub(super) fn legend(history: &History, zone: &Zone) -> String {
    let marks = UseAxis::new(history).marks;
    let key = |mark: Mark| {
        let found = marks.iter().filter(|(_, found)| *found == mark);
        let mut times: Vec<u64> = found.map(|(n, _)| history.points[*n].t_start_ns).collect();
        // Recordings that overlap are not in the order of time.
        times.sort_unstable();
        let more = times.len().saturating_sub(TIMES_MAX);
        let times: Vec<String> = times[more..].iter().map(|t_ns| zone.minute(*t_ns)).collect();
        let more = if more > 0 {
            format!("{more} times, then before ")
        } else {
            "before ".to_owned()
        };
        format!(
            "<span class=\"key {}\">{} {more}{}</span><br>",
            mark.class(),
            mark.name(),
            times.join(", ")
        )
    };
    // In the order in which they come last.
    let mut kinds: Vec<Mark> = Vec::new();
    for (_, mark) in marks.iter().rev() {
        if !kinds.contains(mark) {
            kinds.push(*mark);
        }
    }
    let kinds: String = kinds.into_iter().rev().map(key).collect();
    if kinds.is_empty() {
        kinds
    } else {
        format!("<p class=\"faint\">{kinds}</p>\n")
    }
}

/// Damage of each fault over use in percent, with its 95 % interval and its levels; the scale is the same for all.
pub(super) fn damages(history: &History, modes: &[FaultMode; FaultId::COUNT]) -> String {
    let drawn = Drawn::new(history);
    FaultId::ALL
        .into_iter()
        .zip(modes)
        .map(|(fault, mode)| damage(&drawn, fault, mode, &newest_damage(history, fault)))
        .collect()
}

/// Damage by the newest window that shows the fault, as the table has it.
fn newest_damage(history: &History, fault: FaultId) -> String {
    if history.is_replaced_since(fault) {
        return "replaced".to_owned();
    }
    let Some(shown) = history.newest.shown.of(fault) else {
        return match is_shown_before(history, fault) {
            true => "not shown since the replacement".to_owned(),
            false => "no window shows it".to_owned(),
        };
    };
    let percent = percent_of(shown.damage);
    range_of(shown).map_or_else(
        || percent.clone(),
        |range| format!("{percent}, with 95 % probability {range}"),
    )
}

fn damage(drawn: &Drawn<'_>, fault: FaultId, mode: &FaultMode, newest: &str) -> String {
    let p = fault.parameter();
    // The damage of the gain is twice its deviation, and so is its sigma.
    let per_parameter = if fault == FaultId::Gain { 2.0 } else { 1.0 };
    let shown = |point: &Point| point.estimate.filter(|estimate| estimate.tells_of(p));
    // What a window tells nothing of has no line.
    let value = |point: &Point| shown(point).map(|e| 100.0 * FaultVector::from_array(e.k).damage_of(fault));
    let interval = |point: &Point| {
        let half = 100.0 * NORMAL_95 * per_parameter * shown(point)?.sigma[p]?;
        let damage = value(point)?;
        Some(((damage - half).max(0.0), (damage + half).min(100.0)))
    };
    let mut plot = drawn.plot(
        &format!("Damage by {fault} over use, with its interval"),
        Axis::between("damage, %", 0.0, 100.0),
    );
    let [watch, warning, critical] = mode.severity.map(|severity| 100.0 * severity.damage);
    plot.zone("healthy", 0.0, watch);
    plot.band("band", drawn.line(Some(fault), interval).into_iter());
    plot.line("value", drawn.line(Some(fault), value).into_iter());
    plot.dots("dots", drawn.values(value));
    // In front, so that their names can be read.
    plot.level("level", watch, "watch");
    plot.level("level", warning, "warning");
    plot.level("level", critical, "critical");
    plot.level("level", 100.0 * mode.end_of_life, "end of life");
    figure(
        &plot,
        &format!("<strong>{}</strong>: {newest}", escaped(fault.plain_name())),
    )
}

/// State of health over use.
pub(super) fn timeline(history: &History) -> String {
    let drawn = Drawn::new(history);
    let names = HealthState::ALL.map(HealthState::name);
    let mut plot = drawn.plot("State of health over use", Axis::with_names("", &names));
    let level = |state: &str| names.iter().position(|known| *known == state).unwrap_or(0) as f64;
    let levels: Vec<(f64, f64)> = drawn.values(|point| Some(level(&point.health))).collect();
    plot.steps("value", &levels);
    plot.dots("dots", levels.iter().copied());
    figure(&plot, "State of health after each window")
}

/// Hours left over use, with the 80 % interval.
pub(super) fn remaining(history: &History) -> String {
    let drawn = Drawn::new(history);
    let values = drawn.points.iter().filter_map(|place| place.point.left_h).flatten();
    let mut plot = drawn.plot(
        "Remaining useful life with its 80 % interval",
        Axis::over("hours left", values).down_to_zero(),
    );
    plot.band(
        "band",
        drawn.line(None, |point| point.left_h.map(|h| (h[0], h[2]))).into_iter(),
    );
    plot.line(
        "value",
        drawn.line(None, |point| point.left_h.map(|h| h[1])).into_iter(),
    );
    figure(
        &plot,
        "Remaining useful life: <span class=\"key\">median</span>, band from the 10 % to the 90 % quantile",
    )
}

/// Root mean square of the current residual over use.
pub(super) fn residuals(history: &History) -> String {
    let drawn = Drawn::new(history);
    let values = drawn.values(|point| point.residual_rms_a).map(|(_, value)| value);
    let y = Axis::over("residual, A rms", values).down_to_zero();
    let mut plot = drawn.plot("Current residual over use", y);
    plot.line("value", drawn.line(None, |point| point.residual_rms_a).into_iter());
    figure(&plot, "Residual (RMS) of the current in each window")
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
    use hmd_core::record::Health;

    #[test]
    fn a_reset_breaks_a_line_between_the_windows_it_lies_between() {
        let points = [(0, 0.0), (1, 5.0), (2, 0.0), (3, 1.0)].map(|(window, used_h)| Point {
            window,
            used_h: Some(used_h),
            residual_rms_a: Some(used_h),
            ..Point::default()
        });
        let history = History {
            points: points.to_vec(),
            ..History::default()
        };
        let line = Drawn::new(&history).line(None, |point: &Point| point.residual_rms_a);
        let expected = [Some(0.0), Some(5.0), None, Some(0.0), Some(1.0)];
        assert_eq!(line.iter().map(|(_, value)| *value).collect::<Vec<_>>(), expected);
        assert_eq!(
            line.iter().map(|(at, _)| *at).collect::<Vec<_>>(),
            [0.0, 5.0, 5.0, 5.0, 6.0]
        );
    }

    #[test]
    fn times_of_a_mark_are_in_order_where_recordings_overlap() {
        let points = [0, 300, 60, 400].map(|minute| Point {
            t_start_ns: minute * 60_000_000_000,
            ..Point::default()
        });
        let history = History {
            points: points.to_vec(),
            ..History::default()
        };
        let legend = legend(&history, &Zone::utc());
        let expected = "before 1970-01-01 01:00 UTC, 1970-01-01 05:00 UTC, 1970-01-01 06:40 UTC";
        assert!(legend.contains(expected), "{legend}");
    }

    #[test]
    fn parts_that_were_replaced_at_once_have_one_line() {
        let mut points = vec![Point::default(), Point::default()];
        for (n, point) in points.iter_mut().enumerate() {
            point.window = n as u64;
        }
        points[1].replaced = vec![Some(ReplacedPart::Motor), Some(ReplacedPart::Gearbox)];
        let history = History {
            points,
            ..History::default()
        };
        let svg = Drawn::new(&history).plot("", Axis::between("", 0.0, 1.0)).svg();
        assert_eq!(svg.matches("class=\"replaced\"").count(), 1);
        let legend = legend(&history, &Zone::utc());
        assert!(legend.contains("motor replaced") && legend.contains("gearbox replaced"));
    }

    #[test]
    fn the_last_is_always_drawn_once() {
        for length in 0..50 {
            let all: Vec<usize> = (0..length).collect();
            let left = thinned(&all, 7);
            assert!(left.len() <= 8 && left.last() == all.last(), "{length}: {left:?}");
            assert!(left.is_sorted_by(|a, b| a < b), "{length}: {left:?}");
        }
    }

    #[test]
    fn a_figure_says_what_the_table_says() {
        let mut health = Health::default();
        health.set_states(&[HealthState::Nominal; FaultId::COUNT]);
        health.set_damage([Some(0.5), None, None, None, None, None, None]);
        let mut history = History::default();
        history.add(health);
        // The newest window tells of backlash, but does not show its state.
        history.points[0].estimate = Some(hmd_core::record::Estimate {
            k: [0.5; 8],
            sigma: [Some(0.2); 8],
            observable: [true; 8],
        });
        assert_eq!(newest_damage(&history, FaultId::Friction), "50.0 %");
        assert_eq!(newest_damage(&history, FaultId::Backlash), "no window shows it");
        history.replaced_since = vec![super::super::history::Replacement {
            part: Some(ReplacedPart::Gearbox),
            t_ns: 0,
            note: String::new(),
        }];
        assert_eq!(newest_damage(&history, FaultId::Friction), "replaced");
    }
}
