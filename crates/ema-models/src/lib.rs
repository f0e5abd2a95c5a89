//! Two models of an electromechanical actuator (PMSM, gearbox, position loop) and what they share.
//!
//! - [`params`](ActuatorParams), [`fault`](FaultVector): what is known of a type, and what may be worn.
//! - `frames`, `winding`, `friction`, `backlash`, `control`, `command`: one source for each law, used by both models.
//! - `monitor`: the low-fidelity [`Monitor`], `no_std`, without allocation, generic over the number type [`Real`].
//! - `reference`, behind the feature of that name: the high-fidelity three-phase switched actuator, in plain `f64`.
//!
//! Nothing here needs the standard library or allocates; feature `std` lets the monitor choose its instruction set.
//!
//! \[P\] in the documentation is the paper the method comes from; see `docs/references.md`.
#![no_std]
#![warn(clippy::std_instead_of_core, clippy::alloc_instead_of_core)]

#[cfg(feature = "std")]
extern crate std;

mod backlash;
mod command;
mod control;
mod dispatch;
mod fault;
mod frames;
mod friction;
mod lanes;
mod monitor;
mod params;
mod play;
mod real;
mod recording;
#[cfg(feature = "reference")]
pub mod reference;
mod residual;
mod samples;
#[cfg(all(feature = "std", target_arch = "x86_64"))]
mod simd;
mod step_response;
mod temperature;
mod unknowns;
mod winding;

pub use backlash::follow_through_play;
pub use command::Profile;
pub use control::{Ace, AceState, Encoder, Setpoint};
pub use dispatch::InstructionSet;
pub use fault::{FAULT_COUNT, FaultVector, eq15_pct, rss_pct, wrapped_phase_difference};
pub use frames::{
    abc_from_alpha_beta, alpha_beta_from_abc, alpha_beta_from_dq, dq_from_abc, dq_from_alpha_beta, phase_shapes,
};
pub use friction::DryFriction;
pub use lanes::{Lanes32, Lanes64, Mask32, Mask64, RANK_LANES};
#[cfg(feature = "study")]
pub use monitor::study;
pub use monitor::{
    Calibration, Conditions, Feedback, Form, Monitor, MonitorState, Output, RIPPLE_KNOTS, RIPPLE_PLACES, Ripple,
    STEPS_PER_CONTROL, output_read,
};
pub use params::{
    ActuatorParams, ControllerParams, Expected, MotorParams, ParamsError, REFERENCE_STEP, SensorParams,
    TransmissionParams,
};
pub use play::{OutputReader, Reading};
pub use real::Real;
pub use recording::{Recording, WindowFrame, prepare};
pub use residual::{COST_LANES, Comparison, NormalEquations, Prior, ResidualState, SIGNAL_COUNT, Signals, Weights};
pub use samples::{ComparedSample, InitialState, Origin, SensedSample};
pub use step_response::{StepResponse, StepTrial};
pub use temperature::{BACK_EMF_PER_KELVIN, REFERENCE_TEMPERATURE_DEG_C, RESISTANCE_PER_KELVIN, temperature_factors};
pub use unknowns::{
    Coordinates, LOAD_COORDINATE, MOTOR_COORDINATES, MotorDeviation, MotorKnowledge, Scale, UNKNOWN_COUNT, Unknowns,
};
pub use winding::{DerivedShape, PaperShape, Winding, derived_shape};
