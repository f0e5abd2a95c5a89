//! Mean effect of the hysteresis band on the currents: from the relative voltage to the shortfall of the mean current.
//!
//! Three comparators on one star do not hold the mean current at the reference. It falls short of the reference by a vector
//! along the inverter's mean voltage, `−h g(m) v/|v|`, where m is the voltage divided by V_dc/2. Sweeps of speed and load of
//! the reference model on two different actuators show that the component across the voltage is smaller by a factor of ten,
//! and that the curve g is nearly the same on both (`hmd calibrate --type` measures it; `docs/monitor.md` has the figures). A
//! phase with fewer turns than the others adds a hump at low voltage ([`unequal_hump`]).

use crate::real::Real;

/// Number of knots of the curve g.
pub const RIPPLE_KNOTS: usize = 7;

/// Relative voltages of the knots. g(0) = 0; g is constant beyond the last knot, which is near the corner of the voltage
/// hexagon at m = 2/√3.
pub const RIPPLE_VOLTAGES: [f64; RIPPLE_KNOTS] = [0.02, 0.1, 0.3, 0.45, 0.75, 0.9, 1.1];

/// Relative voltage at which the hump of unequal phases ends.
const HUMP_END: f64 = 0.26;

/// Coefficients of the mean effect of the hysteresis band, from calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ripple {
    /// g at [`RIPPLE_VOLTAGES`], half bands. The first value is negative where the current stays at the far edge of the band
    /// after each step of its reference.
    pub knots: [f64; RIPPLE_KNOTS],
    /// Factor on the hump of unequal phases.
    pub unequal_phases: f64,
    /// Peak of the current beyond its mean at rest, half bands; the peaks break the shaft away.
    pub peak: f64,
}

impl Ripple {
    /// No shortfall at any voltage.
    pub const NONE: Self = Self {
        knots: [0.0; RIPPLE_KNOTS],
        unequal_phases: 0.0,
        peak: 0.0,
    };
}

impl Default for Ripple {
    /// Values for a type without calibration: the mean of the two built-in types.
    fn default() -> Self {
        Self {
            knots: [0.015, 0.068, 0.089, 0.155, 0.072, 0.168, 0.229],
            unequal_phases: 2.2,
            peak: 1.1,
        }
    }
}

/// Height of the hump that unequal phases add to g at low voltage, from the turns ratios of the phases.
///
/// `x² (1 − x) ((1 − 3.5 a²)⁺)²`: x is the share of the largest 1/N² in the sum of all three, scaled from 0 (a third) to 1
/// (all); a is the difference of the two others divided by their sum. One phase that differs from two equal ones adds a hump;
/// two phases that differ equally do not. The law is smooth in the turns ratios, which the search varies.
///
/// The shape follows from sweeps of the reference model at constant speed on both built-in types. Its factor
/// ([`Ripple::unequal_phases`]) is calibrated on actuations, in which the current reference varies (derived here,
/// `docs/monitor.md`).
fn unequal_hump(turns_ratio: [f64; 3]) -> f64 {
    let [a, b, c] = turns_ratio.map(|n| 1.0 / (n * n));
    let largest = a.max(b).max(c);
    let smallest = a.min(b).min(c);
    let all = a + b + c;
    let middle = all - largest - smallest;
    let x = 1.5 * largest / all - 0.5;
    let a = (middle - smallest) / (middle + smallest);
    let alone = (1.0 - 3.5 * a * a).max(0.0);
    x * x * (1.0 - x) * alone * alone
}

/// The curve h g(m) as a sum of hinge functions, `slope m + Σ bend max(m, m_n) − Σ bend m_n`, for any number type.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RippleCurve<R> {
    /// Slope at m = 0, A.
    slope: R,
    /// Changes of slope at [`RIPPLE_VOLTAGES`], A.
    bends: [R; RIPPLE_KNOTS],
    /// `Σ bend m_n`, A.
    offset: R,
}

impl RippleCurve<f64> {
    /// The curve of these coefficients for a half band h, A, and the turns ratios of the phases.
    pub(crate) fn new(ripple: &Ripple, half_band: f64, turns_ratio: [f64; 3]) -> Self {
        let height = ripple.unequal_phases * unequal_hump(turns_ratio);
        let hump = |m: f64| height * (1.0 - m / HUMP_END).max(0.0);
        // Slopes up to each knot; beyond the last one the curve is constant.
        let mut slopes = [0.0; RIPPLE_KNOTS + 1];
        let (mut voltage, mut last) = (0.0, 0.0);
        for n in 0..RIPPLE_KNOTS {
            let g = half_band * (ripple.knots[n] + hump(RIPPLE_VOLTAGES[n]));
            slopes[n] = (g - last) / (RIPPLE_VOLTAGES[n] - voltage);
            (voltage, last) = (RIPPLE_VOLTAGES[n], g);
        }
        let bends: [f64; RIPPLE_KNOTS] = core::array::from_fn(|n| slopes[n + 1] - slopes[n]);
        Self {
            slope: slopes[0],
            bends,
            offset: bends
                .iter()
                .zip(RIPPLE_VOLTAGES)
                .map(|(bend, place)| bend * place)
                .sum(),
        }
    }
}

impl<R> RippleCurve<R> {
    /// The curve in another number type.
    pub(crate) fn map<S>(self, mut f: impl FnMut(R) -> S) -> RippleCurve<S> {
        RippleCurve {
            slope: f(self.slope),
            bends: self.bends.map(&mut f),
            offset: f(self.offset),
        }
    }
}

impl<R: Real> RippleCurve<R> {
    /// Shortfall of the mean current at the relative voltage m ≥ 0, A.
    #[inline(always)]
    pub(crate) fn shortfall(&self, m: R) -> R {
        let mut sum = self.slope * m - self.offset;
        for n in 0..RIPPLE_KNOTS {
            sum = sum + self.bends[n] * m.max(R::splat(RIPPLE_VOLTAGES[n]));
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_passes_through_the_knots() {
        let ripple = Ripple::default();
        let curve = RippleCurve::new(&ripple, 0.05, [1.0; 3]);
        assert!(curve.shortfall(0.0).abs() < 1e-12);
        for (place, g) in RIPPLE_VOLTAGES.into_iter().zip(ripple.knots) {
            assert!((curve.shortfall(place) - 0.05 * g).abs() < 1e-12);
        }
        assert!((curve.shortfall(5.0) - 0.05 * ripple.knots[RIPPLE_KNOTS - 1]).abs() < 1e-9);
    }

    #[test]
    fn one_unequal_phase_adds_a_hump_at_low_voltage_only() {
        let ripple = Ripple::default();
        let equal = RippleCurve::new(&ripple, 0.05, [0.5; 3]);
        let unequal = RippleCurve::new(&ripple, 0.05, [1.0, 1.0, 0.5]);
        let lift = |m| (unequal.shortfall(m) - equal.shortfall(m)) / 0.05;
        // The largest 1/N² is two thirds of the sum: x = 1/2, height 1/8.
        let height = 0.125 * ripple.unequal_phases;
        assert!(lift(0.0).abs() < 1e-12 && lift(0.3).abs() < 1e-9 && lift(2.0).abs() < 1e-9);
        for m in [0.02, 0.1] {
            assert!((lift(m) - height * (1.0 - m / HUMP_END)).abs() < 1e-9, "{}", lift(m));
        }
        for ratio in [[1.0, 0.5, 0.5], [0.9, 1.0, 0.9], [0.01, 0.01, 1.0]] {
            assert!(unequal_hump(ratio) < 0.015, "{ratio:?}: {}", unequal_hump(ratio));
        }
    }
}
