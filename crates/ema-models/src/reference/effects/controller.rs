//! Controllers of real actuators: a rate limit behind the logged setpoint, a filtered speed, and delay.

use crate::control::{Ace, AceState, Setpoint};
use crate::params::ActuatorParams;
use crate::real::Real;

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
    /// Whether the position loop is closed over the motor's angle: a drive without an encoder at the output. No effect of its own.
    pub closes_over_motor: bool,
}

/// Longest delay, control periods.
const MAX_DELAY: usize = 3;

/// Controller of one unit: the common control law with its effects.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Controller {
    ace: Ace<f64>,
    effects: ControllerEffects,
    period: f64,
    motor_lsb: f64,
    /// Output angle of a rigid gear per count of the motor, rad.
    output_per_count: f64,
    /// Weight of a new speed in the filter.
    filter_weight: f64,
    delay: usize,
}

/// State of the controller from one period to the next.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ControllerState {
    ace: AceState<f64>,
    /// Setpoint behind the rate limit.
    limited: Setpoint,
    /// Resolver count of the last period.
    motor_counts: Option<i64>,
    filtered_speed: f64,
    /// Current references that are not yet applied, oldest first.
    delayed: [f64; MAX_DELAY],
}

impl Controller {
    /// The controller with these parameters; `gain_factor` is `0.5 + k8`.
    pub(crate) fn new(params: &ActuatorParams, gain_factor: f64, effects: &ControllerEffects) -> Self {
        let period = params.controller.period;
        Self {
            ace: Ace::new(params, gain_factor),
            effects: *effects,
            period,
            motor_lsb: params.sensors.motor_lsb(),
            output_per_count: params.sensors.motor_lsb() / params.transmission.gear_ratio,
            filter_weight: 1.0 - libm::exp(-core::f64::consts::TAU * effects.speed_filter * period),
            delay: effects.delay as usize,
        }
    }

    /// One control period: the quadrature current reference that is applied from now on, A.
    ///
    /// `counted` is the output angle as the encoder counts it, rad; `motor_counts` the resolver's count; `omega_m` the speed
    /// that an unfiltered controller knows, rad/s.
    pub(crate) fn step(
        &self,
        state: &mut ControllerState,
        setpoint: Setpoint,
        counted: f64,
        motor_counts: i64,
        omega_m: f64,
    ) -> f64 {
        let counted = if self.effects.closes_over_motor {
            motor_counts as f64 * self.output_per_count
        } else {
            counted
        };
        state.limited = self.limited(state.limited, setpoint, counted, omega_m);
        let speed = self.speed(state, motor_counts, omega_m);
        let i_ref = self.ace.step(&mut state.ace, state.limited, counted, speed);
        let Some(last) = self.delay.min(MAX_DELAY).checked_sub(1) else {
            return i_ref;
        };
        let applied = state.delayed[0];
        state.delayed.copy_within(1.., 0);
        state.delayed[last] = i_ref;
        applied
    }

    /// The setpoint behind the rate limit, which begins at the measured value when the mode changes.
    fn limited(&self, previous: Setpoint, setpoint: Setpoint, counted: f64, omega_m: f64) -> Setpoint {
        let towards = |from: f64, to: f64, rate: f64| from + (to - from).clamp_abs(rate * self.period);
        let (position_rate, speed_rate) = (self.effects.setpoint_rate, self.effects.speed_setpoint_rate);
        match (setpoint, previous) {
            (Setpoint::Position(to), Setpoint::Position(from)) if position_rate > 0.0 => {
                Setpoint::Position(towards(from, to, position_rate))
            }
            (Setpoint::Position(to), _) if position_rate > 0.0 => {
                Setpoint::Position(towards(counted, to, position_rate))
            }
            (Setpoint::Speed(to), Setpoint::Speed(from)) if speed_rate > 0.0 => {
                Setpoint::Speed(towards(from, to, speed_rate))
            }
            (Setpoint::Speed(to), _) if speed_rate > 0.0 => Setpoint::Speed(towards(omega_m, to, speed_rate)),
            _ => setpoint,
        }
    }

    /// The speed that the controller knows, rad/s.
    fn speed(&self, state: &mut ControllerState, motor_counts: i64, omega_m: f64) -> f64 {
        if self.effects.speed_filter <= 0.0 {
            return omega_m;
        }
        let moved = motor_counts.saturating_sub(state.motor_counts.unwrap_or(motor_counts));
        state.motor_counts = Some(motor_counts);
        let speed = moved as f64 * self.motor_lsb / self.period;
        state.filtered_speed += self.filter_weight * (speed - state.filtered_speed);
        state.filtered_speed
    }
}
