//! Back-EMF and phase parameters under inter-turn shorts and static eccentricity, as functions of the electrical angle.
//!
//! Reference and monitor share the three-phase law ([`Winding`]). The one-axis monitor of \[P\] replaces it by two shape
//! functions ([`PaperShape`]); [`derived_shape`] has the exact shapes for perfect current tracking.

use crate::fault::FaultVector;
use crate::frames::{SQRT3_2, gap_cosines, per_phase, phase_shapes};
use crate::real::Real;

/// Fault state of the three phase windings and of the air gap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Winding<R> {
    /// Winding turns ratio: fraction N_j of intact turns of phases A, B, C.
    pub turns_ratio: [R; 3],
    /// ζ cos φ_e of the static eccentricity.
    pub zeta_cos: R,
    /// ζ sin φ_e.
    pub zeta_sin: R,
    /// `½ ζ (sin φ_e − sin(φ_e − 4πj/3))`: constant part of the back-EMF shape of phase j, divided by N_j.
    offsets: [R; 3],
}

impl Winding<f64> {
    /// The windings under a fault vector.
    #[must_use]
    pub fn new(fault: &FaultVector) -> Self {
        let phi = fault.eccentricity_angle();
        let (zeta_cos, zeta_sin) = (fault.eccentricity * libm::cos(phi), fault.eccentricity * libm::sin(phi));
        let (along, across) = (0.5 * SQRT3_2 * zeta_cos, 0.75 * zeta_sin);
        Self {
            turns_ratio: fault.winding_turns_ratio(),
            zeta_cos,
            zeta_sin,
            offsets: [0.0, across - along, across + along],
        }
    }
}

impl<R: Real> Winding<R> {
    /// The same windings in another number type, one field at a time.
    #[must_use]
    pub fn map<S>(self, mut f: impl FnMut(R) -> S) -> Winding<S> {
        Winding {
            turns_ratio: self.turns_ratio.map(&mut f),
            zeta_cos: f(self.zeta_cos),
            zeta_sin: f(self.zeta_sin),
            offsets: self.offsets.map(&mut f),
        }
    }

    /// Back-EMF shapes `k_j / k = N_j s_j (1 + ζ cos(theta_e − φ_e + 2πj/3))` of the three phases.
    ///
    /// Phase resistance and inductance follow from the turns ratio: `R_j = N_j R`, `L_j = N_j² L`.
    ///
    /// The product of the two sines is computed as a sum: its part at twice the electrical angle is the same in all phases, and
    /// the other part is constant.
    #[inline(always)]
    pub fn emf_shapes(&self, (sin, cos): (R, R)) -> [R; 3] {
        let s = phase_shapes((sin, cos));
        let common = sin * (self.zeta_cos * cos + self.zeta_sin * sin);
        per_phase!(|j| self.turns_ratio[j] * ((s[j] - common) + self.offsets[j]))
    }
}

/// Calibration coefficients of the paper's shape functions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperShape {
    /// Single contribution coefficient k_FS of \[P\] eq. 10.
    pub k_fs: f64,
    /// Eccentricity coefficient k_E of \[P\] eq. 11.
    pub k_e: f64,
}

impl Default for PaperShape {
    /// Values before calibration. k_E = ½ is exact for intact turns. Eq. 10 becomes exact in torque for k_FS → ∞ (derived
    /// here: compare [`DerivedShape::emf`]), so k_FS is large.
    fn default() -> Self {
        Self { k_fs: 100.0, k_e: 0.5 }
    }
}

impl PaperShape {
    /// Shape function φ = φ_SC · φ_ECC; 1 for a healthy motor.
    ///
    /// `φ_SC = k_FT Σ N_j (1 + k_FS sin²(theta_e + shift_j))` with shifts π, π/3, −π/3 (\[P\] eq. 10), where
    /// `k_FT = 1 / (3 + 1.5 k_FS)` follows from φ_SC = 1 for a healthy motor; `φ_ECC = 1 − k_E ζ cos(theta_e + φ_e)`
    /// (\[P\] eq. 11).
    #[inline(always)]
    pub fn shape<R: Real>(&self, winding: &Winding<R>, (sin, cos): (R, R)) -> R {
        let k_ft = 1.0 / (3.0 + 1.5 * self.k_fs);
        // sin²(theta_e + π), sin²(theta_e + π/3), sin²(theta_e − π/3) are the squares of s_A, s_B, s_C.
        let squares = phase_shapes((sin, cos)).map(|s| s * s);
        let mut sum = R::zero();
        for j in 0..3 {
            sum = sum + winding.turns_ratio[j] * (R::splat(1.0) + R::splat(self.k_fs) * squares[j]);
        }
        sum * R::splat(k_ft) * self.eccentricity(winding, (sin, cos))
    }

    #[inline(always)]
    fn eccentricity<R: Real>(&self, winding: &Winding<R>, (sin, cos): (R, R)) -> R {
        // cos(theta_e + φ_e) = cos theta_e cos φ_e − sin theta_e sin φ_e.
        R::splat(1.0) - R::splat(self.k_e) * (cos * winding.zeta_cos - sin * winding.zeta_sin)
    }
}

