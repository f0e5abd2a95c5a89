//! A plot as inline SVG: axes with ticks, lines, bands. Colours come from the page's style by class.

use std::fmt::Write;

/// Size of the drawing, in units of its view box, and the room around the axes.
const WIDTH: f64 = 480.0;
const LEFT: f64 = 84.0;
const RIGHT: f64 = 10.0;
const TOP: f64 = 8.0;
const BOTTOM: f64 = 44.0;

/// Half the width of a digit.
const HALF_DIGIT: f64 = 4.0;

/// About so many ticks on an axis.
const TICKS: f64 = 5.0;

/// An axis: its label and its range.
#[derive(Clone, Debug)]
pub(super) struct Axis {
    label: String,
    low: f64,
    high: f64,
    /// Texts in place of numbers, at 0, 1, 2…
    names: Vec<String>,
}

impl Axis {
    /// Over all of these values, and a little more.
    pub(super) fn over(label: &str, values: impl Iterator<Item = f64>) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values.filter(|value| value.is_finite()) {
            (low, high) = (low.min(value), high.max(value));
        }
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        let room = if high > low {
            0.04 * (high - low)
        } else {
            0.5 * high.abs().max(1e-3)
        };
        Self::between(label, low - room, high + room)
    }

    /// Between two values.
    pub(super) fn between(label: &str, low: f64, high: f64) -> Self {
        Self {
            label: label.to_owned(),
            low,
            high,
            names: Vec::new(),
        }
    }

    /// Of names, which stand at 0, 1, 2…
    pub(super) fn with_names(label: &str, names: &[&str]) -> Self {
        Self {
            names: names.iter().map(|name| (*name).to_owned()).collect(),
            ..Self::between(label, -0.5, names.len() as f64 - 0.5)
        }
    }

    /// Begins no higher than 0.
    pub(super) fn down_to_zero(mut self) -> Self {
        self.low = self.low.min(0.0);
        self
    }

    /// Ticks at round numbers, with their texts.
    fn ticks(&self) -> Vec<(f64, String)> {
        if !self.names.is_empty() {
            return self
                .names
                .iter()
                .enumerate()
                .map(|(n, name)| (n as f64, name.clone()))
                .collect();
        }
        let raw = (self.high - self.low) / TICKS;
        let ten = 10.0_f64.powf(raw.log10().floor());
        let step = ten
            * [1.0, 2.0, 5.0, 10.0]
                .into_iter()
                .find(|m| m * ten >= raw)
                .unwrap_or(10.0);
        let digits = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        (first..=last)
            .map(|n| (n as f64 * step, format!("{:.digits$}", n as f64 * step)))
            .collect()
    }

    fn share(&self, value: f64) -> f64 {
        ((value - self.low) / (self.high - self.low)).clamp(0.0, 1.0)
    }
}

/// A drawing that grows by what is put into it.
pub(super) struct Plot {
    title: String,
    height: f64,
    x: Axis,
    y: Axis,
    body: String,
}

impl Plot {
    /// Empty, with its title for those who cannot see it.
    pub(super) fn new(title: &str, height: f64, x: Axis, y: Axis) -> Self {
        Self {
            title: title.to_owned(),
            height,
            x,
            y,
            body: String::new(),
        }
    }

    /// A line; it breaks where a value is missing.
    pub(super) fn line(&mut self, class: &str, points: impl Iterator<Item = (f64, Option<f64>)>) {
        let mut path = String::new();
        let mut pen_down = false;
        for (x, y) in points {
            if let Some(y) = y.filter(|y| y.is_finite()) {
                let command = if pen_down { 'L' } else { 'M' };
                // Writing to a String cannot fail.
                let _ = write!(path, "{command}{:.1} {:.1}", self.x_of(x), self.y_of(y));
            }
            pen_down = y.is_some_and(f64::is_finite);
        }
        self.path(class, &path);
    }

