//! Section `[type.NAME.specification]`: what an actuator must still do when it is worn.

use serde::Serialize;

use super::ConfigError;
use super::reader::Section;

/// Requirements of a type, each off at 0. They are tried on a step of the position setpoint.
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

    pub(super) fn read(section: &Section<'_>) -> Result<Self, ConfigError> {
        let default = Self::default();
        Ok(Self {
            step_rad: section.number("step_rad", default.step_rad, 1e-4..=10.0)?,
            load_nm: section.number("load_nm", default.load_nm, 0.0..=1e5)?,
            slew_rate_min_rad_s: section.number("slew_rate_min_rad_s", default.slew_rate_min_rad_s, 0.0..=1e3)?,
            response_time_max_s: section.number("response_time_max_s", default.response_time_max_s, 0.0..=10.0)?,
            steady_error_max_rad: section.number("steady_error_max_rad", default.steady_error_max_rad, 0.0..=10.0)?,
            stall_load_nm: section.number("stall_load_nm", default.stall_load_nm, 0.0..=1e5)?,
        })
    }

    /// Whether anything is required.
    #[must_use]
    pub fn is_set(&self) -> bool {
        self.slew_rate_min_rad_s + self.response_time_max_s + self.steady_error_max_rad + self.stall_load_nm > 0.0
    }
}