/// Parameters of one equivalent phase in the q axis at one angle, for exact current tracking, relative to a healthy phase
/// (derived here).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DerivedShape<R> {
    /// Torque and back-EMF: `2/3 Σ N_j s_j² (1 + ζ cos(theta_e − φ_e + 2πj/3))`.
    pub emf: R,
    /// Resistance relative to R: `2/3 Σ N_j s_j²`.
    pub resistance: R,
    /// Inductance relative to L: `2/3 Σ N_j² s_j²`.
    pub inductance: R,
    /// Derivative of `inductance` with respect to theta_e, 1/rad.
    pub inductance_slope: R,
}

/// The derived shapes. They give the q voltage `v_q = R(θ_e) i + L(θ_e) di/dt + ½ ω_e (dL/dθ_e) i + k φ ω_m`.
///
/// ```
/// use ema_models::{derived_shape, FaultVector, Real, Winding};
/// let mut fault = FaultVector::NOMINAL;
/// fault.eccentricity = 0.4;
/// fault.eccentricity_phase = 0.6;
/// let theta_e = 1.1f64;
/// let emf = derived_shape(&Winding::new(&fault), theta_e.sin_cos_poly()).emf;
/// // Intact turns give exactly 1 − ½ ζ cos(theta_e + φ_e), so \[P\] eq. 11 holds with k_E = ½.
/// assert!((emf - (1.0 - 0.2 * (theta_e + fault.eccentricity_angle()).cos())).abs() < 1e-10);
/// ```
#[inline(always)]
pub fn derived_shape<R: Real>(winding: &Winding<R>, sin_cos: (R, R)) -> DerivedShape<R> {
    let s = phase_shapes(sin_cos);
    // ds_j/dtheta_e = −cos(theta_e − 2πj/3), and gap_cosines returns cos(theta_e + 2πj/3): B and C are exchanged.
    let along = gap_cosines(sin_cos);
    let slope = [-along[0], -along[2], -along[1]];
    let emf_shapes = winding.emf_shapes(sin_cos);
    let two_thirds = R::splat(2.0 / 3.0);
    let mut sums = [R::zero(); 4];
    for j in 0..3 {
        let n = winding.turns_ratio[j];
        sums[0] = sums[0] + emf_shapes[j] * s[j];
        sums[1] = sums[1] + n * s[j] * s[j];
        sums[2] = sums[2] + n * n * s[j] * s[j];
        sums[3] = sums[3] + n * n * s[j] * slope[j];
    }
    DerivedShape {
        emf: sums[0] * two_thirds,
        resistance: sums[1] * two_thirds,
        inductance: sums[2] * two_thirds,
        inductance_slope: sums[3] * R::splat(4.0 / 3.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn emf_shapes_match_their_definition(
            theta in -20.0..20.0f64, a in 0.0..0.9f64, b in 0.0..0.9f64, zeta in 0.0..1.0f64, phase in 0.0..1.0f64,
        ) {
            let fault = FaultVector::from_array([0.0, 0.0, a, b, 0.0, zeta, phase, 0.5]);
            let shapes = Winding::new(&fault).emf_shapes(theta.sin_cos_poly());
            for j in 0..3 {
                let shift = core::f64::consts::TAU / 3.0 * j as f64;
                let expected = fault.winding_turns_ratio()[j] * -libm::sin(theta - shift)
                    * (1.0 + zeta * libm::cos(theta - fault.eccentricity_angle() + shift));
                prop_assert!((shapes[j] - expected).abs() < 1e-10);
            }
        }

        #[test]
        fn the_inductance_slope_is_the_derivative_of_the_inductance(theta in -20.0..20.0f64, a in 0.0..0.9f64, c in 0.0..0.9f64) {
            let winding = Winding::new(&FaultVector::from_array([0.0, 0.0, a, 0.0, c, 0.0, 0.5, 0.5]));
            let at = |x: f64| derived_shape(&winding, x.sin_cos_poly());
            let difference = (at(theta + 1e-4).inductance - at(theta - 1e-4).inductance) / 2e-4;
            prop_assert!((difference - at(theta).inductance_slope).abs() < 1e-6);
        }
    }

    #[test]
    fn shapes_of_a_healthy_motor_are_one() {
        let healthy = Winding::new(&FaultVector::NOMINAL);
        for n in 0..100 {
            let sin_cos = (f64::from(n) * 0.0628).sin_cos_poly();
            let derived = derived_shape(&healthy, sin_cos);
            assert!((derived.emf - 1.0).abs() < 1e-10 && (derived.inductance - 1.0).abs() < 1e-10);
            for k_fs in [-0.9, 0.0, 3.0] {
                let paper = PaperShape { k_fs, k_e: 0.5 }.shape(&healthy, sin_cos);
                assert!((paper - 1.0).abs() < 1e-10, "{k_fs}: {paper}");
            }
        }
    }
}
