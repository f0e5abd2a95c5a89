//! Mean effect of the hysteresis band on the currents.
//!
//! Three comparators on one star do not hold the mean current at the reference: it falls short of it by a vector along
//! the inverter's mean voltage, `−h g(m) v/|v|`, where m is the voltage over V_dc/2. Found here by sweeping speed and
//! load of the reference on two very different actuators: the component across the voltage is an order smaller, and the
//! curve g is nearly the same on both (`hmd calibrate --type` measures it; `docs/monitor.md` shows it). A phase with fewer turns
//! than the others adds a hump at low voltage ([`unequal`]).

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

/// Relative voltages at which the hump is highest and at which it ends.
const HUMP_TOP: f64 = 0.02;
const HUMP_END: f64 = 0.26;

/// The curve before a type's own calibration: mean of the two shipped actuators.
pub const RIPPLE_DEFAULT: [f64; RIPPLE_KNOTS] = [
    0.062, 0.080, 0.100, 0.140, 0.146, 0.120, 0.074, 0.070, 0.150, 0.186, 0.220,
];

/// Height of the hump that unequal phases add to g at low voltage, from the turns that each has left:
/// `1.4 x² (1 − x) ((1 − 3.5 a²)⁺)²`, x being how far the share of the largest 1/N² in the sum of all three is from a third
/// (0) to all of it (1), a the difference of the other two over their sum. One phase that stands apart makes it; two that stand
/// apart alike do not. Smooth in the turns, which are searched.
///
/// Shape from sweeps of the reference at constant speed on both actuators; there it is two and a half times as high as in actuations, where
/// the reference of the current does not stand still (derived here, `docs/monitor.md`).
fn unequal(turns: [f64; 3]) -> f64 {
    let [a, b, c] = turns.map(|n| 1.0 / (n * n));
    let largest = a.max(b).max(c);
    let smallest = a.min(b).min(c);
    let all = a + b + c;
    let middle = all - largest - smallest;
    let lead = 1.5 * largest / all - 0.5;
    let apart = (middle - smallest) / (middle + smallest);
    let alone = (1.0 - 3.5 * apart * apart).max(0.0);
    1.4 * lead * lead * (1.0 - lead) * alone * alone
}

/// The curve as a sum of hinges, `Σ bend max(m, place) − Σ bend place`, ready for any number type.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RippleCurve<R> {
    /// Slope at m = 0, A.
    slope: R,
    /// Change of slope at [`HUMP_TOP`], A.
    top: R,
    /// Changes of slope at [`KNOTS`], A.
    bends: [R; RIPPLE_KNOTS],
    /// `Σ bend place`, A.
    offset: R,
}

impl RippleCurve<f64> {
    /// From the knots of g, the half band h, A, and the turns that each phase has left.
    pub(crate) fn new(knots: &[f64; RIPPLE_KNOTS], half_band: f64, turns: [f64; 3]) -> Self {
        let height = unequal(turns);
        let hump = |m: f64| height * (1.0 - m / HUMP_END).max(0.0);
        let at_top = half_band * (knots[0] * HUMP_TOP / RIPPLE_SPACING + hump(HUMP_TOP));
        let rise = at_top / HUMP_TOP;
        let (mut place, mut last, mut slope) = (HUMP_TOP, at_top, rise);
        let mut changes = [0.0; RIPPLE_KNOTS];
        for n in 0..RIPPLE_KNOTS {
            let g = half_band * (knots[n] + hump(KNOTS[n]));
            changes[n] = (g - last) / (KNOTS[n] - place) - slope;
            slope += changes[n];
            (place, last) = (KNOTS[n], g);
        }
        // Each slope begins where the one before it ends, and the last one ends the curve.
        let top = changes[0];
        let bends: [f64; RIPPLE_KNOTS] = core::array::from_fn(|n| changes.get(n + 1).map_or(-slope, |change| *change));
        let offset = top * HUMP_TOP + bends.iter().zip(KNOTS).map(|(bend, knot)| bend * knot).sum::<f64>();
        Self {
            slope: rise,
            top,
            bends,
            offset,
        }
    }
}

impl<R> RippleCurve<R> {
    /// The same curve in another number type.
    pub(crate) fn map<S>(self, mut f: impl FnMut(R) -> S) -> RippleCurve<S> {
        RippleCurve {
            slope: f(self.slope),
            top: f(self.top),
            bends: self.bends.map(&mut f),
            offset: f(self.offset),
        }
    }
}

impl<R: Real> RippleCurve<R> {
    /// Shortfall of the mean current, A, at the relative voltage m ≥ 0.
    #[inline(always)]
    pub(crate) fn shortfall(&self, m: R) -> R {
        let mut sum = self.slope * m - self.offset + self.top * m.max(R::splat(HUMP_TOP));
        for n in 0..RIPPLE_KNOTS {
            sum = sum + self.bends[n] * m.max(R::splat(KNOTS[n]));
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hinges_pass_through_the_knots() {
        let curve = RippleCurve::new(&RIPPLE_DEFAULT, 0.05, [1.0; 3]);
        assert!(curve.shortfall(0.0).abs() < 1e-12);
        for (n, g) in RIPPLE_DEFAULT.iter().enumerate() {
            assert!((curve.shortfall((n + 1) as f64 * RIPPLE_SPACING) - 0.05 * g).abs() < 1e-12);
        }
        assert!((curve.shortfall(5.0) - 0.05 * RIPPLE_DEFAULT[RIPPLE_KNOTS - 1]).abs() < 1e-9);
    }

    #[test]
    fn one_phase_apart_lifts_low_voltages_alone() {
        let equal = RippleCurve::new(&RIPPLE_DEFAULT, 0.05, [0.5; 3]);
        let apart = RippleCurve::new(&RIPPLE_DEFAULT, 0.05, [1.0, 1.0, 0.5]);
        let lift = |m| (apart.shortfall(m) - equal.shortfall(m)) / 0.05;
        // Two thirds of the sum of 1/N² is halfway: 1.4 / 8.
        let height = 0.175;
        assert!(lift(0.0).abs() < 1e-12 && lift(0.3).abs() < 1e-9 && lift(2.0).abs() < 1e-9);
        assert!(
            (lift(0.1) - height * (1.0 - 0.1 / HUMP_END)).abs() < 1e-5,
            "{}",
            lift(0.1)
        );
        assert!(
            (lift(HUMP_TOP) - height * (1.0 - HUMP_TOP / HUMP_END)).abs() < 1e-5,
            "{}",
            lift(HUMP_TOP)
        );
        for turns in [[1.0, 0.5, 0.5], [0.9, 1.0, 0.9], [0.01, 0.01, 1.0]] {
            assert!(unequal(turns) < 0.02, "{turns:?}: {}", unequal(turns));
        }
    }
}