    /// A line that holds each value until the next.
    pub(super) fn steps(&mut self, class: &str, points: &[(f64, f64)]) {
        let corners = points.windows(2).flat_map(|pair| [pair[0], (pair[1].0, pair[0].1)]);
        let corners: Vec<_> = corners.chain(points.last().copied()).collect();
        self.line(class, corners.into_iter().map(|(x, y)| (x, Some(y))));
    }

    /// Dots.
    pub(super) fn dots(&mut self, class: &str, points: impl Iterator<Item = (f64, f64)>) {
        let mut path = String::new();
        for (x, y) in points {
            let _ = write!(path, "M{:.1} {:.1}h0", self.x_of(x), self.y_of(y));
        }
        self.path(class, &path);
    }

    /// A band between two values for each x; it breaks where they are missing.
    pub(super) fn band(&mut self, class: &str, points: impl Iterator<Item = (f64, Option<(f64, f64)>)>) {
        let mut path = String::new();
        let mut part: Vec<(f64, f64, f64)> = Vec::new();
        for (x, between) in points.chain(std::iter::once((0.0, None))) {
            if let Some((low, high)) = between {
                part.push((x, low, high));
                continue;
            }
            let forth = part.iter().map(|&(x, low, _)| (x, low));
            let back = part.iter().rev().map(|&(x, _, high)| (x, high));
            for (n, (x, y)) in forth.chain(back).enumerate() {
                let command = if n == 0 { 'M' } else { 'L' };
                let _ = write!(path, "{command}{:.1} {:.1}", self.x_of(x), self.y_of(y));
            }
            if !part.is_empty() {
                path.push('Z');
            }
            part.clear();
        }
        self.path(class, &path);
    }

    /// A horizontal line over the whole width with its name at its right end.
    pub(super) fn level(&mut self, class: &str, y: f64, name: &str) {
        let (y, right) = (self.y_of(y), WIDTH - RIGHT);
        let _ = write!(
            self.body,
            "<path class=\"{class}\" d=\"M{LEFT} {y:.1}H{right}\"/><text x=\"{:.1}\" y=\"{:.1}\" class=\"small\">{}</text>",
            // At the old end: the newest points count.
            LEFT + 4.0,
            y - 3.0,
            escaped(name)
        );
    }

    /// A vertical line over the whole height.
    pub(super) fn mark(&mut self, class: &str, x: f64) {
        let (x, bottom) = (self.x_of(x), self.height - BOTTOM);
        let _ = write!(self.body, "<path class=\"{class}\" d=\"M{x:.1} {TOP}V{bottom}\"/>");
    }

    /// The area between two values over the whole width.
    pub(super) fn zone(&mut self, class: &str, low: f64, high: f64) {
        let (low, high, right) = (self.y_of(low), self.y_of(high), WIDTH - RIGHT);
        let _ = write!(
            self.body,
            "<path class=\"{class}\" d=\"M{LEFT} {low:.1}H{right}V{high:.1}H{LEFT}Z\"/>"
        );
    }

    fn path(&mut self, class: &str, path: &str) {
        if !path.is_empty() {
            let _ = write!(self.body, "<path class=\"{class}\" d=\"{path}\"/>");
        }
    }

    fn x_of(&self, x: f64) -> f64 {
        LEFT + self.x.share(x) * (WIDTH - LEFT - RIGHT)
    }

    fn y_of(&self, y: f64) -> f64 {
        self.height - BOTTOM - self.y.share(y) * (self.height - TOP - BOTTOM)
    }

