//! Runs a computation with the widest vector instructions of the processor, selected at run time.
//!
//! A [`LaneWork`] is compiled once per instruction set, with the number types of [`LaneTypes`]. The result does not depend on
//! the instruction set, because each lane computes as the scalar does.

use crate::lanes::{Lanes, RANK_LANES, SLOPE_LANES};

/// Number types of one instruction set.
pub(crate) trait LaneTypes {
    /// Single precision, for searches.
    type Single: Lanes<f32, RANK_LANES>;
    /// Double precision, for finite differences.
    type Double: Lanes<f64, SLOPE_LANES>;
}

/// A computation on lanes.
///
/// `run` and all functions it calls must be inlined into the function that is compiled for the instruction set; otherwise they
/// are compiled for the baseline.
pub(crate) trait LaneWork {
    /// Result of the computation.
    type Output;

    /// Runs the computation with the number types of one instruction set.
    fn run<N: LaneTypes>(self) -> Self::Output;
}

/// Vector instruction set for which the lanes are compiled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InstructionSet {
    /// The instructions of every processor of the target.
    Baseline,
    /// x86-64-v3: registers of 256 bits.
    Avx2,
    /// x86-64-v4: registers of 512 bits.
    Avx512,
}

impl InstructionSet {
    /// Instruction sets of this processor, the widest first.
    pub fn available() -> impl Iterator<Item = Self> {
        [Self::Avx512, Self::Avx2, Self::Baseline]
            .into_iter()
            .filter(|set| set.is_available())
    }

    /// The widest instruction set of this processor.
    #[must_use]
    pub fn best() -> Self {
        Self::available().next().unwrap_or(Self::Baseline)
    }

    /// Common name of the instruction set.
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

    /// Runs the computation with this instruction set, or with the baseline if the processor does not have it.
    #[cfg(all(feature = "std", target_arch = "x86_64"))]
    pub(crate) fn run<W: LaneWork>(self, work: W) -> W::Output {
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
        on_baseline(work)
    }

    /// Runs the computation.
    #[cfg(not(all(feature = "std", target_arch = "x86_64")))]
    pub(crate) fn run<W: LaneWork>(self, work: W) -> W::Output {
        on_baseline(work)
    }
}

/// Runs the computation with the baseline. It is not inlined, because compiling it as a part of its callers takes minutes.
#[inline(never)]
fn on_baseline<W: LaneWork>(work: W) -> W::Output {
    #[cfg(all(feature = "std", target_arch = "x86_64"))]
    return work.run::<pulp::x86::V1>();
    #[cfg(not(all(feature = "std", target_arch = "x86_64")))]
    work.run::<arrays::Arrays>()
}

/// Arrays where `simd` has no registers; the compiler vectorises their loops.
#[cfg(not(all(feature = "std", target_arch = "x86_64")))]
mod arrays {
    use super::{LaneTypes, RANK_LANES, SLOPE_LANES};
    use crate::lanes::{Lanes32, Lanes64};

    pub(super) struct Arrays;

    impl LaneTypes for Arrays {
        type Single = Lanes32<RANK_LANES>;
        type Double = Lanes64<SLOPE_LANES>;
    }
}

/// The only module that uses the vector registers of `simd`, together with pulp's proof that the processor has them.
#[cfg(all(feature = "std", target_arch = "x86_64"))]
mod wide {
    use core::marker::PhantomData;

    use pulp::x86::{V1, V3, V4};
    use pulp::{Simd, WithSimd};

    use super::{LaneTypes, LaneWork, RANK_LANES, SLOPE_LANES};
    use crate::simd::{Wide32, Wide64};

    /// Registers of 128 bits. The compiler takes ten times as long over arrays.
    impl LaneTypes for V1 {
        type Single = Wide32<Self, { RANK_LANES / 4 }>;
        type Double = Wide64<Self, { SLOPE_LANES / 2 }>;
    }

    impl LaneTypes for V3 {
        type Single = Wide32<Self, { RANK_LANES / 8 }>;
        type Double = Wide64<Self, { SLOPE_LANES / 4 }>;
    }

    impl LaneTypes for V4 {
        type Single = Wide32<Self, { RANK_LANES / 16 }>;
        type Double = Wide64<Self, { SLOPE_LANES / 8 }>;
    }

    /// Runs the computation with the instruction set `S`.
    pub(super) fn run<S: Simd + LaneTypes, W: LaneWork>(proof: S, work: W) -> W::Output {
        struct Compiled<S, W>(W, PhantomData<S>);

        impl<S: Simd + LaneTypes, W: LaneWork> WithSimd for Compiled<S, W> {
            type Output = W::Output;

            #[inline(always)]
            fn with_simd<Same: Simd>(self, _: Same) -> W::Output {
                self.0.run::<S>()
            }
        }

        proof.vectorize(Compiled(work, PhantomData::<S>))
    }
}
