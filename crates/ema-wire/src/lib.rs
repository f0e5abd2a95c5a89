//! What one electromechanical actuator says on the wire, both directions.
//!
//! Raw integers stay raw (`i_a_ma`, `motor_counts`); [`quantity`] holds the scales to SI units. Nothing here reads a
//! clock or allocates: receive stamps are arguments, buffers belong to the caller, every state is bounded.
//!
//! ```text
//!  sensors ─ quantity ─> Sample ─ Sample::to_frames ──────> Currents, Position, Command ─> CAN, 8 bytes each
//!                          │    ─ SampleFd::from_samples ─> SampleFd ─────────────────────> CAN FD, 64 bytes
//!                          └─── ─ SerialPacket::emit ─────> COBS(postcard + CRC-32) ──────> serial line
//!  CAN ──── Frame::parse ──> Frame ─ Assembler::push ──> Sample ─ unwrap_*, quantity ─> SI units, i64 counters
//!  serial ─ Deframer::push ─> SerialPacket ─ Assembler::push_sample ─┘
//! ```
//!
//! | module | what is in it |
//! |---|---|
//! | [`can`] | identifiers, the five messages, [`can::Frame`] with `parse` and `emit` |
//! | [`sample`] | [`Sample`]: everything latched at one instant, split into frames |
//! | [`assembler`] | [`Assembler`]: frames back into samples, never mixing two instants |
//! | [`serial`] | [`serial::SerialPacket`]; [`serial::Splitter`] and [`serial::Deframer`] find them on the serial line |
//! | [`quantity`] | LSB of every quantity, conversions that saturate |
//! | [`unwrap`] | counters that wrap on the wire, continued as `i64` |
//! | [`bus_load`] | how full a bus will be |
//!
//! The same dictionary as a table: `docs/can.md`; as a DBC file: `fixtures/ema.dbc`.
//!
//! The `std` feature changes nothing in the interface; it exists so that every crate of the workspace has the same two
//! build shapes.
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
pub use can::{
    ActuatorId, BatchError, Command, Currents, FdSlot, Frame, Message, Mode, ParseError, Position, SampleFd, Status,
};
pub use sample::Sample;
pub use serial::{Deframer, DeframerStats, FrameFault, SerialPacket, Splitter};
pub use unwrap::{unwrap_motor_counts, unwrap_output_counts, unwrap_seq, unwrap_time_us};
