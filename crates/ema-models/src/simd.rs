//! Numbers in vector registers, compiled for one instruction set, one monitor per lane.
//!
//! `K` registers of the instruction set `S` form one number, so that operations on one register hide the latency of those on
//! another. Each lane computes as the scalar does: without fused multiply-add, with `min` and `max` as in [`Real`].

use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

use pulp::bytemuck::{NoUninit, Pod, bytes_of, cast, cast_slice, cast_slice_mut};
use pulp::x86::{V1, V3, V4};
use pulp::{Simd, f32x4, f64x2, m32x4, m64x2};

use crate::lanes::Lanes;
use crate::real::Real;

/// pulp's proof that the processor has the instructions of `S`.
///
/// The numbers do not carry the proof, and `Real::splat` does not take it, so each operation creates it. The proof has size
/// zero.
#[inline(always)]
fn proof<S: Copy>() -> S {
    const {
        assert!(
            size_of::<S>() == 0,
            "a proof of non-zero size cannot be created from nothing"
        )
    };
    // SAFETY: the type has size zero, so the read accesses no memory. The promise of the type holds, because the numbers of
    // this module are private to the crate and only `dispatch` uses them, after pulp has detected the instructions of `S`;
    // every processor of the target has those of `V1`.
    #[expect(unsafe_code, reason = "see above")]
    unsafe {
        core::ptr::NonNull::<S>::dangling().read()
    }
}

/// A number of one lane.
pub(crate) trait Lane: Pod + Send + Sync {
    /// A number that, added, shifts the fraction out of the mantissa; see the scalar's `round`.
    const MAGIC: f64;
    /// The nearest number.
    fn nearest(x: f64) -> Self;
}

impl Lane for f32 {
    const MAGIC: f64 = 12_582_912.0;
    #[inline(always)]
    fn nearest(x: f64) -> Self {
        x as Self
    }
}

impl Lane for f64 {
    const MAGIC: f64 = 6_755_399_441_055_744.0;
    #[inline(always)]
    fn nearest(x: f64) -> Self {
        x
    }
}

