//! One actuation window to one estimate of what is worn in an actuator.
//!
//! In goes a window of sensor samples around one actuation, with what is known of the actuator; out comes an [`Estimate`]:
//! the fault vector that explains the window best, how uncertain each of its parameters is, whether another vector
//! explains the window as well, and whether no vector explains it at all.
//!
//! - `monitor_fit`: fits the low-fidelity monitor of `ema-models` to a window by least squares. Everything after the cost
//!   of a point is one source for host and firmware: starts, descents, tolerances, competing optima, uncertainty. A window
//!   enters through the trait [`MonitoredWindow`]: the host's [`Comparison`](ema_models::Comparison) holds prepared samples
//!   and runs monitors in SIMD lanes, the firmware's [`StreamedWindow`] reads raw samples again on each run and stores no
//!   residual. Both compute the same bits.
//! - [`calibration`]: how wrong the calibrated monitor of a type of actuator still is, and what each signal weighs.
//! - [`relations`]: the faults of a commissioned unit with any drive, from relations between measured signals; no monitor.
//! - `std` adds the population search ahead of the descents, descents side by side, and calibrations as text
//!   ([`Identifier`], [`calibration::TypeCalibration`]). Without `std` nothing allocates.
#![no_std]
#![warn(clippy::std_instead_of_core, clippy::alloc_instead_of_core)]

#[cfg(feature = "std")]
extern crate std;

pub mod calibration;
#[cfg(feature = "std")]
mod counter_alignment;
#[cfg(feature = "std")]
pub mod effort;
mod estimate;
#[cfg(feature = "std")]
mod identifier;
#[cfg(feature = "std")]
mod inferred;
mod monitor_fit;
#[cfg(feature = "std")]
mod output_zero;
#[cfg(feature = "std")]
mod prepared;
mod recorded_sample;
pub mod relations;
#[cfg(feature = "std")]
pub mod unit_calibration;
#[cfg(feature = "std")]
pub mod unit_estimate;
#[cfg(feature = "std")]
pub mod unit_fit;
#[cfg(feature = "std")]
pub mod unit_parameters_fit;

pub use estimate::{Estimate, LOCKED, OBSERVABLE_SIGMA, Unmodelled, is_unmodelled};
#[cfg(feature = "std")]
pub use identifier::{Fit, Identifier, Method, Residuals, comparison};
#[cfg(feature = "std")]
pub use inferred::{Inferred, InferredReadings};
#[cfg(feature = "std")]
pub use monitor_fit::Population;
pub use monitor_fit::{
    ActuatorKnowledge, InTime, MAX_CONTROLS, MonitoredWindow, RecordedWindow, SampleDrive, StreamedWindow, Time,
    cramer_rao_bound, estimator_bias, identify_recorded, refined_from,
};
#[cfg(feature = "std")]
pub use output_zero::output_zero;
#[cfg(feature = "std")]
pub use prepared::Prepared;
pub use recorded_sample::RecordedSample;
