//! Tests of the simulated firmware from outside.

#[cfg(feature = "std")]
mod host;
mod link;
mod stream;
mod wear;
