//! Two models of an electromechanical actuator (PMSM, gearbox, position loop), and the comparison of one with measurements.
//!
//! Input are the parameters of an actuator type ([`ActuatorParams`]), a fault vector ([`FaultVector`]) and a window of samples
//! ([`SensedSample`]); output are the signals of the models, and residuals, costs and derivatives of the monitor.
//!
//! | module | content |
//! |---|---|
//! | `params`, `tolerances`, `drive`, `temperature` | motor, transmission, controller, sensors; how well they are known; power electronics; effect of the winding temperature |
//! | `fault`, `unknowns` | the fault vector and the faults; all unknowns of a window as coordinates |
//! | `frames`, `winding`, `friction`, `backlash`, `control`, `command` | the laws that both models share, each in one place |
//! | `monitor` | [`Monitor`], the low-fidelity model, generic over the number type |
//! | `reference` | the high-fidelity three-phase switched actuator, in `f64` (feature `reference`) |
//! | `samples`, `recording`, `output_angle` | samples of a window, and their preparation for the comparison |
//! | `signals`, `residual`, `prior`, `comparison` | the compared signals; residuals of a monitor; what is known beforehand; [`Comparison`]: costs and normal equations of the monitor over a window |
//! | `variants` | residuals of monitors that differ in parameters and disturbance torques, side by side |
//! | `step_response` | [`StepTrial`]: the response of a worn actuator to a step |
//! | `real`, `lanes`, `simd`, `dispatch` | the number types: `f64`, `f32`, arrays and vector registers |
//!
//! The crate neither needs the standard library nor allocates. Feature `std` selects the instruction set at run time.
//!
//! \[P\] in the documentation is the paper with the method; see `docs/references.md`.
#![no_std]
#![warn(clippy::std_instead_of_core, clippy::alloc_instead_of_core)]

#[cfg(feature = "std")]
extern crate std;

mod backlash;
mod command;
mod comparison;
mod control;
mod dispatch;
mod drive;
mod fault;
mod frames;
mod friction;
mod lanes;
mod monitor;
mod output_angle;
mod params;
mod prior;
mod real;
mod recording;
#[cfg(feature = "reference")]
pub mod reference;
mod residual;
mod samples;
mod signals;
#[cfg(all(feature = "std", target_arch = "x86_64"))]
mod simd;
mod step_response;
mod temperature;
mod tolerances;
mod unknowns;
mod variants;
mod winding;

pub use backlash::follow_through_play;
pub use command::Profile;
pub use comparison::{COST_LANES, Comparison};
pub use control::{Ace, AceState, Encoder, Setpoint};
pub use dispatch::InstructionSet;
pub use drive::{DriveKind, DriveParams};
pub use fault::{FAULT_COUNT, FaultId, FaultVector, eq15_pct, rss_pct, wrapped_phase_difference};
pub use frames::{
    abc_from_alpha_beta, alpha_beta_from_abc, alpha_beta_from_dq, dq_from_abc, dq_from_alpha_beta, phase_shapes,
};
pub use friction::DryFriction;
pub use lanes::{Lanes32, Lanes64, Mask32, Mask64, RANK_LANES};
#[cfg(feature = "study")]
pub use monitor::study;
pub use monitor::{
    Calibration, Conditions, Feedback, Form, Monitor, MonitorState, Output, RIPPLE_KNOTS, RIPPLE_VOLTAGES, Ripple,
    STEPS_PER_CONTROL, TURN_MAX, output_angle_between, steps_per_control,
};
pub use output_angle::{AngleReading, OutputAngleEstimator};
pub use params::{
    ActuatorParams, ControllerParams, Expected, MotorParams, ParamsError, REFERENCE_STEP, SensorParams,
    TransmissionParams,
};
pub use prior::{NormalEquations, Prior};
pub use real::Real;
pub use recording::{Recording, WindowFrame, number_of_counts, prepare_window};
pub use residual::{ResidualState, speed_span};
pub use samples::{ComparedSample, InitialState, Origin, SensedSample};
pub use signals::{SIGNAL_COUNT, Signals, Weights};
pub use step_response::{StepResponse, StepTrial};
pub use temperature::{BACK_EMF_PER_KELVIN, REFERENCE_TEMPERATURE_DEG_C, RESISTANCE_PER_KELVIN, temperature_factors};
pub use tolerances::{FRICTION_TEMPERATURE_SPAN_K, Tolerances};
pub use unknowns::{
    Coordinates, LOAD_COORDINATE, MOTOR_COORDINATES, MotorDeviation, MotorKnowledge, Scale, UNKNOWN_COUNT, Unknowns,
};
pub use variants::{
    DISTURBANCE_COUNT, Disturbances, GRAM_COLUMNS, Gram, GramRow, LOAD_CHANGE_COUNT, LaneResiduals, MonitorVariant,
    ShaftSizes, ShaftTorques, add_gram,
};
pub use winding::{DerivedShape, PaperShape, Winding, derived_shape};
