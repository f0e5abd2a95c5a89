//! The monitor with longer control periods and steps: a fifth of the work, for a start near the end of the search.
//!
//! Its friction is up to 0.08 off, every other component less: far inside the valley that the monitor itself has there.

use ema_models::ActuatorParams;

/// Control periods in one at most: half a millisecond at 100 µs, two steps of the monitor for each.
const PERIODS_MAX: u32 = 5;

/// The actuator with as many control periods in one as divide its sample period.
pub(crate) fn coarse_in_time(params: &ActuatorParams) -> ActuatorParams {
    let controls = libm::round(1.0 / (params.sensors.sample_rate * params.controller.period)) as u32;
    let periods = (1..=PERIODS_MAX)
        .rev()
        .find(|periods| controls.is_multiple_of(*periods));
    let mut coarse = *params;
    coarse.controller.period *= f64::from(periods.unwrap_or(1));
    coarse
}