/// Operations of an instruction set on a register of numbers.
pub(crate) trait Registers<T: Lane>: Copy + Send + Sync + 'static {
    /// A register of numbers.
    type Numbers: Pod + Send + Sync;
    /// Truth value of each number in a register.
    type Truths: NoUninit + Send + Sync;

    fn splat(self, x: T) -> Self::Numbers;
    fn add(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    fn sub(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    fn mul(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    fn div(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    fn neg(self, a: Self::Numbers) -> Self::Numbers;
    fn abs(self, a: Self::Numbers) -> Self::Numbers;
    fn sqrt(self, a: Self::Numbers) -> Self::Numbers;
    /// One instruction. It returns the second operand where either is NaN or both are zero, as [`Real`] does.
    fn min(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    /// As `min`.
    fn max(self, a: Self::Numbers, b: Self::Numbers) -> Self::Numbers;
    fn lt(self, a: Self::Numbers, b: Self::Numbers) -> Self::Truths;
    fn le(self, a: Self::Numbers, b: Self::Numbers) -> Self::Truths;
    fn select(self, truths: Self::Truths, if_true: Self::Numbers, if_false: Self::Numbers) -> Self::Numbers;
    fn and(self, a: Self::Truths, b: Self::Truths) -> Self::Truths;
    fn or(self, a: Self::Truths, b: Self::Truths) -> Self::Truths;
    fn not(self, a: Self::Truths) -> Self::Truths;
}

/// Implements [`Registers`]; each method stands before its function of pulp.
macro_rules! registers {
    (
        $set:ty, $t:ty, $numbers:ty, $truths:ty;
        splat $splat:expr; $($one:ident $by_one:expr),*; $($two:ident $by_two:expr),*; $($compare:ident $by_compare:expr),*;
        select $select:expr; $($truth:ident $by_truth:expr),*; not $not:expr
    ) => {
        impl Registers<$t> for $set {
            type Numbers = $numbers;
            type Truths = $truths;

            #[inline(always)]
            fn splat(self, x: $t) -> $numbers {
                $splat(self, x)
            }
            $(#[inline(always)]
            fn $one(self, a: $numbers) -> $numbers {
                $by_one(self, a)
            })*
            $(#[inline(always)]
            fn $two(self, a: $numbers, b: $numbers) -> $numbers {
                $by_two(self, a, b)
            })*
            $(#[inline(always)]
            fn $compare(self, a: $numbers, b: $numbers) -> $truths {
                $by_compare(self, a, b)
            })*
            #[inline(always)]
            fn select(self, truths: $truths, if_true: $numbers, if_false: $numbers) -> $numbers {
                $select(self, truths, if_true, if_false)
            }
            $(#[inline(always)]
            fn $truth(self, a: $truths, b: $truths) -> $truths {
                $by_truth(self, a, b)
            })*
            #[inline(always)]
            fn not(self, a: $truths) -> $truths {
                $not(self, a)
            }
        }
    };
}

macro_rules! registers_of_pulp {
    ($($set:ty),*) => {$(
        registers! {
            $set, f32, <$set as Simd>::f32s, <$set as Simd>::m32s;
            splat Simd::splat_f32s; neg Simd::neg_f32s, abs Simd::abs_f32s, sqrt Simd::sqrt_f32s;
            add Simd::add_f32s, sub Simd::sub_f32s, mul Simd::mul_f32s, div Simd::div_f32s, min Simd::min_f32s, max Simd::max_f32s;
            lt Simd::less_than_f32s, le Simd::less_than_or_equal_f32s;
            select Simd::select_f32s; and Simd::and_m32s, or Simd::or_m32s; not Simd::not_m32s
        }
        registers! {
            $set, f64, <$set as Simd>::f64s, <$set as Simd>::m64s;
            splat Simd::splat_f64s; neg Simd::neg_f64s, abs Simd::abs_f64s, sqrt Simd::sqrt_f64s;
            add Simd::add_f64s, sub Simd::sub_f64s, mul Simd::mul_f64s, div Simd::div_f64s, min Simd::min_f64s, max Simd::max_f64s;
            lt Simd::less_than_f64s, le Simd::less_than_or_equal_f64s;
            select Simd::select_f64s; and Simd::and_m64s, or Simd::or_m64s; not Simd::not_m64s
        }
    )*};
}

registers_of_pulp!(V3, V4);

registers! {
    V1, f32, f32x4, m32x4;
    splat V1::splat_f32x4; neg (|set: V1, a| set.xor_f32x4(a, set.splat_f32x4(-0.0))), abs V1::abs_f32x4, sqrt V1::sqrt_f32x4;
    add V1::add_f32x4, sub V1::sub_f32x4, mul V1::mul_f32x4, div V1::div_f32x4, min V1::min_f32x4, max V1::max_f32x4;
    lt V1::cmp_lt_f32x4, le V1::cmp_le_f32x4;
    select (|set: V1, truths, if_true, if_false| {
        let truths: f32x4 = cast::<m32x4, _>(truths);
        set.or_f32x4(set.and_f32x4(truths, if_true), set.andnot_f32x4(truths, if_false))
    }); and V1::and_m32x4, or V1::or_m32x4; not V1::not_m32x4
}

registers! {
    V1, f64, f64x2, m64x2;
    splat V1::splat_f64x2; neg (|set: V1, a| set.xor_f64x2(a, set.splat_f64x2(-0.0))), abs V1::abs_f64x2, sqrt V1::sqrt_f64x2;
    add V1::add_f64x2, sub V1::sub_f64x2, mul V1::mul_f64x2, div V1::div_f64x2, min V1::min_f64x2, max V1::max_f64x2;
    lt V1::cmp_lt_f64x2, le V1::cmp_le_f64x2;
    select (|set: V1, truths, if_true, if_false| {
        let truths: f64x2 = cast::<m64x2, _>(truths);
        set.or_f64x2(set.and_f64x2(truths, if_true), set.andnot_f64x2(truths, if_false))
    }); and V1::and_m64x2, or V1::or_m64x2; not V1::not_m64x2
}

/// `K` registers of numbers of type `T`.
#[derive(Clone, Copy)]
pub(crate) struct Wide<S: Registers<T>, T: Lane, const K: usize>([S::Numbers; K]);

/// `K` registers of numbers in single precision.
pub(crate) type Wide32<S, const K: usize> = Wide<S, f32, K>;

/// `K` registers of numbers in double precision.
pub(crate) type Wide64<S, const K: usize> = Wide<S, f64, K>;

/// Truth value of each lane.
#[derive(Clone, Copy)]
pub(crate) struct WideMask<S: Registers<T>, T: Lane, const K: usize>([S::Truths; K]);

impl<S: Registers<T>, T: Lane, const K: usize> Wide<S, T, K> {
    #[inline(always)]
    fn map(mut self, f: impl Fn(S, S::Numbers) -> S::Numbers) -> Self {
        for k in 0..K {
            self.0[k] = f(proof(), self.0[k]);
        }
        self
    }

    #[inline(always)]
    fn zip(mut self, other: Self, f: impl Fn(S, S::Numbers, S::Numbers) -> S::Numbers) -> Self {
        for k in 0..K {
            self.0[k] = f(proof(), self.0[k], other.0[k]);
        }
        self
    }

    #[inline(always)]
    fn compare(self, other: Self, f: impl Fn(S, S::Numbers, S::Numbers) -> S::Truths) -> WideMask<S, T, K> {
        let mut mask = [f(proof(), self.0[0], other.0[0]); K];
        for k in 1..K {
            mask[k] = f(proof(), self.0[k], other.0[k]);
        }
        WideMask(mask)
    }
}

impl<S: Registers<T>, T: Lane, const K: usize> Add for Wide<S, T, K> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, S::add)
    }
}

impl<S: Registers<T>, T: Lane, const K: usize> Sub for Wide<S, T, K> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, S::sub)
    }
}

