//! A simulated actuator with its electronics: input is a [`Plan`] with [`LinkFaults`], output are timed frames.
//!
//! Controller, motor, transmission, sensors and sampling come from `ema-models`, packets and frames from `ema-wire`; the
//! link between device and receiver loses, repeats, reorders, damages and delays frames by a seed.
//!
//! ```text
//! Device ─ Timed<SerialPacket> ─ StuckSensors ─ SerialFrames ┐
//!                                             └ CanFrames ───┴ Link ─> frames as received
//! ```
//!
//! Each stage is an iterator over the one before. The frames are a pure function of plan, link faults and seed: the library
//! has neither clock nor I/O, which are the caller's. Without feature `std` it does not allocate, and the same source runs on
//! a microcontroller; `std` adds [`write_stream`] and the host program.
#![no_std]
#![warn(clippy::std_instead_of_core, clippy::alloc_instead_of_core)]

#[cfg(feature = "std")]
extern crate std;

mod device;
mod frames;
mod link;
mod settings;
mod stuck_sensors;
#[cfg(feature = "std")]
mod writer;

pub use device::{Device, Plan, Timed, encode};
pub use frames::{CanFrame, CanFrames, SerialFrame, SerialFrames};
pub use link::{Link, LinkFaults, LinkFrame};
pub use settings::{ActuatorKind, BadSetting, Settings};
pub use stuck_sensors::StuckSensors;
#[cfg(feature = "std")]
pub use writer::{packets, write_stream};
