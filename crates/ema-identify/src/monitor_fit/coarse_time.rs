//! The monitor with longer control periods and steps: a fifth of the work.
//!
//! Its friction is up to 0.08 off, every other component less: far inside the valley that the monitor itself has there. Its derivatives
//! hardly differ, so that descents to the end have the derivatives of coarse time and the residuals of fine time: they end where these
//! residuals are orthogonal to those derivatives.

use ema_models::{ActuatorParams, TURN_MAX};

/// Control periods in one at most: half a millisecond at 100 µs, two steps of the monitor for each.
const PERIODS_MAX: u32 = 5;

/// Steps in which a window's monitors run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Time {
    /// The actuator's control periods.
    Fine,
    /// Up to five of them in one.
    Coarse,
    /// Costs and residuals of fine time, derivatives of coarse time.
    Both,
}

/// Control periods in one that divide a sample period, in whose steps of half a period the motor turns by at most [`TURN_MAX`].
pub(super) fn periods(params: &ActuatorParams) -> u32 {
    let controls = libm::round(1.0 / (params.sensors.sample_rate * params.controller.period)) as u32;
    let turn = 0.5 * params.turn_per_control();
    let is_possible = |periods: &u32| controls.is_multiple_of(*periods) && f64::from(*periods) * turn <= TURN_MAX;
    (1..=PERIODS_MAX).rev().find(is_possible).unwrap_or(1)
}

/// The actuator with several control periods in one.
pub(crate) fn coarse_in_time(params: &ActuatorParams) -> ActuatorParams {
    let mut coarse = *params;
    coarse.controller.period *= f64::from(periods(params));
    coarse
}
