//! Actuator control electronics (ACE): position loop, speed loop with PID, torque and current limit.
//!
//! Input are setpoint, counted output angle and motor speed, output is the reference of the quadrature current. Reference and
//! monitor share this law; their current loops differ and are in their own modules.

use crate::params::{ActuatorParams, ControllerParams};
use crate::real::Real;

/// Command to the ACE.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Setpoint<T = f64> {
    /// Drive off: no current.
    #[default]
    Idle,
    /// Position mode: output angle, rad.
    Position(T),
    /// Speed mode: motor speed, rad/s.
    Speed(T),
}

impl<T> Setpoint<T> {
    /// The same setpoint in another number type.
    #[inline(always)]
    #[must_use]
    pub fn map<S>(self, f: impl FnOnce(T) -> S) -> Setpoint<S> {
        match self {
            Self::Idle => Setpoint::Idle,
            Self::Position(theta_cmd) => Setpoint::Position(f(theta_cmd)),
            Self::Speed(omega_cmd) => Setpoint::Speed(f(omega_cmd)),
        }
    }
}

/// Output encoder: angle in whole counts, rounded down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encoder<R> {
    counts_per_rad: R,
    lsb: R,
}

impl<R> Encoder<R> {
    /// The same encoder in another number type.
    #[must_use]
    pub fn map<S>(self, mut f: impl FnMut(R) -> S) -> Encoder<S> {
        Encoder {
            counts_per_rad: f(self.counts_per_rad),
            lsb: f(self.lsb),
        }
    }
}

impl<R: Real> Encoder<R> {
    /// An encoder with the angle `lsb` per count, rad.
    #[must_use]
    pub fn new(lsb: f64) -> Self {
        Self {
            counts_per_rad: R::splat(1.0 / lsb),
            lsb: R::splat(lsb),
        }
    }

    /// Angle of one count, rad.
    #[inline(always)]
    pub fn lsb(&self) -> R {
        self.lsb
    }

    /// Lower edge of the count with the middle `theta`, rad.
    #[inline(always)]
    pub fn lower_edge(&self, theta: f64) -> R {
        R::splat(theta) - R::splat(0.5) * self.lsb
    }

    /// Angle as counted, rad: `floor(theta / lsb) lsb`.
    #[inline(always)]
    pub fn counted_angle(&self, theta: R) -> R {
        (theta * self.counts_per_rad).floor() * self.lsb
    }
}

/// Slope of the integrator's share over the torque, 1/Nm, so steep that the integrator is either frozen or free.
const ABRUPT: f64 = 1e12;

/// Constants of the control law; the position gain includes the fault k8.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ace<R> {
    g_p: R,
    k_p: R,
    k_i_dt: R,
    k_d_over_dt: R,
    omega_max: R,
    torque_max: R,
    amps_per_torque: R,
    /// Reciprocal of the torque range over which the integrator goes from free to frozen, 1/Nm.
    anti_windup_slope: R,
}

/// State of the control law from one period to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AceState<R> {
    /// Integral part of the torque, Nm.
    pub integral: R,
    /// Speed error of the last period, rad/s.
    pub previous_error: R,
}

impl<R: Real> Default for AceState<R> {
    fn default() -> Self {
        Self {
            integral: R::zero(),
            previous_error: R::zero(),
        }
    }
}

impl<R> Ace<R> {
    /// The same controller in another number type, one field at a time.
    #[must_use]
    pub fn map<S>(self, mut f: impl FnMut(R) -> S) -> Ace<S> {
        Ace {
            g_p: f(self.g_p),
            k_p: f(self.k_p),
            k_i_dt: f(self.k_i_dt),
            k_d_over_dt: f(self.k_d_over_dt),
            omega_max: f(self.omega_max),
            torque_max: f(self.torque_max),
            amps_per_torque: f(self.amps_per_torque),
            anti_windup_slope: f(self.anti_windup_slope),
        }
    }
}

impl<R: Real> Ace<R> {
    /// The controller of an actuator type; `gain_factor` is [`FaultVector::gain_factor`](crate::FaultVector::gain_factor),
    /// `0.5 + k8`.
    ///
    /// The controller converts torque to current with the nominal torque gain, also if the k of the motor differs.
    #[must_use]
    pub fn new(params: &ActuatorParams, gain_factor: R) -> Self {
        let ControllerParams {
            period,
            g_p,
            k_p,
            k_i,
            k_d,
            omega_max,
            ..
        } = params.controller;
        let torque_gain = params.motor.torque_gain();
        Self {
            g_p: gain_factor * R::splat(g_p),
            k_p: R::splat(k_p),
            k_i_dt: R::splat(k_i * period),
            k_d_over_dt: R::splat(k_d / period),
            omega_max: R::splat(omega_max),
            torque_max: R::splat(torque_gain * params.motor.i_max),
            amps_per_torque: R::splat(1.0 / torque_gain),
            anti_windup_slope: R::splat(ABRUPT),
        }
    }

