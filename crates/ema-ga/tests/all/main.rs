//! Tests of the crate from outside.

#[cfg(feature = "std")]
mod common;
#[cfg(feature = "std")]
mod convergence;
#[cfg(feature = "std")]
mod determinism;
mod least_squares;
mod operators;
