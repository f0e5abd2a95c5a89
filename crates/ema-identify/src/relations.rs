//! Relations between measured signals: an actuator's faults from least squares, without a model of its drive.
//!
//! Currents, motor angle, output angle and set point are measured, so the actuator falls apart into relations between
//! measured signals. Each fault lives in one of them, and each is linear in nearly everything:
//!
//! | file | relation | faults |
//! |---|---|---|
//! | `terms`, `free_rows`, `torque_balance` | torque balance of the motor shaft | friction, shorts, eccentricity |
//! | `controller` | differentiated PI law of the speed loop | controller gain |
//! | `transmission` | output angle behind a play | backlash |
//!
//! `type_balance` is the torque balance with the numbers of the type, with which a search begins. `setpoint_delay` is when the set point takes effect. `shorted_loop` is the current of shorted turns. `shared` names what all windows of a unit have in common, `commission` learns it.
//!
//! In goes a window of samples ([`MeasuredWindow`]) of a unit that was commissioned ([`CommissionedRelations`], learnt from
//! healthy windows); out comes a [`RelationsEstimate`]: each fault parameter as the change since commissioning with its
//! standard deviation, or what the window would have needed to show it, and whether each relation explains the window
//! (`residual`). The windows are streamed through the kernel (`kernel`, `sliding`) into normal equations of fixed size; nothing
//! allocates but commissioning and the noise of a window (`measurement_noise`), which have feature `std`.
//!
//! A compliant transmission is a part of the kernel (`compliance`), found in commissioning (`compliance_search`). Measured accuracy and what
//! is left out: `docs/design/relations.md`.

mod balance_coefficients;
mod balance_shape;
mod baseline;
mod between_samples;
mod change;
#[cfg(feature = "std")]
mod commission;
mod commissioned;
mod compliance;
#[cfg(feature = "std")]
mod compliance_search;
mod controller;
mod current_noise;
#[cfg(feature = "std")]
mod curves;
mod elements;
mod flanks;
mod free_coefficients;
mod free_rows;
mod gear_loss;
mod hidden_torque;
mod jackknife;
mod kept;
mod kernel;
mod measured;
#[cfg(feature = "std")]
mod measurement_noise;
#[cfg(feature = "std")]
mod noise_change;
mod normal_equations;
mod output_load;
mod overlap;
mod residual;
mod sample_reading;
mod setpoint_delay;
mod shared;
mod shorted_loop;
mod sliding;
mod terms;
mod torque_balance;
mod transmission;
mod type_balance;

pub use balance_coefficients::BalanceCoefficients;
pub use balance_shape::BalanceShape;
pub use baseline::Baseline;
pub use between_samples::{coarse_torque_error, is_coarsely_sampled};
#[cfg(feature = "std")]
pub use commission::{CommissionError, commission, commission_as};
pub use commissioned::{CommissionedRelations, RelationsEstimate};
pub use compliance::Compliance;
#[cfg(feature = "std")]
pub use curves::{Curve, CurvePoint};
pub use elements::{ELEMENT_COUNT, Element, Needed, Reading};
pub use gear_loss::{Directions, GearLossSigma};
pub use kernel::Kernel;
pub use measured::{MeasuredWindow, SinceCommissioning, WindingTemp};
#[cfg(feature = "std")]
pub use noise_change::{MeasurementNoise, NoiseChange};
pub use residual::{HealthyResidual, RELATION_COUNT, Relation};
pub use setpoint_delay::{SetpointDelay, setpoint_delay};
#[cfg(feature = "std")]
pub use shared::FRICTION_MIN_SHARE;
pub use shared::SHARED_COUNT;
pub use terms::{TERM_COUNT, Term};
pub(crate) use type_balance::{ByTypeBalance, by_type_balance};
