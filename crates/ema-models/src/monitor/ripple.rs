//! Mean effect of the hysteresis band on the currents.
//!
//! Three comparators on one star do not hold the mean current at the reference: it falls short of it by a vector along
//! the inverter's mean voltage, `−h g(m) v/|v|`, where m is the voltage over V_dc/2. Found here by sweeping speed and
//! load of the reference on two very different actuators: the component across the voltage is an order smaller, and the
//! curve g is nearly the same on both (`hmd calibrate --type` measures it; `docs/monitor.md` shows it).

use crate::real::Real;

/// Number of knots of the curve, at m = 0.1, 0.2, … ; g(0) = 0, and it is flat beyond the last one, near the voltage
/// hexagon's corner at m = 2/√3.
pub const RIPPLE_KNOTS: usize = 11;

/// Distance of the knots.
pub const RIPPLE_SPACING: f64 = 0.1;

/// Places of the knots.
const KNOTS: [f64; RIPPLE_KNOTS] = {
    let mut knots = [0.0; RIPPLE_KNOTS];
    let mut n = 0;
    while n < RIPPLE_KNOTS {
        knots[n] = (n + 1) as f64 * RIPPLE_SPACING;
        n += 1;
    }
    knots
};

/// The curve before a type's own calibration: mean of the two shipped actuators.
pub const RIPPLE_DEFAULT: [f64; RIPPLE_KNOTS] = [
    0.062, 0.080, 0.100, 0.140, 0.146, 0.120, 0.074, 0.070, 0.150, 0.186, 0.220,
];

/// The curve as a sum of hinges, `Σ bend max(m, knot) − Σ bend knot`, ready for any number type.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RippleCurve<R> {
    /// Change of slope at m = 0, 0.1, …, in A.
    bends: [R; RIPPLE_KNOTS + 1],
    /// `Σ bend knot`, A.
    offset: R,
}

impl RippleCurve<f64> {
    /// From the knots of g and the half band h, A.
    pub(crate) fn new(knots: &[f64; RIPPLE_KNOTS], half_band: f64) -> Self {
        let mut bends = [0.0; RIPPLE_KNOTS + 1];
        let (mut last, mut slope) = (0.0, 0.0);
        for (n, &g) in knots.iter().enumerate() {
            let next = half_band * (g - last) / RIPPLE_SPACING;
            bends[n] = next - slope;
            (last, slope) = (g, next);
        }
        bends[RIPPLE_KNOTS] = -slope;
        let knots = bends.iter().enumerate();
        let offset = knots.map(|(n, bend)| bend * (n as f64 * RIPPLE_SPACING)).sum();
        Self { bends, offset }
    }
}

impl<R> RippleCurve<R> {
    /// The same curve in another number type.
    pub(crate) fn map<S>(self, mut f: impl FnMut(R) -> S) -> RippleCurve<S> {
        RippleCurve {
            bends: self.bends.map(&mut f),
            offset: f(self.offset),
        }
    }
}

impl<R: Real> RippleCurve<R> {
    /// Shortfall of the mean current, A, at the relative voltage m ≥ 0.
    #[inline(always)]
    pub(crate) fn shortfall(&self, m: R) -> R {
        let mut sum = self.bends[0] * m - self.offset;
        for n in 0..RIPPLE_KNOTS {
            sum = sum + self.bends[n + 1] * m.max(R::splat(KNOTS[n]));
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hinges_pass_through_the_knots() {
        let curve = RippleCurve::new(&RIPPLE_DEFAULT, 0.05);
        assert!(curve.shortfall(0.0).abs() < 1e-12);
        for (n, g) in RIPPLE_DEFAULT.iter().enumerate() {
            assert!((curve.shortfall((n + 1) as f64 * RIPPLE_SPACING) - 0.05 * g).abs() < 1e-12);
        }
        assert!((curve.shortfall(5.0) - 0.05 * RIPPLE_DEFAULT[RIPPLE_KNOTS - 1]).abs() < 1e-9);
    }
}
