//! [`Course`]: one signal of a log, value by value -> its values between them.
//!
//! Between two of its own values a signal lies on the polynomial through them and one neighbour on each side (Lagrange, third degree), as far
//! as there are neighbours. How far it may be off there is the difference from the polynomial without the farther neighbour, which is more
//! than the error of a smooth signal.

use super::log::{Between, Interpolated};

/// Values that a polynomial goes through.
const KNOTS: usize = 4;

/// One signal so far.
#[derive(Debug)]
pub(super) struct Course {
    between: Between,
    /// The newest values, each with its time.
    knots: Vec<[f64; 2]>,
    /// The last value of an angle that begins again, with all its turns.
    continued: Option<f64>,
    has_begun: bool,
    held: f64,
    pub(super) interpolated: Interpolated,
}

/// A stretch between two values, and the polynomial there.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    pub(super) from: f64,
    pub(super) to: f64,
    knots: Vec<[f64; 2]>,
    /// The knot that is the farther neighbour.
    farther: usize,
}

/// What a new value tells of the times before it.
pub(super) enum News {
    /// It is the first.
    Begins,
    /// A stretch is known now; none where the last value was long ago.
    Known(Option<Piece>),
}

impl Course {
    pub(super) fn new(between: Between) -> Self {
        Self {
            between,
            knots: Vec::with_capacity(KNOTS + 1),
            continued: None,
            has_begun: false,
            held: f64::NAN,
            interpolated: Interpolated::default(),
        }
    }

    /// Whether it has values between its own.
    pub(super) fn is_curve(&self) -> bool {
        matches!(self.between, Between::Curve { .. })
    }

    /// The last value of a signal that holds it; else no number.
    pub(super) fn held(&self) -> f64 {
        self.held
    }

    /// Time of the last value.
    pub(super) fn last(&self) -> Option<f64> {
        self.knots.last().map(|[time, _]| *time)
    }

    /// Takes a value of a signal that holds it.
    pub(super) fn hold(&mut self, value: f64) {
        if self.between == Between::Held {
            self.held = value;
        }
    }

    /// A value of an angle that begins again, with all the turns before it: the nearest to the one before. Any other value is as it is.
    pub(super) fn continued(&mut self, value: f64) -> f64 {
        let Between::Curve {
            wraps_after: Some(turn),
        } = self.between
        else {
            return value;
        };
        if !value.is_finite() {
            return value;
        }
        let last = self.continued.unwrap_or(value);
        let value = value + turn * f64::round((last - value) / turn);
        self.continued = Some(value);
        value
    }

    /// Takes a value of a curve. Values further apart than `step_max` are no neighbours.
    pub(super) fn push(&mut self, time: f64, value: f64, step_max: f64) -> News {
        if !std::mem::replace(&mut self.has_begun, true) {
            self.knots.push([time, value]);
            return News::Begins;
        }
        let Some(&[last, _]) = self.knots.last() else {
            return News::Known(None);
        };
        let step = time - last;
        if !(step > 0.0 && step <= step_max) {
            let known = self.rest();
            self.knots.clear();
            self.knots.push([time, value]);
            return News::Known(known);
        }
        self.knots.push([time, value]);
        if self.knots.len() > KNOTS {
            self.knots.remove(0);
        }
        let count = self.knots.len();
        // What lies before the new value waits for the next one.
        let known = (count > 2).then(|| self.piece(count - 3, if count == KNOTS { 0 } else { count - 1 }));
        News::Known(known)
    }

    /// The last stretch, when no further value comes.
    pub(super) fn rest(&self) -> Option<Piece> {
        let count = self.knots.len();
        (count > 1).then(|| self.piece(count - 2, 0))
    }

    fn piece(&self, first: usize, farther: usize) -> Piece {
        Piece {
            from: self.knots[first][0],
            to: self.knots[first + 1][0],
            knots: self.knots.clone(),
            farther,
        }
    }

    /// Counts a value that was made.
    pub(super) fn made(&mut self, error: f64) {
        self.interpolated.values += 1;
        self.interpolated.error = self.interpolated.error.max(error);
    }
}

impl Piece {
    /// Value at a time, and how far it may be off.
    pub(super) fn at(&self, time: f64) -> (f64, f64) {
        let value = self.through(time, None);
        // Two values show no curvature.
        let is_curved = self.knots.len() > 2;
        let error = if is_curved {
            (value - self.through(time, Some(self.farther))).abs()
        } else {
            0.0
        };
        (value, error)
    }

    /// The polynomial through all knots but one, by Lagrange's formula.
    fn through(&self, time: f64, without: Option<usize>) -> f64 {
        let knots = || self.knots.iter().enumerate().filter(|(n, _)| Some(*n) != without);
        let weight = |n: usize, own: f64| {
            let others = knots().filter(|(other, _)| *other != n);
            others.map(|(_, [at, _])| (time - at) / (own - at)).product::<f64>()
        };
        knots().map(|(n, [at, value])| value * weight(n, *at)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Worst error and stated error of a sine between its values, so many to a period.
    fn of_a_sine(per_period: f64) -> [f64; 2] {
        let mut course = Course::new(Between::Curve { wraps_after: None });
        let sine = |t: f64| (std::f64::consts::TAU * t / per_period).sin();
        let mut worst = [0.0_f64; 2];
        for n in 0..100 {
            let t = f64::from(n);
            if let News::Known(Some(piece)) = course.push(t, sine(t), 8.0) {
                let at = 0.5 * (piece.from + piece.to);
                let (value, error) = piece.at(at);
                worst = [worst[0].max((value - sine(at)).abs()), worst[1].max(error)];
            }
        }
        worst
    }

    #[test]
    fn a_sine_is_met_and_its_error_is_not_understated() {
        // The cubic is off by 3/128 (ωh)⁴, the first stretch, a parabola, by (ωh)³/16.
        for per_period in [12.0, 24.0, 48.0] {
            let step = std::f64::consts::TAU / per_period;
            let [off, stated] = of_a_sine(per_period);
            assert!(
                off <= step.powi(3) / 15.0 && off <= stated,
                "{per_period}: {off} {stated}"
            );
            assert!(stated <= step.powi(3) / 8.0, "{per_period}: {stated}");
        }
    }

    #[test]
    fn far_values_are_no_neighbours_and_two_make_a_line() {
        let mut course = Course::new(Between::Curve { wraps_after: None });
        assert!(matches!(course.push(0.0, 1.0, 8.0), News::Begins));
        assert!(matches!(course.push(1.0, 3.0, 8.0), News::Known(None)));
        let News::Known(Some(piece)) = course.push(20.0, 0.0, 8.0) else {
            panic!("the stretch before the pause");
        };
        assert_eq!((piece.from, piece.to, piece.at(0.25)), (0.0, 1.0, (1.5, 0.0)));
        assert!(course.rest().is_none());
    }
}
