//! The fault vector by elements, and its change since commissioning.

use core::f64::consts::PI;
use std::vec::Vec;

use ema_models::FaultVector;
use serde::{Deserialize, Serialize};

use crate::relations::{ELEMENT_COUNT, Element};

/// What the healthy windows of a unit show of one element.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ElementStatistics {
    /// Mean over the windows.
    pub mean: f64,
    /// Standard deviation from window to window.
    pub scatter: f64,
    /// Windows that show the element.
    pub windows: u32,
}

impl ElementStatistics {
    /// Mean and scatter of the numbers that windows show.
    #[must_use]
    pub fn of(shown: &[f64]) -> Self {
        let n = shown.len() as f64;
        let mean = shown.iter().sum::<f64>() / n.max(1.0);
        let squares: f64 = shown.iter().map(|value| (value - mean) * (value - mean)).sum();
        Self {
            mean,
            scatter: (squares / (n - 1.0).max(1.0)).sqrt(),
            windows: shown.len() as u32,
        }
    }

    /// Statistics of each element of several windows; `None` where a window does not show it.
    #[must_use]
    pub fn of_windows(windows: &[[Option<f64>; ELEMENT_COUNT]]) -> [Self; ELEMENT_COUNT] {
        core::array::from_fn(|element| {
            let shown: Vec<f64> = windows.iter().filter_map(|window| window[element]).collect();
            Self::of(&shown)
        })
    }

    /// Sigma of the distance of a later window from the mean; `None` with fewer than two windows.
    ///
    /// `√(max(σ, q s)² + s²/n)`: σ is the window's own, s the scatter, and q widens a normal distribution to Student's t with n − 1
    /// degrees of freedom at the quantile of 99.9 %. Derived here.
    #[must_use]
    pub fn sigma_of_change(&self, sigma: f64) -> Option<f64> {
        (self.windows >= 2).then(|| {
            let n = f64::from(self.windows);
            let scatter = widening(n - 1.0) * self.scatter;
            (sigma.max(scatter).powi(2) + self.scatter * self.scatter / n).sqrt()
        })
    }
}

/// Quantile of Student's t over that of the normal distribution, 99.9 %: Cornish–Fisher expansion, first three terms.
fn widening(freedom: f64) -> f64 {
    let squared = NORMAL_999 * NORMAL_999;
    1.0 + (squared + 1.0) / (4.0 * freedom)
        + (5.0 * squared * squared + 16.0 * squared + 3.0) / (96.0 * freedom * freedom)
        + (3.0 * squared.powi(3) + 19.0 * squared * squared + 17.0 * squared - 15.0) / (384.0 * freedom.powi(3))
}

/// Quantile of the normal distribution, 99.9 %.
pub const NORMAL_999: f64 = 3.090_232;

/// A fault vector by elements: `[k1…k5, ζ cos φ_e, ζ sin φ_e, k8]`.
#[must_use]
pub fn elements_of(fault: &FaultVector) -> [f64; ELEMENT_COUNT] {
    let (sin, cos) = fault.eccentricity_angle().sin_cos();
    [
        fault.friction,
        fault.backlash,
        fault.short_a,
        fault.short_b,
        fault.short_c,
        fault.eccentricity * cos,
        fault.eccentricity * sin,
        fault.gain,
    ]
}

/// The fault vector of elements, each parameter limited to [0, 1].
#[must_use]
pub fn fault_of(elements: &[f64; ELEMENT_COUNT]) -> FaultVector {
    let [friction, backlash, a, b, c, cos, sin, gain] = *elements;
    let amplitude = cos.hypot(sin);
    let phase = if amplitude > 0.0 {
        0.5 * (sin.atan2(cos) / PI + 1.0)
    } else {
        FaultVector::NOMINAL.eccentricity_phase
    };
    let k = [friction, backlash, a, b, c, amplitude, phase, gain];
    FaultVector::from_array(k.map(|k| k.clamp(0.0, 1.0)))
}

/// Elements of a unit that has not changed.
#[must_use]
pub fn nominal_elements() -> [f64; ELEMENT_COUNT] {
    elements_of(&FaultVector::NOMINAL)
}

/// An apparent element as change since commissioning, where it appeared as `unit`, and the factor of its sigma.
///
/// Friction is `T_d (1 + 2 k1)`, turns are `1 − k`, the gain is `G_p (0.5 + k8)`: each relative to that of the commissioned unit.
/// Play and eccentricity change by difference.
#[must_use]
pub fn change_since(element: Element, apparent: f64, unit: f64) -> (f64, f64) {
    let scale = match element {
        Element::Friction => 1.0 + 2.0 * unit,
        Element::TurnsA | Element::TurnsB | Element::TurnsC => 1.0 - unit,
        Element::Gain => 0.5 + unit,
        Element::Backlash | Element::EccentricityCos | Element::EccentricitySin => 1.0,
    };
    let nominal = nominal_elements()[element as usize];
    let scale = scale.max(LEAST_SCALE);
    (nominal + (apparent - unit) / scale, 1.0 / scale)
}

/// Least remainder of what a commissioned unit has of a part, as a share of the type's.
const LEAST_SCALE: f64 = 0.1;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_windows_widen_as_student_says() {
        // t(0.999) = 7.17, 4.02 and 3.17 with 4, 11 and 100 degrees of freedom.
        for (freedom, t) in [(4.0, 7.17), (11.0, 4.02), (100.0, 3.17)] {
            assert!((NORMAL_999 * widening(freedom) / t - 1.0).abs() < 0.05, "{freedom}");
        }
    }

    #[test]
    fn a_vector_has_its_elements_and_back() {
        let fault = FaultVector::from_array([0.1, 0.2, 0.3, 0.0, 0.1, 0.4, 0.9, 0.7]);
        let back = fault_of(&elements_of(&fault)).to_array();
        for (k, back) in fault.to_array().into_iter().zip(back) {
            assert!((k - back).abs() < 1e-12);
        }
    }

    #[test]
    fn wear_counts_in_what_the_commissioned_unit_has() {
        // Friction 1.2 times the type's, then 1.3 times that.
        let apparent = 0.5 * (1.2 * 1.3 - 1.0);
        let (worn, _) = change_since(Element::Friction, apparent, 0.1);
        assert!((worn - 0.15).abs() < 1e-12);
        let (gain, _) = change_since(Element::Gain, 0.45, 0.45);
        assert!((gain - 0.5).abs() < 1e-12);
    }
}
