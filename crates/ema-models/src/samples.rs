//! Samples of one actuation window: as the sensors deliver them, and in the monitor's terms with the window's initial state.

use crate::control::Setpoint;

/// One sample as the sensors saw it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensedSample {
    /// Sample number since t₀; the sample stands at t₀ + seq / f_s.
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

/// One sample in the monitor's terms; angles relative to the window's [`Origin`], at the middle of their count.
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
    /// Motor angle turned per sample, rad: half the difference of the two neighbours.
    pub turning: f64,
    /// Where in its count the output angle is likely to be, rad: what drives the monitor's position loop.
    pub theta_read: f64,
    /// Setpoint, relative to the output's origin in position mode.
    pub setpoint: Setpoint,
    /// Whether it was measured; one that was filled in drives the monitor, but nothing is compared with it.
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
            turning: 0.0,
            theta_read: 0.0,
            setpoint: Setpoint::Idle,
            measured: false,
        }
    }
}

/// Where a window's relative angles start, so that they stay small enough for `f32`.
///
/// The output's origin is a whole encoder count, so that counting relative angles is counting absolute ones.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Origin {
    /// Electrical angle at the motor's origin, rad.
    pub theta_e: f64,
    /// Output angle of the play's centre at the motor's origin, rad.
    pub play_centre: f64,
}

/// Measured state at the beginning of a window, relative to its [`Origin`].
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct InitialState {
    /// Where the relative angles start.
    pub origin: Origin,
    /// Motor angle, rad.
    pub theta_m: f64,
    /// Motor speed, rad/s.
    pub omega_m: f64,
    /// Direct and quadrature current, A; the speed loop's integrator is set to the torque of the latter.
    pub i_dq: [f64; 2],
}
