//! Numbers in vector registers, compiled for one instruction set, one monitor per lane.
//!
//! `K` registers of the instruction set `S` form one number, so that operations on one register hide the latency of those on
//! another. Each lane computes as the scalar does: without fused multiply-add, with `min` and `max` as in [`Real`].

use core::marker::PhantomData;
use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

use pulp::Simd;
use pulp::bytemuck::bytes_of;

use crate::lanes::Lanes;
use crate::real::Real;

/// pulp's proof that the processor has the instructions of `S`.
///
/// The numbers do not carry the proof, and `Real::splat` does not take it, so each operation creates it. The proof has size
/// zero.
#[inline(always)]
fn proof<S: Simd>() -> S {
    const {
        assert!(
            size_of::<S>() == 0,
            "a proof of non-zero size cannot be created from nothing"
        )
    };
    // SAFETY: the type has size zero, so the read accesses no memory. The promise of the type holds, because the numbers of
    // this module are private to the crate and only `dispatch` uses them, after pulp has detected the instructions of `S`.
    #[expect(unsafe_code, reason = "see above")]
    unsafe {
        core::ptr::NonNull::<S>::dangling().read()
    }
}

macro_rules! wide {
    ($wide:ident, $mask:ident, $t:ident, $ts:ident, $ms:ident, $lanes:ident, [
        $splat:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $neg:ident, $abs:ident, $sqrt:ident,
        $min:ident, $max:ident, $lt:ident, $le:ident, $select:ident, $and:ident, $or:ident, $not:ident,
        $as_simd:ident, $as_mut_simd:ident
    ], $magic:expr, $doc:literal) => {
        #[doc = $doc]
        #[derive(Clone, Copy, Debug)]
        pub(crate) struct $wide<S: Simd, const K: usize>([S::$ts; K]);

        /// Truth value of each lane.
        #[derive(Clone, Copy, Debug)]
        pub(crate) struct $mask<S: Simd, const K: usize>([S::$ms; K], PhantomData<S>);

        impl<S: Simd, const K: usize> $wide<S, K> {
            #[inline(always)]
            fn map(mut self, f: impl Fn(S, S::$ts) -> S::$ts) -> Self {
                for k in 0..K {
                    self.0[k] = f(proof(), self.0[k]);
                }
                self
            }

            #[inline(always)]
            fn zip(mut self, other: Self, f: impl Fn(S, S::$ts, S::$ts) -> S::$ts) -> Self {
                for k in 0..K {
                    self.0[k] = f(proof(), self.0[k], other.0[k]);
                }
                self
            }

            #[inline(always)]
            fn compare(self, other: Self, f: impl Fn(S, S::$ts, S::$ts) -> S::$ms) -> $mask<S, K> {
                let mut mask = [f(proof(), self.0[0], other.0[0]); K];
                for k in 1..K {
                    mask[k] = f(proof(), self.0[k], other.0[k]);
                }
                $mask(mask, PhantomData)
            }
        }

        impl<S: Simd, const K: usize> Add for $wide<S, K> {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                self.zip(other, S::$add)
            }
        }

        impl<S: Simd, const K: usize> Sub for $wide<S, K> {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                self.zip(other, S::$sub)
            }
        }

        impl<S: Simd, const K: usize> Mul for $wide<S, K> {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                self.zip(other, S::$mul)
            }
        }

        impl<S: Simd, const K: usize> Div for $wide<S, K> {
            type Output = Self;
            #[inline(always)]
            fn div(self, other: Self) -> Self {
                self.zip(other, S::$div)
            }
        }

        impl<S: Simd, const K: usize> Neg for $wide<S, K> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                self.map(S::$neg)
            }
        }

        impl<S: Simd, const K: usize> BitAnd for $mask<S, K> {
            type Output = Self;
            #[inline(always)]
            fn bitand(mut self, other: Self) -> Self {
                for k in 0..K {
                    self.0[k] = proof::<S>().$and(self.0[k], other.0[k]);
                }
                self
            }
        }

        impl<S: Simd, const K: usize> BitOr for $mask<S, K> {
            type Output = Self;
            #[inline(always)]
            fn bitor(mut self, other: Self) -> Self {
                for k in 0..K {
                    self.0[k] = proof::<S>().$or(self.0[k], other.0[k]);
                }
                self
            }
        }

        impl<S: Simd, const K: usize> Not for $mask<S, K> {
            type Output = Self;
            #[inline(always)]
            fn not(mut self) -> Self {
                for k in 0..K {
                    self.0[k] = proof::<S>().$not(self.0[k]);
                }
                self
            }
        }

        impl<S: Simd, const K: usize> Real for $wide<S, K> {
            type Mask = $mask<S, K>;

            #[inline(always)]
            fn splat(x: f64) -> Self {
                Self([proof::<S>().$splat(x as $t); K])
            }
            #[inline(always)]
            fn lt(self, other: Self) -> Self::Mask {
                self.compare(other, S::$lt)
            }
            #[inline(always)]
            fn le(self, other: Self) -> Self::Mask {
                self.compare(other, S::$le)
            }
            #[inline(always)]
            fn select(mask: Self::Mask, if_true: Self, mut if_false: Self) -> Self {
                for k in 0..K {
                    if_false.0[k] = proof::<S>().$select(mask.0[k], if_true.0[k], if_false.0[k]);
                }
                if_false
            }
            #[inline(always)]
            fn known_true(mask: Self::Mask) -> bool {
                let mut all = mask.0[0];
                for k in 1..K {
                    all = proof::<S>().$and(all, mask.0[k]);
                }
                let zero = proof::<S>().$splat(0.0);
                // A comparison of bytes takes one or two instructions; pulp's own test searches lane by lane.
                bytes_of(&all) == bytes_of(&proof::<S>().$le(zero, zero))
            }
            #[inline(always)]
            fn abs(self) -> Self {
                self.map(S::$abs)
            }
            #[inline(always)]
            fn round(self) -> Self {
                // As for the scalar.
                let magic = Self::splat($magic);
                (self + magic) - magic
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                self.map(S::$sqrt)
            }
            // One instruction each. They return the second operand where either is NaN or both are zero, as the trait does.
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                self.zip(other, S::$min)
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                self.zip(other, S::$max)
            }
        }

        impl<S: Simd, const K: usize, const N: usize> Lanes<$t, N> for $wide<S, K> {
            #[inline(always)]
            fn from_lanes(lanes: [$t; N]) -> Self {
                const { assert!(K * S::$lanes == N) };
                let (registers, _) = S::$as_simd(&lanes);
                let mut out = Self([registers[0]; K]);
                out.0.copy_from_slice(registers);
                out
            }

            #[inline(always)]
            fn to_lanes(self) -> [$t; N] {
                const { assert!(K * S::$lanes == N) };
                let mut lanes = [0.0; N];
                let (registers, _) = S::$as_mut_simd(&mut lanes);
                registers.copy_from_slice(&self.0);
                lanes
            }
        }
    };
}

