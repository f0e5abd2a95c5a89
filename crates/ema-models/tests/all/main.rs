//! Tests of the crate from outside; they need the standard library.
#![cfg(feature = "std")]

mod accuracy;
mod averaged;
mod effects;
mod faults;
mod lanes;
mod monitor;
mod operations;
mod reference;