    /// The same law with a gradual freeze of the integrator, over the torque range by which the demand changes in one period
    /// under full torque, `K_P Δt T_max / J`.
    ///
    /// The firmware freezes the integrator for whole control periods. In the monitor, one period more or less would be a
    /// discontinuity of the window's cost, at which a search may stop. Derived here.
    #[must_use]
    pub fn with_gradual_anti_windup(self, params: &ActuatorParams) -> Self {
        let ControllerParams { period, k_p, .. } = params.controller;
        let change = k_p * period / params.motor.j;
        Self {
            anti_windup_slope: R::splat(1.0 / change) / self.torque_max,
            ..self
        }
    }

    /// State of a controller whose output is the given torque, Nm, at a constant speed error.
    #[inline(always)]
    pub fn steady_state(&self, torque: R, setpoint: Setpoint<R>, theta_out: R, omega_m: R) -> AceState<R> {
        match self.speed_error(setpoint, theta_out, omega_m) {
            Some(error) => AceState {
                integral: torque - self.k_p * error,
                previous_error: error,
            },
            None => AceState::default(),
        }
    }

    /// Control deviation of the speed loop, rad/s; `None` while the drive is off.
    #[inline(always)]
    fn speed_error(&self, setpoint: Setpoint<R>, theta_out: R, omega_m: R) -> Option<R> {
        let omega_ref = match setpoint {
            Setpoint::Idle => return None,
            Setpoint::Position(theta_cmd) => (self.g_p * (theta_cmd - theta_out)).clamp_abs(self.omega_max),
            Setpoint::Speed(omega_cmd) => omega_cmd,
        };
        Some(omega_ref - omega_m)
    }

    /// One control period: quadrature current reference I_ref, A.
    ///
    /// `e = θ_cmd − θ_out` with the output angle as counted by the encoder;
    /// `ω_ref = clamp(G_p (0.5 + k8) e, ±ω_max)`, in speed mode the commanded speed; PID on `ω_ref − ω_m`,
    /// with the integrator frozen while the torque saturates; `T_ref = clamp(PID, ±G_T I_max)`;
    /// `I_ref = T_ref / G_T`.
    #[inline(always)]
    pub fn step(&self, state: &mut AceState<R>, setpoint: Setpoint<R>, theta_out: R, omega_m: R) -> R {
        let Some(error) = self.speed_error(setpoint, theta_out, omega_m) else {
            *state = AceState::default();
            return R::zero();
        };
        let torque = self.k_p * error + state.integral + self.k_d_over_dt * (error - state.previous_error);
        state.previous_error = error;
        let free = (R::splat(0.5) + (self.torque_max - torque.abs()) * self.anti_windup_slope)
            .max(R::zero())
            .min(R::splat(1.0));
        state.integral = state.integral + free * (self.k_i_dt * error);
        torque.clamp_abs(self.torque_max) * self.amps_per_torque
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ace() -> Ace<f64> {
        Ace::new(&ActuatorParams::bench(), 1.0)
    }

    #[test]
    fn a_large_deviation_gives_full_current_and_freezes_the_integrator() {
        let mut state = AceState::default();
        let i_ref = ace().step(&mut state, Setpoint::Position(0.25), 0.0, 0.0);
        assert!((i_ref - 10.7).abs() < 1e-12);
        assert!(state.integral.abs() < 1e-12);
    }

    #[test]
    fn gradual_anti_windup_equals_the_abrupt_one_away_from_the_limit_and_is_half_at_it() {
        let gradual = ace().with_gradual_anti_windup(&ActuatorParams::bench());
        // The limit is 14.445 Nm, reached at 36.1125 rad/s; the integrator freezes over 4 % of it.
        for (speed, share) in [(30.0, 1.0), (35.0, 1.0), (36.1125, 0.5), (37.0, 0.0), (50.0, 0.0)] {
            let mut state = AceState::default();
            gradual.step(&mut state, Setpoint::Speed(speed), 0.0, 0.0);
            let free = 6.0 * 100e-6 * speed;
            assert!((state.integral - share * free).abs() < 1e-9, "{speed}: {state:?}");
        }
    }

    #[test]
    fn the_counted_angle_is_rounded_down() {
        // An angle of 4.999 counts is counted as 4, so the deviation from 5 counts is one count.
        let lsb = ActuatorParams::bench().sensors.output_lsb();
        let counted = Encoder::new(lsb).counted_angle(4.999 * lsb);
        let i_ref = ace().step(&mut AceState::default(), Setpoint::Position(5.0 * lsb), counted, 0.0);
        assert!((i_ref - 0.4 * 2500.0 * lsb / 1.35).abs() < 1e-9, "{i_ref}");
    }

    #[test]
    fn the_speed_limit_applies_to_the_position_loop_only() {
        let far = ace().step(&mut AceState::default(), Setpoint::Position(100.0), 0.0, 190.0);
        assert!((far - 0.4 * 10.0 / 1.35).abs() < 1e-12, "{far}");
        let fast = ace().step(&mut AceState::default(), Setpoint::Speed(202.0), 0.0, 190.0);
        assert!((fast - 0.4 * 12.0 / 1.35).abs() < 1e-12, "{fast}");
    }
}