impl<S: Registers<T>, T: Lane, const K: usize> Mul for Wide<S, T, K> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, S::mul)
    }
}

impl<S: Registers<T>, T: Lane, const K: usize> Div for Wide<S, T, K> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.zip(other, S::div)
    }
}

impl<S: Registers<T>, T: Lane, const K: usize> Neg for Wide<S, T, K> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(S::neg)
    }
}

impl<S: Registers<T>, T: Lane, const K: usize> BitAnd for WideMask<S, T, K> {
    type Output = Self;
    #[inline(always)]
    fn bitand(mut self, other: Self) -> Self {
        for k in 0..K {
            self.0[k] = proof::<S>().and(self.0[k], other.0[k]);
        }
        self
    }
}

impl<S: Registers<T>, T: Lane, const K: usize> BitOr for WideMask<S, T, K> {
    type Output = Self;
    #[inline(always)]
    fn bitor(mut self, other: Self) -> Self {
        for k in 0..K {
            self.0[k] = proof::<S>().or(self.0[k], other.0[k]);
        }
        self
    }
}

impl<S: Registers<T>, T: Lane, const K: usize> Not for WideMask<S, T, K> {
    type Output = Self;
    #[inline(always)]
    fn not(mut self) -> Self {
        for k in 0..K {
            self.0[k] = proof::<S>().not(self.0[k]);
        }
        self
    }
}

impl<S: Registers<T>, T: Lane, const K: usize> Real for Wide<S, T, K> {
    type Mask = WideMask<S, T, K>;

    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self([proof::<S>().splat(T::nearest(x)); K])
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Self::Mask {
        self.compare(other, S::lt)
    }
    #[inline(always)]
    fn le(self, other: Self) -> Self::Mask {
        self.compare(other, S::le)
    }
    #[inline(always)]
    fn select(mask: Self::Mask, if_true: Self, mut if_false: Self) -> Self {
        for k in 0..K {
            if_false.0[k] = proof::<S>().select(mask.0[k], if_true.0[k], if_false.0[k]);
        }
        if_false
    }
    #[inline(always)]
    fn known_true(mask: Self::Mask) -> bool {
        let mut all = mask.0[0];
        for k in 1..K {
            all = proof::<S>().and(all, mask.0[k]);
        }
        let zero = proof::<S>().splat(T::nearest(0.0));
        // A comparison of bytes takes one or two instructions; pulp's own test searches lane by lane.
        bytes_of(&all) == bytes_of(&proof::<S>().le(zero, zero))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.map(S::abs)
    }
    #[inline(always)]
    fn round(self) -> Self {
        // As for the scalar.
        let magic = Self::splat(T::MAGIC);
        (self + magic) - magic
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(S::sqrt)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, S::min)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, S::max)
    }
}

impl<S: Registers<T>, T: Lane, const K: usize, const N: usize> Lanes<T, N> for Wide<S, T, K> {
    #[inline(always)]
    fn from_lanes(lanes: [T; N]) -> Self {
        const { assert!(K * size_of::<S::Numbers>() == N * size_of::<T>()) };
        let registers: &[S::Numbers] = cast_slice(&lanes);
        let mut out = Self([registers[0]; K]);
        out.0.copy_from_slice(registers);
        out
    }

    #[inline(always)]
    fn to_lanes(self) -> [T; N] {
        const { assert!(K * size_of::<S::Numbers>() == N * size_of::<T>()) };
        let mut lanes = [T::nearest(0.0); N];
        let registers: &mut [S::Numbers] = cast_slice_mut(&mut lanes);
        registers.copy_from_slice(&self.0);
        lanes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::{Lanes32, Lanes64};

    /// Every operation on all pairs of special numbers gives the bits of the arrays.
    macro_rules! same_bits_as_arrays {
        ($name:ident, $wide:ident, $arrays:ident, $t:ident) => {
            #[inline(always)]
            fn $name<S: Registers<$t>, const N: usize>() {
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
        singles::<pulp::x86::V1, 8>();
        doubles::<pulp::x86::V1, 4>();
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
