//! Sources of raw frames, and what can be lost on the way in.
//!
//! A reader yields `Result<RawFrame, Loss>`: an unreadable line or chunk is an item like any other, so that the caller
//! counts it, reports it and goes on. Only what makes a whole source useless is an error of `open`.
//! Live sources ([`live`], [`can`], [`serial`]) never end by themselves: what is missing or fails is reported and tried again.
//! Time stamps that step back are passed on as they are; later stages decide what they mean.

#[cfg(test)]
#[path = "../../hmd-core/src/frame/any_frame.rs"]
mod any_frame;
pub mod asc;
pub mod blf;
pub mod can;
pub mod candump;
mod damage;
pub mod feed;
pub mod file;
mod foreign;
#[cfg(test)]
mod foreign_tests;
mod lines;
pub mod live;
mod loss;
pub mod mdf;
pub mod serial;
#[cfg(feature = "signals")]
pub mod signals;
#[cfg(all(test, feature = "signals"))]
mod signals_tests;

pub use candump::{BadLine, CandumpReader, LineFault};
pub use damage::{Damage, Place};
pub use file::{FrameSource, IngestError, LogFormat, open, open_mapped, open_recorded, open_with};
pub use loss::Loss;
