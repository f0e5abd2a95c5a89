//! Controllers of real actuators: a rate limit behind the logged setpoint, a filtered speed, and delay.

/// Effects of the controller.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ControllerEffects {
    /// Largest rate of the position setpoint, rad/s at the output; 0 without limit.
    pub setpoint_rate: f64,
    /// Largest rate of the speed setpoint, rad/s² at the motor; 0 without limit.
    pub speed_setpoint_rate: f64,
    /// Cut-off frequency of the first-order filter behind the differenced resolver angle, Hz; 0 for the true speed.
    pub speed_filter: f64,
    /// Whole control periods between measurement and current reference.
    pub delay: f64,
}
