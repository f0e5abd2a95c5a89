//! Frames of an electromechanical actuator on CAN, CAN FD and a serial line: parsed into samples, and emitted from them.
//!
//! Samples hold the raw integers of the wire (`i_a_ma`, `motor_counts`); [`quantity`] converts them to SI units. The crate
//! neither reads a clock nor allocates: receive stamps are arguments, buffers belong to the caller, every state is bounded.
//!
//! ```text
//!  sensors ─ quantity ─> Sample ─ Sample::to_frames ──────> Currents, Position, Command ─> CAN, 8 bytes each
//!                          │    ─ SampleFd::from_samples ─> SampleFd ─────────────────────> CAN FD, 64 bytes
//!                          └─── ─ SerialPacket::emit ─────> COBS(postcard + CRC-32) ──────> serial line
//!  CAN ──── Frame::parse ──> Frame ─ Assembler::push ──> Sample ─ unwrap_*, quantity ─> SI units, i64 counters
//!  serial ─ Deframer::push ─> SerialPacket ─ Assembler::push_sample ─┘
//! ```
//!
//! | module | content |
//! |---|---|
//! | [`can`] | identifiers, the five messages, [`can::Frame`] with `parse` and `emit` |
//! | [`sample`] | [`Sample`]: all quantities latched at one instant |
//! | [`assembler`] | [`Assembler`]: joins frames into samples, never frames of two instants |
//! | [`serial`] | [`serial::SerialPacket`]; [`serial::Splitter`] and [`serial::Deframer`] find packets in a byte stream |
//! | [`quantity`] | LSB of every quantity, saturating conversions |
//! | [`unwrap`] | counters that wrap on the wire, continued as `i64` |
//! | [`bus_load`] | share of a bus or serial line that a number of actuators takes |
//!
//! `docs/can.md` has the same dictionary as a table, `fixtures/ema.dbc` as a DBC file.
//!
//! The `std` feature does not change the interface. It exists so that every crate of the workspace has the same two build
//! shapes.
#![no_std]
#![warn(clippy::std_instead_of_core, clippy::alloc_instead_of_core)]

#[cfg(feature = "std")]
extern crate std;

pub mod assembler;
pub mod bus_load;
pub mod can;
mod cobs;
pub mod quantity;
pub mod sample;
pub mod serial;
pub mod unwrap;

pub use assembler::{Assembler, AssemblerStats, Samples};
pub use can::{BatchError, Command, Currents, FdSlot, Frame, Message, ParseError, Position, SampleFd, Status};
pub use sample::{ActuatorId, ActuatorIdError, Mode, Sample};
pub use serial::{Deframer, DeframerStats, FrameError, SerialPacket, Splitter};
pub use unwrap::{unwrap_motor_counts, unwrap_output_counts, unwrap_seq, unwrap_time_us};
