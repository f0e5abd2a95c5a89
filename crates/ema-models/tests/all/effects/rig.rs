//! One actuator with effects, its state, and what several tests measure on it.

use core::f64::consts::TAU;
use ema_models::reference::{DetailedReference, DetailedState, Effects};
use ema_models::{ActuatorParams, FaultVector, Real, Setpoint, dq_from_abc};

pub(super) const DT: f64 = 1e-6;

/// Effects with these values.
pub(super) fn effects(values: &[(&str, f64)]) -> Effects {
    let mut effects = Effects::default();
    for &(name, value) in values {
        effects.set(name, value).unwrap();
    }
    effects
}

pub(super) struct Rig {
    pub(super) plant: DetailedReference,
    pub(super) state: DetailedState,
    pub(super) pole_pairs: f64,
    pub(super) params: ActuatorParams,
}

impl Rig {
    /// A healthy actuator at the motor angle 0.3 rad.
    pub(super) fn new(params: &ActuatorParams, values: &[(&str, f64)]) -> Self {
        Self::with_fault(params, &FaultVector::NOMINAL, 0.3, values)
    }

    pub(super) fn with_fault(
        params: &ActuatorParams,
        fault: &FaultVector,
        theta_m: f64,
        values: &[(&str, f64)],
    ) -> Self {
        let n = params.transmission.gear_ratio;
        Self {
            plant: DetailedReference::new(params, params, fault, 0.0, 20.0, &effects(values)),
            state: DetailedState::at_rest(theta_m, theta_m / n, n),
            pole_pairs: params.motor.pole_pairs,
            params: *params,
        }
    }

    /// Runs for `duration` seconds and calls `visit` with the state before and after each step.
    pub(super) fn run(
        &mut self,
        duration: f64,
        setpoint: Setpoint,
        mut visit: impl FnMut(&DetailedState, &DetailedState),
    ) {
        for _ in 0..(duration / DT).round() as u64 {
            let before = self.state;
            self.plant.step(&mut self.state, setpoint);
            visit(&before, &self.state);
        }
    }

    pub(super) fn settle(&mut self, duration: f64, setpoint: Setpoint) {
        self.run(duration, setpoint, |_, _| ());
    }

    /// Mean of a quantity over `duration` seconds.
    pub(super) fn mean(&mut self, duration: f64, setpoint: Setpoint, value: impl Fn(&DetailedState) -> f64) -> f64 {
        let (mut sum, mut n) = (0.0, 0.0);
        self.run(duration, setpoint, |s, _| {
            sum += value(s);
            n += 1.0;
        });
        sum / n
    }

    /// `[i_d, i_q]` of a state.
    pub(super) fn dq(&self, state: &DetailedState) -> [f64; 2] {
        dq_from_abc(state.shaft.i, (self.pole_pairs * state.shaft.theta_m).sin_cos_poly())
    }

    /// The speed setpoint at which a controller without integral part commands a current, A, at a speed, rad/s.
    pub(super) fn for_current(&self, i_q: f64, omega: f64) -> Setpoint {
        Setpoint::Speed(omega + i_q * self.params.motor.torque_gain() / self.params.controller.k_p)
    }
}

/// `bench` without integral part of the speed loop, whose current reference is proportional to the speed error.
pub(super) fn proportional() -> ActuatorParams {
    let mut params = ActuatorParams::bench();
    params.controller.k_i = 0.0;
    params
}

/// The same with a rotor that no torque turns.
pub(super) fn locked() -> ActuatorParams {
    let mut params = proportional();
    params.transmission.friction_static = 1e3;
    params
}

/// The same with a flywheel, which keeps its speed.
pub(super) fn flywheel() -> ActuatorParams {
    let mut params = without_friction(proportional());
    params.motor.j = 1e6;
    params
}

/// A motor whose currents give no torque, on a shaft without friction, play and gear loss.
pub(super) fn coasting() -> ActuatorParams {
    let mut params = without_friction(proportional());
    params.motor.k = 1e-9;
    params
}

fn without_friction(mut params: ActuatorParams) -> ActuatorParams {
    params.motor.c = 0.0;
    params.transmission.friction_dynamic = 0.0;
    params.transmission.friction_static = 0.0;
    params.transmission.backlash = 0.0;
    params.transmission.efficiency_opposing = 1.0;
    params.transmission.efficiency_aiding = 1.0;
    params
}

/// Complex amplitude `[re, im]` of a series at `cycles` whole cycles over its length: `x = re cos + im sin`.
pub(super) fn phasor(series: &[f64], cycles: f64) -> [f64; 2] {
    let n = series.len() as f64;
    let (mut re, mut im) = (0.0, 0.0);
    for (k, x) in series.iter().enumerate() {
        let (s, c) = (TAU * cycles * k as f64 / n).sin_cos();
        re += 2.0 / n * x * c;
        im += 2.0 / n * x * s;
    }
    [re, im]
}

pub(super) fn close(got: f64, expected: f64, tolerance: f64, what: &str) {
    assert!(
        (got - expected).abs() <= tolerance,
        "{what}: {got}, expected {expected} ± {tolerance}"
    );
}