wide!(
    Wide32,
    WideMask32,
    f32,
    f32s,
    m32s,
    F32_LANES,
    [
        splat_f32s,
        add_f32s,
        sub_f32s,
        mul_f32s,
        div_f32s,
        neg_f32s,
        abs_f32s,
        sqrt_f32s,
        min_f32s,
        max_f32s,
        less_than_f32s,
        less_than_or_equal_f32s,
        select_f32s,
        and_m32s,
        or_m32s,
        not_m32s,
        as_simd_f32s,
        as_mut_simd_f32s
    ],
    12_582_912.0,
    "`K` registers of numbers in single precision."
);
wide!(
    Wide64,
    WideMask64,
    f64,
    f64s,
    m64s,
    F64_LANES,
    [
        splat_f64s,
        add_f64s,
        sub_f64s,
        mul_f64s,
        div_f64s,
        neg_f64s,
        abs_f64s,
        sqrt_f64s,
        min_f64s,
        max_f64s,
        less_than_f64s,
        less_than_or_equal_f64s,
        select_f64s,
        and_m64s,
        or_m64s,
        not_m64s,
        as_simd_f64s,
        as_mut_simd_f64s
    ],
    6_755_399_441_055_744.0,
    "`K` registers of numbers in double precision."
);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::{Lanes32, Lanes64};

    /// Every operation on all pairs of special numbers gives the bits of the arrays.
    macro_rules! same_bits_as_arrays {
        ($name:ident, $wide:ident, $arrays:ident, $t:ident) => {
            #[inline(always)]
            fn $name<S: Simd, const N: usize>() {
                let special = [0.0, -0.0, 1.0, -1.5, 2.5, $t::NAN, $t::INFINITY, $t::MIN_POSITIVE];
                for shift in 0..special.len() {
                    let a: [$t; N] = core::array::from_fn(|n| special[n % special.len()]);
                    let b: [$t; N] = core::array::from_fn(|n| special[(n + shift) % special.len()]);
                    let bits = |x: [$t; N]| x.map(|x| if x.is_nan() { 0 } else { x.to_bits() });
                    let wide = all_of(<$wide<S, 2> as Lanes<$t, N>>::from_lanes(a), Lanes::from_lanes(b));
                    for (got, expected) in wide.into_iter().zip(all_of($arrays(a), $arrays(b))) {
                        assert_eq!(bits(got.to_lanes()), bits(expected.to_lanes()), "{a:?} {b:?}");
                    }
                }
                // `known_true` requires every lane of every register.
                for false_lane in 0..=N {
                    let a: [$t; N] = core::array::from_fn(|n| if n == false_lane { 1.0 } else { 0.0 });
                    let (wide, zero) = (<$wide<S, 2> as Lanes<$t, N>>::from_lanes(a), $wide::splat(0.0));
                    assert_eq!(
                        $wide::<S, 2>::known_true(wide.le(zero)),
                        false_lane == N,
                        "lane {false_lane}"
                    );
                    let (array, zero) = ($arrays(a), $arrays::splat(0.0));
                    assert_eq!(
                        $arrays::<N>::known_true(array.le(zero)),
                        false_lane == N,
                        "lane {false_lane}"
                    );
                }
            }
        };
    }
    same_bits_as_arrays!(singles, Wide32, Lanes32, f32);
    same_bits_as_arrays!(doubles, Wide64, Lanes64, f64);

    fn all_of<R: Real>(a: R, b: R) -> [R; 13] {
        let mask = (a.lt(b) & a.le(b)) | !b.le(a);
        [
            a + b,
            a - b,
            a * b,
            a / b,
            -a,
            a.abs(),
            a.round(),
            a.floor(),
            a.sqrt(),
            a.min(b),
            a.max(b),
            a.clamp_abs(b),
            R::select(mask, a, b),
        ]
    }

    #[test]
    fn registers_give_the_bits_of_arrays() {
        if pulp::x86::V3::is_available() {
            singles::<pulp::x86::V3, 16>();
            doubles::<pulp::x86::V3, 8>();
        }
        if pulp::x86::V4::is_available() {
            singles::<pulp::x86::V4, 32>();
            doubles::<pulp::x86::V4, 16>();
        }
    }
}
