//! Section `[type.NAME.specification]`: what an actuator must still do when it is worn.

use ema_models::ActuatorParams;
use serde::Serialize;

use super::ConfigError;
use super::reader::Section;

/// Requirements of a type, each off at 0. They are checked on a step of the position setpoint.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Specification {
    /// The step, rad at the output.
    pub step_rad: f64,
    /// Load against it, Nm at the output.
    pub load_nm: f64,
    /// Least speed that the output must reach, rad/s.
    pub slew_rate_min_rad_s: f64,
    /// Longest time until the output stays within 5 % of the step, s.
    pub response_time_max_s: f64,
    /// Largest error that may remain, rad at the output.
    pub steady_error_max_rad: f64,
    /// Load against which the output must still get half way, Nm.
    pub stall_load_nm: f64,
}

/// Longest time that the step may take at the largest speed, s: the functional check simulates twice that.
const MOTION_MAX_S: f64 = 10.0;

impl Default for Specification {
    fn default() -> Self {
        Self {
            step_rad: 0.1,
            load_nm: 0.0,
            slew_rate_min_rad_s: 0.0,
            response_time_max_s: 0.0,
            steady_error_max_rad: 0.0,
            stall_load_nm: 0.0,
        }
    }
}

impl Specification {
    pub(super) const KEYS: &[&str] = &[
        "step_rad",
        "load_nm",
        "slew_rate_min_rad_s",
        "response_time_max_s",
        "steady_error_max_rad",
        "stall_load_nm",
    ];

    pub(super) fn read(section: &Section<'_>, params: &ActuatorParams) -> Result<Self, ConfigError> {
        let default = Self::default();
        let found = Self {
            step_rad: section.number("step_rad", default.step_rad, 1e-4..=10.0)?,
            load_nm: section.number("load_nm", default.load_nm, 0.0..=1e5)?,
            slew_rate_min_rad_s: section.number("slew_rate_min_rad_s", default.slew_rate_min_rad_s, 0.0..=1e3)?,
            response_time_max_s: section.number("response_time_max_s", default.response_time_max_s, 0.0..=10.0)?,
            steady_error_max_rad: section.number("steady_error_max_rad", default.steady_error_max_rad, 0.0..=10.0)?,
            stall_load_nm: section.number("stall_load_nm", default.stall_load_nm, 0.0..=1e5)?,
        };
        if found.is_set() && found.motion_s(params) > MOTION_MAX_S {
            let step_max_rad = found.step_rad * MOTION_MAX_S / found.motion_s(params);
            return Err(section.refuse(
                "step_rad",
                &format!("at most {step_max_rad:.3} rad, {MOTION_MAX_S} s of motion at speed_max_rad_s"),
            ));
        }
        Ok(found)
    }

    /// Time that the step takes at the largest speed, s.
    #[must_use]
    pub fn motion_s(&self, params: &ActuatorParams) -> f64 {
        self.step_rad * params.transmission.gear_ratio / params.controller.omega_max
    }

    /// Whether anything is required.
    #[must_use]
    pub fn is_set(&self) -> bool {
        self.slew_rate_min_rad_s + self.response_time_max_s + self.steady_error_max_rad + self.stall_load_nm > 0.0
    }
}
