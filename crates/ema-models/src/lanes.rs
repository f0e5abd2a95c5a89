//! Arrays of numbers that are computed element by element: several monitors side by side.
//!
//! Plain arrays and loops, for every processor; `simd` has the same in wide registers. Each lane does exactly what the
//! scalar would, so the same bits come out on every processor.

use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

use crate::real::Real;

/// `N` numbers of type `T` that are computed as one.
pub(crate) trait Lanes<T, const N: usize>: Real {
    /// From its lanes.
    fn from_lanes(lanes: [T; N]) -> Self;
    /// Its lanes.
    fn to_lanes(self) -> [T; N];
}

/// Individuals that [`Comparison::rank`] takes at once: one register of sixteen, or two of eight.
pub const RANK_LANES: usize = 32;

/// Lanes of the finite differences: the point, one step along each coordinate, and spare ones.
pub(crate) const SLOPE_LANES: usize = 16;

macro_rules! lanes {
    ($lanes:ident, $mask:ident, $t:ty, $bits:ty, $doc:literal) => {
        #[doc = $doc]
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[repr(align(64))]
        pub struct $lanes<const N: usize>(pub [$t; N]);

        /// Truth value of each lane: all bits or none.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(align(64))]
        pub struct $mask<const N: usize>([$bits; N]);

        impl<const N: usize> $lanes<N> {
            #[inline(always)]
            fn map(self, f: impl Fn($t) -> $t) -> Self {
                let mut out = self;
                for x in &mut out.0 {
                    *x = f(*x);
                }
                out
            }

            #[inline(always)]
            fn zip(self, other: Self, f: impl Fn($t, $t) -> $t) -> Self {
                let mut out = self;
                for (x, y) in out.0.iter_mut().zip(other.0) {
                    *x = f(*x, y);
                }
                out
            }

            #[inline(always)]
            fn compare(self, other: Self, f: impl Fn($t, $t) -> bool) -> $mask<N> {
                let mut out = [0; N];
                for (m, (x, y)) in out.iter_mut().zip(self.0.into_iter().zip(other.0)) {
                    *m = if f(x, y) { <$bits>::MAX } else { 0 };
                }
                $mask(out)
            }
        }

        impl<const N: usize> Add for $lanes<N> {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                self.zip(other, |x, y| x + y)
            }
        }

        impl<const N: usize> Sub for $lanes<N> {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                self.zip(other, |x, y| x - y)
            }
        }

        impl<const N: usize> Mul for $lanes<N> {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                self.zip(other, |x, y| x * y)
            }
        }

        impl<const N: usize> Div for $lanes<N> {
            type Output = Self;
            #[inline(always)]
            fn div(self, other: Self) -> Self {
                self.zip(other, |x, y| x / y)
            }
        }

        impl<const N: usize> Neg for $lanes<N> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                self.map(|x| -x)
            }
        }

        impl<const N: usize> BitAnd for $mask<N> {
            type Output = Self;
            #[inline(always)]
            fn bitand(mut self, other: Self) -> Self {
                for (x, y) in self.0.iter_mut().zip(other.0) {
                    *x &= y;
                }
                self
            }
        }

        impl<const N: usize> BitOr for $mask<N> {
            type Output = Self;
            #[inline(always)]
            fn bitor(mut self, other: Self) -> Self {
                for (x, y) in self.0.iter_mut().zip(other.0) {
                    *x |= y;
                }
                self
            }
        }

        impl<const N: usize> Not for $mask<N> {
            type Output = Self;
            #[inline(always)]
            fn not(mut self) -> Self {
                for x in &mut self.0 {
                    *x = !*x;
                }
                self
            }
        }

        impl<const N: usize> Lanes<$t, N> for $lanes<N> {
            #[inline(always)]
            fn from_lanes(lanes: [$t; N]) -> Self {
                Self(lanes)
            }
            #[inline(always)]
            fn to_lanes(self) -> [$t; N] {
                self.0
            }
        }

        impl<const N: usize> Real for $lanes<N> {
            type Mask = $mask<N>;

            #[inline(always)]
            fn splat(x: f64) -> Self {
                Self([x as $t; N])
            }
            #[inline(always)]
            fn lt(self, other: Self) -> $mask<N> {
                self.compare(other, |x, y| x < y)
            }
            #[inline(always)]
            fn le(self, other: Self) -> $mask<N> {
                self.compare(other, |x, y| x <= y)
            }
            #[inline(always)]
            fn select(mask: $mask<N>, if_true: Self, if_false: Self) -> Self {
                let mut out = if_false;
                for k in 0..N {
                    let (t, f, m) = (if_true.0[k].to_bits(), if_false.0[k].to_bits(), mask.0[k]);
                    out.0[k] = <$t>::from_bits((t & m) | (f & !m));
                }
                out
            }
            #[inline(always)]
            fn holds(mask: $mask<N>) -> bool {
                mask.0.iter().fold(<$bits>::MAX, |all, x| all & x) != 0
            }
            #[inline(always)]
            fn abs(self) -> Self {
                self.map(|x| Real::abs(x))
            }
            #[inline(always)]
            fn round(self) -> Self {
                self.map(|x| Real::round(x))
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                self.map(|x| Real::sqrt(x))
            }
        }
    };
}

lanes!(Lanes32, Mask32, f32, u32, "`N` numbers in single precision.");
lanes!(Lanes64, Mask64, f64, u64, "`N` numbers in double precision.");
