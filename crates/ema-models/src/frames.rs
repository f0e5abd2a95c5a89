//! Reference frames of the three-phase machine: amplitude-invariant Clarke and Park transforms and their inverses.
//!
//! The α axis is the axis of phase A; β leads it by 90° electrical. The d axis is the rotor's north pole at `theta_e`; q leads
//! it by 90°. A balanced set of amplitude I has length I in every frame. \[P\] eq. 3 prints wrong signs in the Clarke matrix
//! and exchanges the two names; this module has the standard transforms.

use crate::real::Real;

/// An array with an expression for each of the three phases, whose number is `j`.
///
/// The macro repeats the expression, because the compiler does not vectorise the closures of `core::array::from_fn`.
macro_rules! per_phase {
    (|$j:ident| $value:expr) => {
        [
            {
                let $j = 0;
                $value
            },
            {
                let $j = 1;
                $value
            },
            {
                let $j = 2;
                $value
            },
        ]
    };
}
pub(crate) use per_phase;

/// √3 / 2.
pub(crate) const SQRT3_2: f64 = 0.866_025_403_784_438_6;

/// Clarke: `[α, β]` of `[a, b, c]`, `2/3 [[1, −½, −½], [0, √3/2, −√3/2]]`.
#[inline(always)]
pub fn alpha_beta_from_abc<R: Real>([a, b, c]: [R; 3]) -> [R; 2] {
    let alpha = (a - (b + c) * R::splat(0.5)) * R::splat(2.0 / 3.0);
    let beta = (b - c) * R::splat(SQRT3_2 * 2.0 / 3.0);
    [alpha, beta]
}

/// Inverse Clarke: `[a, b, c]` with zero sum.
#[inline(always)]
pub fn abc_from_alpha_beta<R: Real>([alpha, beta]: [R; 2]) -> [R; 3] {
    let half = alpha * R::splat(-0.5);
    let side = beta * R::splat(SQRT3_2);
    [alpha, half + side, half - side]
}

/// Park: `[d, q]` of `[α, β]` at the electrical angle whose sine and cosine are given (\[P\] eq. 5).
#[inline(always)]
pub fn dq_from_alpha_beta<R: Real>([alpha, beta]: [R; 2], (sin, cos): (R, R)) -> [R; 2] {
    [cos * alpha + sin * beta, cos * beta - sin * alpha]
}

/// Inverse Park: `[α, β]` of `[d, q]`.
#[inline(always)]
pub fn alpha_beta_from_dq<R: Real>([d, q]: [R; 2], (sin, cos): (R, R)) -> [R; 2] {
    [cos * d - sin * q, sin * d + cos * q]
}

/// `[d, q]` of three phase quantities at the electrical angle whose sine and cosine are given.
///
/// ```
/// use ema_models::{dq_from_abc, phase_shapes, Real};
/// // Currents I s_j lie on the q axis with amplitude I, at any angle.
/// let sin_cos = 1.234f64.sin_cos_poly();
/// let [d, q] = dq_from_abc(phase_shapes(sin_cos).map(|s| 7.0 * s), sin_cos);
/// assert!(d.abs() < 1e-9 && (q - 7.0).abs() < 1e-9);
/// ```
#[inline(always)]
pub fn dq_from_abc<R: Real>(abc: [R; 3], sin_cos: (R, R)) -> [R; 2] {
    dq_from_alpha_beta(alpha_beta_from_abc(abc), sin_cos)
}

/// Phase shapes `s_j = −sin(theta_e − 2πj/3)`, j = A, B, C: phase components of a unit vector on the q axis.
#[inline(always)]
pub fn phase_shapes<R: Real>((sin, cos): (R, R)) -> [R; 3] {
    abc_from_alpha_beta([-sin, cos])
}

/// `cos(theta_e + 2πj/3)`, j = A, B, C: angle of the air gap's distortion relative to each phase.
#[inline(always)]
pub(crate) fn gap_cosines<R: Real>((sin, cos): (R, R)) -> [R; 3] {
    abc_from_alpha_beta([cos, -sin])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn inverse_transforms_restore_the_currents(a in -50.0..50.0f64, b in -50.0..50.0f64, theta in -100.0..100.0f64) {
            let abc = [a, b, -a - b];
            let sin_cos = theta.sin_cos_poly();
            let dq = dq_from_abc(abc, sin_cos);
            let back = abc_from_alpha_beta(alpha_beta_from_dq(dq, sin_cos));
            for j in 0..3 {
                prop_assert!((back[j] - abc[j]).abs() < 1e-9);
            }
        }

        #[test]
        fn shapes_are_three_shifted_sines(theta in -100.0..100.0f64) {
            let sin_cos = theta.sin_cos_poly();
            let (s, c) = (phase_shapes(sin_cos), gap_cosines(sin_cos));
            for j in 0..3 {
                let shift = core::f64::consts::TAU / 3.0 * j as f64;
                prop_assert!((s[j] + libm::sin(theta - shift)).abs() < 1e-10);
                prop_assert!((c[j] - libm::cos(theta + shift)).abs() < 1e-10);
            }
        }
    }

    #[test]
    fn power_is_three_halves_of_the_dq_product() {
        let (v, i, sin_cos) = ([100.0, -30.0, -70.0], [4.0, 1.0, -5.0], 0.7f64.sin_cos_poly());
        let [v_d, v_q] = dq_from_abc(v, sin_cos);
        let [i_d, i_q] = dq_from_abc(i, sin_cos);
        let abc: f64 = (0..3).map(|j| v[j] * i[j]).sum();
        assert!((abc - 1.5 * (v_d * i_d + v_q * i_q)).abs() < 1e-8);
    }
}
