//! [`Real`], the number type of the models: one source of each law for `f64`, `f32` and SIMD lanes.
//!
//! A branch on a number is a `select`, so that each lane can take its own branch. The operations use neither a fused
//! multiply-add nor a library call, so every target gives the same bits.

use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

/// A real number, or several that are computed element by element (lanes).
pub trait Real:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Send
    + Sync
    + 'static
{
    /// Truth value of a comparison, one per lane.
    type Mask: Copy + BitAnd<Output = Self::Mask> + BitOr<Output = Self::Mask> + Not<Output = Self::Mask>;

    /// The same number in every lane.
    fn splat(x: f64) -> Self;
    /// `self < other`, false where either is NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// `self <= other`, false where either is NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// `if_true` where the mask is true, else `if_false`.
    fn select(mask: Self::Mask, if_true: Self, if_false: Self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// Nearest integer, ties to even; exact for magnitudes below 2²² (`f32`) or 2⁵¹ (`f64`).
    fn round(self) -> Self;

    /// Square root, correctly rounded; NaN below zero.
    fn sqrt(self) -> Self;

    /// Whether a comparison is true in every lane, for shortcuts that give the same bits; false where the type cannot tell.
    #[inline(always)]
    fn known_true(_mask: Self::Mask) -> bool {
        false
    }

    /// Zero.
    #[inline(always)]
    fn zero() -> Self {
        Self::splat(0.0)
    }

    /// The smaller of two numbers; `other` where either is NaN.
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self::select(self.lt(other), self, other)
    }

    /// The larger of two numbers; `other` where either is NaN.
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self::select(other.lt(self), self, other)
    }

    /// Limits to `[-bound, bound]`.
    #[inline(always)]
    fn clamp_abs(self, bound: Self) -> Self {
        self.min(bound).max(-bound)
    }

    /// Largest integer not above the number; the range is that of [`Real::round`].
    #[inline(always)]
    fn floor(self) -> Self {
        let rounded = self.round();
        Self::select(self.lt(rounded), rounded - Self::splat(1.0), rounded)
    }

    /// `magnitude` with the sign of `self`; zero counts as positive.
    #[inline(always)]
    fn with_sign_of_self(self, magnitude: Self) -> Self {
        Self::select(self.lt(Self::zero()), -magnitude, magnitude)
    }

    /// Sine and cosine of an angle plus `turn`, rad, from the sine and cosine of the angle.
    ///
    /// Series for small turns: the error is below `turn⁶/720`, 6e-12 at 0.04 rad, and accumulates over repeated turns.
    #[inline(always)]
    fn rotate((sin, cos): (Self, Self), turn: Self) -> (Self, Self) {
        let square = turn * turn;
        let across = turn * (Self::splat(1.0) - square * (Self::splat(1.0 / 6.0) - square * Self::splat(1.0 / 120.0)));
        let along = Self::splat(1.0) - square * (Self::splat(0.5) - square * Self::splat(1.0 / 24.0));
        (sin * along + cos * across, cos * along - sin * across)
    }

    /// Sine and cosine of an angle in radians.
    ///
    /// One polynomial for every number type: reduction by the nearest multiple of π/2 in two parts, then Taylor terms
    /// to degree 11 (sine) and 12 (cosine) on [-π/4, π/4]. The absolute error is below 7e-12 in `f64` and 2e-7 in `f32` for
    /// magnitudes up to 1000 rad (tested against `libm`).
    ///
    /// ```
    /// use ema_models::Real;
    /// let (s, c) = (core::f64::consts::FRAC_PI_6).sin_cos_poly();
    /// assert!((s - 0.5).abs() < 1e-11 && (s * s + c * c - 1.0).abs() < 1e-11);
    /// ```
    #[inline(always)]
    fn sin_cos_poly(self) -> (Self, Self) {
        // π/2 = HIGH + LOW, HIGH with few enough bits that quarter * HIGH is exact in f32 up to 2¹¹ quarters.
        const HIGH: f64 = 1.570_312_5;
        const LOW: f64 = core::f64::consts::FRAC_PI_2 - HIGH;
        let quarter = (self * Self::splat(core::f64::consts::FRAC_2_PI)).round();
        let r = (self - quarter * Self::splat(HIGH)) - quarter * Self::splat(LOW);
        let r2 = r * r;
        let sin = r * polynomial(
            r2,
            &[
                1.0,
                -1.0 / 6.0,
                1.0 / 120.0,
                -1.0 / 5040.0,
                1.0 / 362_880.0,
                -1.0 / 39_916_800.0,
            ],
        );
        let cos = polynomial(
            r2,
            &[
                1.0,
                -0.5,
                1.0 / 24.0,
                -1.0 / 720.0,
                1.0 / 40_320.0,
                -1.0 / 3_628_800.0,
                1.0 / 479_001_600.0,
            ],
        );
        // quarter modulo 4, as a number in {0, 1, 2, 3}.
        let turn = quarter - Self::splat(4.0) * (quarter * Self::splat(0.25)).floor();
        let odd = (turn.lt(Self::splat(1.5)) & Self::splat(0.5).lt(turn)) | Self::splat(2.5).lt(turn);
        let sin_negative = Self::splat(1.5).lt(turn);
        let cos_negative = Self::splat(0.5).lt(turn) & turn.lt(Self::splat(2.5));
        let s = Self::select(odd, cos, sin);
        let c = Self::select(odd, sin, cos);
        (Self::select(sin_negative, -s, s), Self::select(cos_negative, -c, c))
    }
}