    /// The drawing.
    pub(super) fn svg(&self) -> String {
        let (bottom, right) = (self.height - BOTTOM, WIDTH - RIGHT);
        let mut text = format!(
            "<svg viewBox=\"0 0 {WIDTH} {}\" role=\"img\" aria-label=\"{}\"><title>{1}</title>",
            self.height,
            escaped(&self.title)
        );
        for (value, label) in self.x.ticks() {
            let x = self.x_of(value);
            // A label at the edge ends there.
            let half = HALF_DIGIT * label.chars().count() as f64;
            let (at, class) = if x + half > WIDTH { (WIDTH, "end") } else { (x, "mid") };
            let _ = write!(
                text,
                "<path class=\"grid\" d=\"M{x:.1} {TOP}V{bottom}\"/><text x=\"{at:.1}\" y=\"{:.1}\" class=\"{class}\">{}</text>",
                bottom + 18.0,
                escaped(&label)
            );
        }
        for (value, label) in self.y.ticks() {
            let y = self.y_of(value);
            let _ = write!(
                text,
                "<path class=\"grid\" d=\"M{LEFT} {y:.1}H{right}\"/><text x=\"{:.1}\" y=\"{:.1}\" class=\"end\">{}</text>",
                LEFT - 6.0,
                y + 5.0,
                escaped(&label)
            );
        }
        text += &self.body;
        let _ = write!(
            text,
            "<text x=\"{:.1}\" y=\"{:.1}\" class=\"mid\">{}</text>",
            0.5 * (LEFT + right),
            self.height - 6.0,
            escaped(&self.x.label)
        );
        if !self.y.label.is_empty() {
            let middle = 0.5 * (TOP + bottom);
            let _ = write!(
                text,
                "<text x=\"14\" y=\"{middle:.1}\" class=\"mid\" transform=\"rotate(-90 14 {middle:.1})\">{}</text>",
                escaped(&self.y.label)
            );
        }
        text + "</svg>"
    }
}

/// A number with three significant digits.
pub(super) fn significant(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return "0".to_owned();
    }
    let digits = (2.0 - value.abs().log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{value:.digits$}")
}

/// A number with three significant digits, small ones with an exponent.
pub(super) fn number(value: f64) -> String {
    if (f64::MIN_POSITIVE..1e-3).contains(&value.abs()) {
        format!("{value:.2e}")
    } else {
        significant(value)
    }
}

/// Escapes text for HTML and SVG.
pub(super) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let texts = |axis: &Axis| axis.ticks().into_iter().map(|t| t.1).collect::<Vec<_>>().join(" ");
        assert_eq!(texts(&Axis::between("", 0.0, 100.0)), "0 20 40 60 80 100");
        assert_eq!(texts(&Axis::between("", -0.013, 0.021)), "-0.01 0.00 0.01 0.02");
        assert_eq!(texts(&Axis::with_names("", &["a", "b"])), "a b");
        for axis in [
            Axis::over("", std::iter::empty()),
            Axis::over("", [5.0].into_iter()),
            Axis::over("", [0.0].into_iter()),
        ] {
            assert!(axis.high > axis.low && (2..9).contains(&axis.ticks().len()), "{axis:?}");
        }
    }

    #[test]
    fn three_digits_count() {
        assert_eq!(
            [0.0, 0.000_123_4, 0.0371, 12.34, 1234.5].map(significant),
            ["0", "0.000123", "0.0371", "12.3", "1234"]
        );
    }

    #[test]
    fn lines_and_bands_break_where_nothing_is_known() {
        let axis = || Axis::between("a < b", 0.0, 4.0);
        let mut plot = Plot::new("\"x\"", 100.0, axis(), axis());
        plot.line(
            "m",
            [
                (0.0, Some(1.0)),
                (1.0, None),
                (2.0, Some(f64::NAN)),
                (3.0, Some(1.0)),
                (4.0, Some(2.0)),
            ]
            .into_iter(),
        );
        assert_eq!(plot.body.matches('M').count(), 2);
        assert_eq!(plot.body.matches('L').count(), 1);
        plot.band(
            "b",
            [(0.0, Some((0.0, 1.0))), (1.0, Some((0.0, 1.0))), (2.0, None)].into_iter(),
        );
        assert_eq!(plot.body.matches('Z').count(), 1);
        let svg = plot.svg();
        assert!(
            svg.contains("a &lt; b") && svg.contains("&quot;x&quot;") && !svg.contains("NaN"),
            "{svg}"
        );
    }
}
