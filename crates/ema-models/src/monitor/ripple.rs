//! Mean effect of the hysteresis band on the currents.
//!
//! Three comparators on one star do not hold the mean current at the reference: it falls short of it by a vector along
//! the inverter's mean voltage, `−h g(m) v/|v|`, where m is the voltage over V_dc/2. Found here by sweeping speed and
//! load of the reference on two very different actuators: the component across the voltage is an order smaller, and the
//! curve g is nearly the same on both (`hmd calibrate --type` measures it; `docs/monitor.md` shows it). A phase with fewer turns
//! than the others adds a hump at low voltage ([`unequal`]).

use crate::real::Real;

/// Number of knots of the curve.
pub const RIPPLE_KNOTS: usize = 7;

/// Relative voltages of the knots; g(0) = 0, and it is flat beyond the last one, near the voltage hexagon's corner at
/// m = 2/√3.
pub const RIPPLE_PLACES: [f64; RIPPLE_KNOTS] = [0.02, 0.1, 0.3, 0.45, 0.75, 0.9, 1.1];

/// Relative voltage at which the hump of unequal phases ends.
const HUMP_END: f64 = 0.26;

/// Mean effect of the hysteresis band, as a calibration knows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ripple {
    /// g at [`RIPPLE_PLACES`], half bands. Negative at the first place where the current stays at the band's far edge after each
    /// jump of its reference.
    pub knots: [f64; RIPPLE_KNOTS],
    /// Factor on the hump of unequal phases.
    pub apart: f64,
    /// How far the current's peaks reach beyond its mean at rest, half bands: they break the shaft away.
    pub peak: f64,
}

impl Ripple {
    /// No shortfall anywhere.
    pub const NONE: Self = Self {
        knots: [0.0; RIPPLE_KNOTS],
        apart: 0.0,
        peak: 0.0,
    };
}

impl Default for Ripple {
    /// Before a type's own calibration: mean of the two shipped actuators.
    fn default() -> Self {
        Self {
            knots: [0.015, 0.068, 0.089, 0.155, 0.072, 0.168, 0.229],
            apart: 2.2,
            peak: 1.1,
        }
    }
}

/// Height of the hump that unequal phases add to g at low voltage, from the turns that each has left:
/// `x² (1 − x) ((1 − 3.5 a²)⁺)²`, x being how far the share of the largest 1/N² in the sum of all three is from a third
/// (0) to all of it (1), a the difference of the other two over their sum. One phase that stands apart makes it; two that stand
/// apart alike do not. Smooth in the turns, which are searched.
///
/// Shape from sweeps of the reference at constant speed on both actuators; the factor on it ([`Ripple::apart`]) is calibrated in
/// actuations, where the reference of the current does not stand still (derived here, `docs/monitor.md`).
fn unequal(turns: [f64; 3]) -> f64 {
    let [a, b, c] = turns.map(|n| 1.0 / (n * n));
    let largest = a.max(b).max(c);
    let smallest = a.min(b).min(c);
    let all = a + b + c;
    let middle = all - largest - smallest;
    let lead = 1.5 * largest / all - 0.5;
    let apart = (middle - smallest) / (middle + smallest);
    let alone = (1.0 - 3.5 * apart * apart).max(0.0);
    lead * lead * (1.0 - lead) * alone * alone
}

/// The curve as a sum of hinges, `Σ bend max(m, place) − Σ bend place`, ready for any number type.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RippleCurve<R> {
    /// Slope at m = 0, A.
    slope: R,
    /// Changes of slope at [`RIPPLE_PLACES`], A.
    bends: [R; RIPPLE_KNOTS],
    /// `Σ bend place`, A.
    offset: R,
}

impl RippleCurve<f64> {
    /// From the calibrated ripple, the half band h, A, and the turns that each phase has left.
    pub(crate) fn new(ripple: &Ripple, half_band: f64, turns: [f64; 3]) -> Self {
        let height = ripple.apart * unequal(turns);
        let hump = |m: f64| height * (1.0 - m / HUMP_END).max(0.0);
        // Slopes up to each knot; behind the last one the curve is flat.
        let mut slopes = [0.0; RIPPLE_KNOTS + 1];
        let (mut place, mut last) = (0.0, 0.0);
        for n in 0..RIPPLE_KNOTS {
            let g = half_band * (ripple.knots[n] + hump(RIPPLE_PLACES[n]));
            slopes[n] = (g - last) / (RIPPLE_PLACES[n] - place);
            (place, last) = (RIPPLE_PLACES[n], g);
        }
        let bends: [f64; RIPPLE_KNOTS] = core::array::from_fn(|n| slopes[n + 1] - slopes[n]);
        Self {
            slope: slopes[0],
            bends,
            offset: bends.iter().zip(RIPPLE_PLACES).map(|(bend, place)| bend * place).sum(),
        }
    }
}

impl<R> RippleCurve<R> {
    /// The same curve in another number type.
    pub(crate) fn map<S>(self, mut f: impl FnMut(R) -> S) -> RippleCurve<S> {
        RippleCurve {
            slope: f(self.slope),
            bends: self.bends.map(&mut f),
            offset: f(self.offset),
        }
    }
}

impl<R: Real> RippleCurve<R> {
    /// Shortfall of the mean current, A, at the relative voltage m ≥ 0.
    #[inline(always)]
    pub(crate) fn shortfall(&self, m: R) -> R {
        let mut sum = self.slope * m - self.offset;
        for n in 0..RIPPLE_KNOTS {
            sum = sum + self.bends[n] * m.max(R::splat(RIPPLE_PLACES[n]));
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hinges_pass_through_the_knots() {
        let ripple = Ripple::default();
        let curve = RippleCurve::new(&ripple, 0.05, [1.0; 3]);
        assert!(curve.shortfall(0.0).abs() < 1e-12);
        for (place, g) in RIPPLE_PLACES.into_iter().zip(ripple.knots) {
            assert!((curve.shortfall(place) - 0.05 * g).abs() < 1e-12);
        }
        assert!((curve.shortfall(5.0) - 0.05 * ripple.knots[RIPPLE_KNOTS - 1]).abs() < 1e-9);
    }

    #[test]
    fn one_phase_apart_lifts_low_voltages_alone() {
        let ripple = Ripple::default();
        let equal = RippleCurve::new(&ripple, 0.05, [0.5; 3]);
        let apart = RippleCurve::new(&ripple, 0.05, [1.0, 1.0, 0.5]);
        let lift = |m| (apart.shortfall(m) - equal.shortfall(m)) / 0.05;
        // Two thirds of the sum of 1/N² is halfway: 1 / 8.
        let height = 0.125 * ripple.apart;
        assert!(lift(0.0).abs() < 1e-12 && lift(0.3).abs() < 1e-9 && lift(2.0).abs() < 1e-9);
        for m in [0.02, 0.1] {
            assert!((lift(m) - height * (1.0 - m / HUMP_END)).abs() < 1e-9, "{}", lift(m));
        }
        for turns in [[1.0, 0.5, 0.5], [0.9, 1.0, 0.9], [0.01, 0.01, 1.0]] {
            assert!(unequal(turns) < 0.015, "{turns:?}: {}", unequal(turns));
        }
    }
}