/// `c[0] + c[1] x + c[2] x² + …` by Horner's rule.
#[inline(always)]
fn polynomial<R: Real>(x: R, coefficients: &[f64]) -> R {
    let mut sum = R::zero();
    for &c in coefficients.iter().rev() {
        sum = sum * x + R::splat(c);
    }
    sum
}

macro_rules! scalar {
    ($t:ty, $magic:expr, $sqrt:path) => {
        impl Real for $t {
            type Mask = bool;

            #[inline(always)]
            fn splat(x: f64) -> Self {
                x as $t
            }
            #[inline(always)]
            fn lt(self, other: Self) -> bool {
                self < other
            }
            #[inline(always)]
            fn le(self, other: Self) -> bool {
                self <= other
            }
            #[inline(always)]
            fn select(mask: bool, if_true: Self, if_false: Self) -> Self {
                if mask { if_true } else { if_false }
            }
            #[inline(always)]
            fn abs(self) -> Self {
                <$t>::abs(self)
            }
            #[inline(always)]
            fn round(self) -> Self {
                // Adding 1.5 * 2^(mantissa bits) pushes the fraction out of the mantissa, with ties to even.
                (self + $magic) - $magic
            }
            #[inline(always)]
            fn known_true(mask: bool) -> bool {
                mask
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                // Both are correctly rounded and give the same bits; the first is one instruction.
                #[cfg(feature = "std")]
                return <$t>::sqrt(self);
                #[cfg(not(feature = "std"))]
                $sqrt(self)
            }
        }
    };
}

scalar!(f64, 6_755_399_441_055_744.0, libm::sqrt);
scalar!(f32, 12_582_912.0, square_root);

/// Square root by the processor's instruction, which is correctly rounded; `core` has no function for it.
#[cfg(all(not(feature = "std"), target_arch = "arm", target_abi = "eabihf"))]
#[inline(always)]
fn square_root(x: f32) -> f32 {
    let mut bits = x.to_bits();
    // SAFETY: every processor of this ABI has the instruction. The code changes `bits` and the declared register s0, and
    // neither memory nor flags. `asm!` accepts no floating-point operand here, so an integer register passes the number.
    #[expect(unsafe_code, reason = "see above")]
    unsafe {
        core::arch::asm!(
            "vmov s0, {bits}",
            "vsqrt.f32 s0, s0",
            "vmov {bits}, s0",
            bits = inout(reg) bits,
            out("s0") _,
            options(pure, nomem, nostack, preserves_flags),
        );
    }
    f32::from_bits(bits)
}

#[cfg(all(not(feature = "std"), not(all(target_arch = "arm", target_abi = "eabihf"))))]
use libm::sqrtf as square_root;

#[cfg(test)]
mod tests {
    use super::Real;

    #[test]
    fn sine_and_cosine_match_libm() {
        for n in -20_000..20_000 {
            let x = f64::from(n) * 0.05 + 1e-3;
            let (s, c) = x.sin_cos_poly();
            assert!((s - libm::sin(x)).abs() < 7e-12, "sin {x}: {s}");
            assert!((c - libm::cos(x)).abs() < 7e-12, "cos {x}: {c}");
            let y = x as f32;
            let (s, c) = y.sin_cos_poly();
            assert!((f64::from(s) - libm::sin(f64::from(y))).abs() < 2e-7, "sin {y}: {s}");
            assert!((f64::from(c) - libm::cos(f64::from(y))).abs() < 2e-7, "cos {y}: {c}");
        }
    }

    #[test]
    fn repeated_rotations_add_their_angles() {
        let mut sin_cos = 0.3f64.sin_cos_poly();
        for n in 1..=50 {
            sin_cos = Real::rotate(sin_cos, 0.04);
            let angle = 0.3 + 0.04 * f64::from(n);
            let (sin, cos) = sin_cos;
            assert!(
                (sin - libm::sin(angle)).abs() < 1e-9 && (cos - libm::cos(angle)).abs() < 1e-9,
                "{n}"
            );
        }
    }

    #[test]
    fn floor_matches_libm() {
        for n in -4000..4000 {
            let x = f64::from(n) * 0.125;
            assert!((Real::floor(x) - libm::floor(x)).abs() < 1e-12, "{x}");
            assert!((f64::from(Real::floor(x as f32)) - libm::floor(x)).abs() < 1e-6, "{x}");
        }
    }
}
