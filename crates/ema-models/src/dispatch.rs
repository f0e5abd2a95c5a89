//! Runs a piece of arithmetic with the widest vector instructions that the processor has.
//!
//! One binary for all: the work is compiled once for each instruction set, and the best one is chosen at run time. The
//! result does not depend on the choice, because lanes do what scalars do.

/// A piece of work. `run` and everything in it must be inlined, or it is compiled for the plainest processor.
pub(crate) trait Work {
    /// What it yields.
    type Output;

    /// Does it.
    fn run(self) -> Self::Output;
}

/// Does the work.
#[cfg(feature = "std")]
pub(crate) fn with_best_instructions<W: Work>(work: W) -> W::Output {
    struct Dispatched<W>(W);

    impl<W: Work> pulp::NullaryFnOnce for Dispatched<W> {
        type Output = W::Output;

        #[inline(always)]
        fn call(self) -> W::Output {
            self.0.run()
        }
    }

    pulp::Arch::new().dispatch(Dispatched(work))
}

/// Does the work; without `std` the target's own instructions are all there are.
#[cfg(not(feature = "std"))]
pub(crate) fn with_best_instructions<W: Work>(work: W) -> W::Output {
    work.run()
}
