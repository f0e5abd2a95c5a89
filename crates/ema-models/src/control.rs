//! Actuator control electronics (ACE): position loop, speed loop with PID, torque and current limit.
//!
//! Shared by reference and monitor. The current loop behind it differs between them and is not here.

use crate::params::{ActuatorParams, ControllerParams};
use crate::real::Real;

/// What the ACE is told to do.
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

/// Output encoder as the electronics read it: whole counts, rounded down.
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
    /// An encoder whose count is `lsb`, rad.
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

    /// Lower edge of the count whose middle is `theta`, rad.
    #[inline(always)]
    pub fn edge(&self, theta: f64) -> R {
        R::splat(theta) - R::splat(0.5) * self.lsb
    }

    /// The angle as counted, rad: `floor(theta / lsb) lsb`.
    #[inline(always)]
    pub fn counted(&self, theta: R) -> R {
        (theta * self.counts_per_rad).floor() * self.lsb
    }
}

/// So steep that the integrator is frozen or free, 1/Nm.
const AT_ONCE: f64 = 1e12;

/// The control law's constants; the position gain carries the fault k8.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ace<R> {
    g_p: R,
    k_p: R,
    k_i_dt: R,
    k_d_over_dt: R,
    omega_max: R,
    torque_max: R,
    amps_per_torque: R,
    /// One over the torque across which the integrator freezes, 1/Nm.
    per_freeze: R,
}

/// What the control law remembers from one period to the next.
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
            per_freeze: f(self.per_freeze),
        }
    }
}

impl<R: Real> Ace<R> {
    /// The controller of an actuator; `gain_factor` is that of the fault vector, `0.5 + k8`.
    ///
    /// The torque gain is the nominal one, whatever the motor's own k.
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
            per_freeze: R::splat(AT_ONCE),
        }
    }

    /// The same law, smooth in everything that moves the instant at which the torque saturates: the integrator freezes
    /// across the torque by which the demand changes in one period under full torque, `K_P Δt T_max / J`.
    ///
    /// The firmware freezes it for whole periods. One period sooner or later is a step of the window's cost, and a search
    /// may end on its wrong side. Derived here.
    #[must_use]
    pub fn freezing_gradually(self, params: &ActuatorParams) -> Self {
        let ControllerParams { period, k_p, .. } = params.controller;
        let change = k_p * period / params.motor.j;
        Self {
            per_freeze: R::splat(1.0 / change) / self.torque_max,
            ..self
        }
    }

    /// Memory of a controller that, in a steady state, asks for the given torque, Nm.
    #[inline(always)]
    pub fn steady(&self, torque: R, setpoint: Setpoint<R>, theta_out: R, omega_m: R) -> AceState<R> {
        match self.speed_error(setpoint, theta_out, omega_m) {
            Some(error) => AceState {
                integral: torque - self.k_p * error,
                previous_error: error,
            },
            None => AceState::default(),
        }
    }

    /// Error of the speed loop, rad/s; `None` while the drive is off.
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
    /// `e = θ_cmd − θ_out` with the output angle as the encoder counts it;
    /// `ω_ref = clamp(G_p (0.5 + k8) e, ±ω_max)`, in speed mode the commanded speed; PID on `ω_ref − ω_m`,
    /// the integrator frozen while the torque saturates; `T_ref = clamp(PID, ±G_T I_max)`;
    /// `I_ref = T_ref / G_T`.
    #[inline(always)]
    pub fn step(&self, state: &mut AceState<R>, setpoint: Setpoint<R>, theta_out: R, omega_m: R) -> R {
        let Some(error) = self.speed_error(setpoint, theta_out, omega_m) else {
            *state = AceState::default();
            return R::zero();
        };
        let torque = self.k_p * error + state.integral + self.k_d_over_dt * (error - state.previous_error);
        state.previous_error = error;
        let free = (R::splat(0.5) + (self.torque_max - torque.abs()) * self.per_freeze)
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
    fn a_large_error_gives_full_current_and_freezes_the_integrator() {
        let mut state = AceState::default();
        let i_ref = ace().step(&mut state, Setpoint::Position(0.25), 0.0, 0.0);
        assert!((i_ref - 10.7).abs() < 1e-12);
        assert!(state.integral.abs() < 1e-12);
    }

    #[test]
    fn freezing_gradually_is_freezing_at_once_away_from_the_limit_and_half_at_it() {
        let gradual = ace().freezing_gradually(&ActuatorParams::bench());
        // The limit is 14.445 Nm, reached at 36.1125 rad/s; the law freezes across 4 % of it.
        for (speed, share) in [(30.0, 1.0), (35.0, 1.0), (36.1125, 0.5), (37.0, 0.0), (50.0, 0.0)] {
            let mut state = AceState::default();
            gradual.step(&mut state, Setpoint::Speed(speed), 0.0, 0.0);
            let freely = 6.0 * 100e-6 * speed;
            assert!((state.integral - share * freely).abs() < 1e-9, "{speed}: {state:?}");
        }
    }

    #[test]
    fn feedback_is_counted_downwards() {
        // One part in a thousand below a whole count reads as the count before: the error is a whole count.
        let lsb = ActuatorParams::bench().sensors.output_lsb();
        let counted = Encoder::new(lsb).counted(4.999 * lsb);
        let i_ref = ace().step(&mut AceState::default(), Setpoint::Position(5.0 * lsb), counted, 0.0);
        assert!((i_ref - 0.4 * 2500.0 * lsb / 1.35).abs() < 1e-9, "{i_ref}");
    }

    #[test]
    fn the_speed_limit_is_the_position_loop_s() {
        let far = ace().step(&mut AceState::default(), Setpoint::Position(100.0), 0.0, 190.0);
        assert!((far - 0.4 * 10.0 / 1.35).abs() < 1e-12, "{far}");
        let fast = ace().step(&mut AceState::default(), Setpoint::Speed(202.0), 0.0, 190.0);
        assert!((fast - 0.4 * 12.0 / 1.35).abs() < 1e-12, "{fast}");
    }
}
