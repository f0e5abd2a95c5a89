//! Harnesses: what must hold for every input within a stated bound.
//!
//! Each states its claim and its bound in its first two paragraphs; the table of `docs/design/harnesses.md` is written from them. A bound that
//! says "exhaustive" is tried in whole, the others by random inputs that a failure shrinks.
#![cfg(test)]
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

mod budgets;
mod can;
mod counters;
mod frames;
mod health;
mod quantities;
mod readers;
mod search;
mod serial;
mod table;
mod time;
mod windows;

/// Random inputs of a harness that takes about a microsecond each.
const MANY: usize = 20_000;
/// The same at about a tenth of a millisecond.
const SOME: usize = 1000;
/// The same at some milliseconds.
const FEW: usize = 100;

/// Runs a claim over random inputs of a type.
#[macro_export]
macro_rules! for_any {
    ($iterations:expr, |$input:ident: $type:ty| $body:expr) => {
        bolero::check!()
            .with_iterations($iterations)
            .with_type::<$type>()
            .cloned()
            .for_each(|$input: $type| $body)
    };
    ($iterations:expr, $generator:expr, |$input:ident: $type:ty| $body:expr) => {
        bolero::check!()
            .with_iterations($iterations)
            .with_generator($generator)
            .cloned()
            .for_each(|$input: $type| $body)
    };
}

/// Bytes up to a length.
fn bytes(longest: usize) -> impl bolero::ValueGenerator<Output = Vec<u8>> {
    bolero::produce::<Vec<u8>>().with().len(0..=longest)
}
