//! Identification on the controller itself: one thread, no `std`, no allocation, the monitor in single precision.
//!
//! - [`RecordedWindow`]: one actuation as raw sensor words, made ready for comparison sample by sample.
//! - [`Identification`]: what a fault vector is judged by; the monitors of one linearisation run in lock-step over the
//!   window, so that no residual is ever stored.
//! - [`Identification::identify`]: Levenberg–Marquardt from health, as `hmd` does it without a population search.
//!
//! Built without features this is a library for any machine; feature `image` adds the programs for the processor itself,
//! which `cargo xtask target` builds and runs.
#![no_std]
#![warn(clippy::std_instead_of_core, clippy::alloc_instead_of_core)]

mod compare;
mod identify;
mod window;

pub use compare::Identification;
pub use identify::Found;
pub use window::{Drive, MAX_CONTROLS, RecordedWindow};
