//! Samples of one actuation window: as the sensors deliver them, and in the monitor's terms with the window's initial state.

use crate::control::Setpoint;

/// One sample as the sensors deliver it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensedSample {
    /// Number of the sample, whose time is t₀ + seq / f_s.
    pub seq: u64,
    /// Phase currents, A.
    pub currents: [f64; 3],
    /// Motor resolver, counts, multi-turn.
    pub motor_counts: i64,
    /// Output encoder, counts, multi-turn.
    pub output_counts: i64,
    /// Setpoint latched with the sample.
    pub setpoint: Setpoint,
}

/// One sample in the quantities of the monitor. Angles are relative to the window's [`Origin`], at the middle of their count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComparedSample {
    /// Direct current, A.
    pub i_d: f64,
    /// Quadrature current, A.
    pub i_q: f64,
    /// Motor angle, rad.
    pub theta_m: f64,
    /// Motor speed, rad/s: central difference of the angle.
    pub omega_m: f64,
    /// Output angle, rad.
    pub theta_out: f64,
    /// Change of the motor angle per sample, rad: half the difference of the two neighbouring samples.
    pub theta_m_change: f64,
    /// Estimated output angle within its count, rad; input of the monitor's position loop.
    pub theta_out_estimate: f64,
    /// Setpoint; in position mode relative to the output's origin.
    pub setpoint: Setpoint,
    /// Whether the sample was measured. A sample that was filled in drives the monitor but has no residual.
    pub measured: bool,
}

impl Default for ComparedSample {
    fn default() -> Self {
        Self {
            i_d: 0.0,
            i_q: 0.0,
            theta_m: 0.0,
            omega_m: 0.0,
            theta_out: 0.0,
            theta_m_change: 0.0,
            theta_out_estimate: 0.0,
            setpoint: Setpoint::Idle,
            measured: false,
        }
    }
}

/// Origin of a window's relative angles, which keeps them small enough for `f32`.
///
/// The output's origin is a whole encoder count, so that relative and absolute angles have the same counts.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Origin {
    /// Electrical angle at the motor's origin, rad.
    pub theta_e: f64,
    /// Output angle at the centre of the backlash at the motor's origin, rad.
    pub play_centre: f64,
}

/// Measured state at the start of a window, relative to its [`Origin`].
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct InitialState {
    /// Origin of the relative angles.
    pub origin: Origin,
    /// Motor angle, rad.
    pub theta_m: f64,
    /// Motor speed, rad/s.
    pub omega_m: f64,
    /// Direct and quadrature current, A; the integral of the speed loop starts at the torque of the latter.
    pub i_dq: [f64; 2],
    /// Backlash that explains the output counts of the window best, as the fault parameter k2; it has no part in the state.
    pub backlash: f64,
}
