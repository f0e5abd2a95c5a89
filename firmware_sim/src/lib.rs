//! The simulated actuator as its firmware would run it: controller, motor, transmission, sensors and sampling out of
//! `ema-models`, frames out of `ema-wire`, and a link that can be bad.
//!
//! ```text
//! Device ─ Timed<SerialPacket> ─ Stuck ─ SerialFrames ┐
//!                                      └ CanFrames ───┴ Link ─> what arrives, and when
//! ```
//!
//! Each stage is an iterator over the one before. All of it is a pure function of a [`Plan`] and of [`LinkFaults`]: no
//! clock and no I/O, which belong to whoever sends. Without feature `std` nothing allocates, and the same source runs on a
//! microcontroller; `std` adds [`write_stream`] and the host program.
#![no_std]
#![warn(clippy::std_instead_of_core, clippy::alloc_instead_of_core)]

#[cfg(feature = "std")]
extern crate std;

mod device;
mod frames;
mod link;
mod settings;
mod stuck;
#[cfg(feature = "std")]
mod writer;

pub use device::{Device, Plan, Timed};
pub use frames::{CanFrame, CanFrames, SerialFrame, SerialFrames};
pub use link::{Link, LinkFaults, LinkFrame};
pub use settings::{ActuatorKind, BadSetting, Settings};
pub use stuck::Stuck;
#[cfg(feature = "std")]
pub use writer::{packets, write_stream};
