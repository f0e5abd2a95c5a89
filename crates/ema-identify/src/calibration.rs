//! Calibration of the monitor for one type of actuator.
//!
//! [`Mismatch`] says how wrong the calibrated monitor still is at one sample rate: all that an identification needs beside
//! the monitor's coefficients. `TypeCalibration` (with `std`) holds a type's coefficients and its tables for several sample
//! rates as TOML, and has the built-in types' own.

mod mismatch;
#[cfg(feature = "std")]
mod type_calibration;

#[cfg(feature = "std")]
pub use mismatch::NoiseBeside;
pub use mismatch::{Mismatch, SignalTable};
#[cfg(feature = "std")]
pub use type_calibration::{CALIBRATION_VERSION, CalibrationError, MonitorForm, Quality, TypeCalibration};
