//! The laboratory: the demonstration, traffic and windows of the reference model, calibration of types, accuracy suites, benchmarks.
//!
//! Nothing here flies: the crate needs the reference model, and the flight build of `hmd` leaves it out.

pub mod bench;
pub mod calibrate_type;
pub mod demo;
pub mod drive_traffic;
pub mod effects_file;
pub mod evaluate;
pub mod recording;
pub mod simulate;
pub mod simulated;
