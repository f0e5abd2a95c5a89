//! Runs a piece of arithmetic with the widest vector instructions that the processor has.
//!
//! One binary for all: the work is compiled once for each instruction set, and the best one is chosen at run time. The
//! result does not depend on the choice, because lanes do what scalars do.

use crate::lanes::{Lanes, Lanes32, Lanes64, RANK_LANES, SLOPE_LANES};

/// Numbers side by side, as one instruction set computes them.
pub(crate) trait Numbers {
    /// For searches.
    type Single: Lanes<f32, RANK_LANES>;
    /// For finite differences.
    type Double: Lanes<f64, SLOPE_LANES>;
}

/// A piece of work. `run` and everything in it must be inlined into what has the instructions, or it is compiled for the plainest
/// processor.
pub(crate) trait Work {
    /// What it yields.
    type Output;

    /// Does it.
    fn run<N: Numbers>(self) -> Self::Output;
}

/// Arrays, as the compiler sees fit.
struct Arrays;

impl Numbers for Arrays {
    type Single = Lanes32<RANK_LANES>;
    type Double = Lanes64<SLOPE_LANES>;
}

/// Vector instructions that lanes are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InstructionSet {
    /// What every processor of the target has.
    Baseline,
    /// x86-64-v3: registers of 256 bits.
    Avx2,
    /// x86-64-v4: registers of 512 bits.
    Avx512,
}

impl InstructionSet {
    /// Those that this processor has, the best first.
    pub fn available() -> impl Iterator<Item = Self> {
        [Self::Avx512, Self::Avx2, Self::Baseline]
            .into_iter()
            .filter(|set| set.is_available())
    }

    /// The best that this processor has.
    #[must_use]
    pub fn best() -> Self {
        Self::available().next().unwrap_or(Self::Baseline)
    }

    /// Its usual name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Avx2 => "AVX2",
            Self::Avx512 => "AVX-512",
        }
    }

    #[cfg(all(feature = "std", target_arch = "x86_64"))]
    fn is_available(self) -> bool {
        match self {
            Self::Baseline => true,
            Self::Avx2 => pulp::x86::V3::is_available(),
            Self::Avx512 => pulp::x86::V4::is_available(),
        }
    }

    #[cfg(not(all(feature = "std", target_arch = "x86_64")))]
    fn is_available(self) -> bool {
        self == Self::Baseline
    }

    /// Does the work; a set that the processor lacks is replaced by the baseline.
    #[cfg(all(feature = "std", target_arch = "x86_64"))]
    pub(crate) fn run<W: Work>(self, work: W) -> W::Output {
        use pulp::x86::{V3, V4};
        if self == Self::Avx512
            && let Some(proof) = V4::try_new()
        {
            return wide::run(proof, work);
        }
        if self == Self::Avx2
            && let Some(proof) = V3::try_new()
        {
            return wide::run(proof, work);
        }
        on_arrays(work)
    }

    /// Does the work.
    #[cfg(not(all(feature = "std", target_arch = "x86_64")))]
    pub(crate) fn run<W: Work>(self, work: W) -> W::Output {
        on_arrays(work)
    }
}

/// Does the work with what every processor has. By itself, or the compiler takes minutes over what it is inlined into.
#[inline(never)]
fn on_arrays<W: Work>(work: W) -> W::Output {
    work.run::<Arrays>()
}

/// The only place that names numbers in registers: pulp's proof that the processor has them stands beside.
#[cfg(all(feature = "std", target_arch = "x86_64"))]
mod wide {
    use core::marker::PhantomData;

    use pulp::x86::{V3, V4};
    use pulp::{Simd, WithSimd};

    use super::{Numbers, RANK_LANES, SLOPE_LANES, Work};
    use crate::simd::{Wide32, Wide64};

    impl Numbers for V3 {
        type Single = Wide32<Self, { RANK_LANES / 8 }>;
        type Double = Wide64<Self, { SLOPE_LANES / 4 }>;
    }

    impl Numbers for V4 {
        type Single = Wide32<Self, { RANK_LANES / 16 }>;
        type Double = Wide64<Self, { SLOPE_LANES / 8 }>;
    }

    /// Does the work with the instructions of `S`.
    pub(super) fn run<S: Simd + Numbers, W: Work>(proof: S, work: W) -> W::Output {
        struct Compiled<S, W>(W, PhantomData<S>);

        impl<S: Simd + Numbers, W: Work> WithSimd for Compiled<S, W> {
            type Output = W::Output;

            #[inline(always)]
            fn with_simd<Same: Simd>(self, _: Same) -> W::Output {
                self.0.run::<S>()
            }
        }

        proof.vectorize(Compiled(work, PhantomData::<S>))
    }
}
