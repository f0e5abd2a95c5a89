//! The reference model with effects: the plain model's laws, with those of [`Effects`] composed around them.
//!
//! Input and output are those of [`Reference`](super::Reference), which stays the model of a unit without effects. Each family
//! of effects has its law in its own file; this module only connects them: controller, drive, windings, shaft, sensors.

mod windings;

use self::windings::Windings;
use super::effects::{
    Cogging, Controller, ControllerState, DriveInput, Effects, FrictionCurve, LinkEffects, TwoMasses, VectorControl,
    VectorState,
};
use super::sensors::encoder_count;
use super::{ReferenceState, UnmodelledFault};
use crate::backlash::follow_through_play;
use crate::control::{Encoder, Setpoint};
use crate::fault::FaultVector;
use crate::frames::phase_shapes;
use crate::friction::DryFriction;
use crate::params::{ActuatorParams, REFERENCE_STEP, TransmissionParams};
use crate::real::Real;
use crate::winding::Winding;

/// Constants of one simulated actuator with effects.
#[derive(Clone, Debug)]
pub struct DetailedReference {
    controller: Controller,
    encoder: Encoder<f64>,
    control_steps: u64,
    half_band: f64,
    vector: Option<VectorControl>,
    link: LinkEffects,
    v_dc: f64,
    pole_pairs: f64,
    k: f64,
    winding: Winding<f64>,
    windings: Windings,
    effects: Effects,
    cogging: Cogging,
    viscous: f64,
    inertia: f64,
    two_masses: Option<TwoMasses>,
    /// Friction of the motor side; of the whole shaft where it is rigid.
    friction: FrictionCurve,
    load_friction: FrictionCurve,
    transmission: TransmissionParams,
    half_play: f64,
    load_torque: f64,
    unmodelled_fault: Option<UnmodelledFault>,
    motor_lsb: f64,
    filter_share: f64,
}

/// State of a simulated actuator with effects.
#[derive(Clone, Copy, Debug)]
pub struct DetailedState {
    /// What the plain model knows too. `v` are mean phase voltages over the last step, `torque` is that of the currents.
    pub shaft: ReferenceState,
    /// Angle of the load side at the motor shaft, n θ_out, rad; follows the motor where the shaft is rigid.
    pub load_angle: f64,
    /// Speed of the load side at the motor shaft, rad/s; that of the motor where the shaft is rigid.
    pub load_speed: f64,
    /// Currents in the shorted turns of each phase, A.
    pub i_short: [f64; 3],
    /// DC link voltage of the last step, V.
    pub link_voltage: f64,
    controller: ControllerState,
    drive: VectorState,
    link_current: f64,
    filtered: [f64; 3],
    /// Output angle at which the spring has no torque, rad.
    spring_zero: f64,
}

impl DetailedState {
    /// The state at rest, without current, at these angles, rad; the spring's zero is this output angle.
    #[must_use]
    pub fn at_rest(theta_m: f64, theta_out: f64, gear_ratio: f64) -> Self {
        Self {
            shaft: ReferenceState::at_rest(theta_m, theta_out),
            load_angle: theta_out * gear_ratio,
            load_speed: 0.0,
            i_short: [0.0; 3],
            link_voltage: 0.0,
            controller: ControllerState::default(),
            drive: VectorState::default(),
            link_current: 0.0,
            filtered: [0.0; 3],
            spring_zero: theta_out,
        }
    }
}

impl DetailedReference {
    /// An actuator with the hardware `unit` at this temperature, °C, and a controller set for `controller`; otherwise as
    /// [`Reference::new`](super::Reference::new). The deviations of `effects` are already in `unit` and `controller`.
    #[must_use]
    pub fn new(
        unit: &ActuatorParams,
        controller: &ActuatorParams,
        fault: &FaultVector,
        load_torque: f64,
        temperature_deg_c: f64,
        effects: &Effects,
    ) -> Self {
        let (m, t) = (&unit.motor, unit.transmission);
        let full_turns = FaultVector {
            short_a: 0.0,
            short_b: 0.0,
            short_c: 0.0,
            ..*fault
        };
        let [dry, viscous] = effects.friction.temperature_factors(temperature_deg_c);
        let friction = FrictionCurve::new(
            &effects.friction,
            t.friction_dynamic,
            t.friction_static,
            dry * fault.friction_factor(),
        );
        let half_play = 0.5 * t.backlash * fault.backlash_factor();
        let two_masses = TwoMasses::new(&effects.compliance, m.j, half_play * t.gear_ratio);
        let load_share = match two_masses {
            None => 0.0,
            Some(_) => effects.compliance.load_friction,
        };
        let dt_over_filter = REFERENCE_STEP * core::f64::consts::TAU * effects.sensors.current_filter;
        Self {
            controller: Controller::new(controller, fault.gain_factor(), &effects.controller),
            encoder: Encoder::new(controller.sensors.output_lsb()),
            control_steps: libm::round(controller.controller.period / REFERENCE_STEP) as u64,
            half_band: controller.controller.hysteresis,
            vector: effects
                .vector_drive()
                .map(|drive| VectorControl::new(drive, &controller.motor)),
            link: effects.link,
            v_dc: m.v_dc,
            pole_pairs: m.pole_pairs,
            k: m.k,
            winding: Winding::new(&full_turns),
            windings: Windings::new(m, fault.winding_turns_ratio(), effects),
            effects: *effects,
            cogging: effects.cogging.of_motor(m.pole_pairs),
            viscous: viscous * m.c,
            inertia: m.j,
            two_masses,
            friction: friction.share(1.0 - load_share),
            load_friction: friction.share(load_share),
            transmission: t,
            half_play,
            load_torque,
            unmodelled_fault: None,
            motor_lsb: controller.sensors.motor_lsb(),
            filter_share: 1.0 - libm::exp(-dt_over_filter),
        }
    }

    /// The actuator with a fault that the fault vector does not contain.
    #[must_use]
    pub fn with_unmodelled_fault(self, unmodelled_fault: Option<UnmodelledFault>) -> Self {
        Self {
            unmodelled_fault,
            ..self
        }
    }

    /// One step of 1 µs; `setpoint` is that of the last sample.
    pub fn step(&self, state: &mut DetailedState, setpoint: Setpoint) {
        let true_angle = (self.pole_pairs * state.shaft.theta_m).sin_cos_poly();
        let resolver = self.resolver(state.shaft.theta_m, true_angle);
        if state.shaft.steps.is_multiple_of(self.control_steps) {
            self.control(state, setpoint, &resolver);
        }
        self.supply(state, &resolver);
        self.electrical(state, true_angle);
        self.mechanical(state);
        self.filter(state);
        state.shaft.steps += 1;
    }

    /// Resolver counts of a state, with the resolver's error.
    #[must_use]
    pub fn motor_counts(&self, state: &DetailedState) -> i64 {
        let theta_m = state.shaft.theta_m;
        let resolver = self.resolver(theta_m, (self.pole_pairs * theta_m).sin_cos_poly());
        encoder_count(resolver.theta_m, self.motor_lsb)
    }

    /// Output angle of a state as its encoder sees it, before it counts, rad.
    #[must_use]
    pub fn output_angle(&self, state: &DetailedState) -> f64 {
        self.effects.sensors.output_angle(state.shaft.theta_out)
    }

    /// Phase currents of a state in the path of the samples, before noise and converter, A.
    #[must_use]
    pub fn sampled_currents(&self, state: &DetailedState) -> [f64; 3] {
        if self.effects.sensors.current_filter > 0.0 {
            state.filtered
        } else {
            self.effects.sensors.currents(state.shaft.i)
        }
    }

    fn resolver(&self, theta_m: f64, true_angle: (f64, f64)) -> Resolver {
        let seen = UnmodelledFault::resolver_angle(self.unmodelled_fault, theta_m);
        let angle = if self.unmodelled_fault.is_none() {
            true_angle
        } else {
            (self.pole_pairs * seen).sin_cos_poly()
        };
        let [error, slope] = self.effects.sensors.resolver_error(true_angle);
        Resolver {
            theta_m: seen + error / self.pole_pairs,
            sin_cos: Real::rotate(angle, error),
            speed_factor: 1.0 + slope,
        }
    }

    /// One control period.
    fn control(&self, state: &mut DetailedState, setpoint: Setpoint, resolver: &Resolver) {
        let shaft = &mut state.shaft;
        let counted = self
            .encoder
            .counted_angle(self.effects.sensors.output_angle(shaft.theta_out));
        shaft.i_ref = self.controller.step(
            &mut state.controller,
            setpoint,
            counted,
            encoder_count(resolver.theta_m, self.motor_lsb),
            shaft.omega_m * resolver.speed_factor,
        );
    }

    /// Voltages of the link and of the phases.
    fn supply(&self, state: &mut DetailedState, resolver: &Resolver) {
        let shaft = &mut state.shaft;
        let t = shaft.steps as f64 * REFERENCE_STEP;
        let v_dc = self.link.voltage(self.v_dc, state.link_current, t);
        let measured = self.effects.sensors.currents(shaft.i);
        shaft.v = match &self.vector {
            None => {
                let i_ref = phase_shapes(resolver.sin_cos).map(|s| shaft.i_ref * s);
                shaft.inverter.switch(i_ref, measured, self.half_band, v_dc)
            }
            Some(control) => {
                let input = DriveInput {
                    measured,
                    i: shaft.i,
                    sin_cos: resolver.sin_cos,
                    omega_m: shaft.omega_m,
                    i_ref: shaft.i_ref,
                    v_dc,
                };
                control.step(&mut state.drive, &input, REFERENCE_STEP)
            }
        };
        let power: f64 = (0..3).map(|j| shaft.v[j] * shaft.i[j]).sum();
        state.link_current = self.link.smoothed(state.link_current, power / v_dc, REFERENCE_STEP);
        state.link_voltage = v_dc;
    }

    /// Currents and torque of the motor.
    fn electrical(&self, state: &mut DetailedState, true_angle: (f64, f64)) {
        let shaft = &mut state.shaft;
        let mut shapes = self.winding.emf_shapes(true_angle);
        self.effects.motor.add_harmonics(&mut shapes, true_angle);
        let k = shapes.map(|shape| self.k * shape);
        let linked = self.windings.linked(shaft.i, state.i_short);
        shaft.torque = (0..3).map(|j| k[j] * linked[j]).sum();
        let emf = k.map(|k| k * shaft.omega_m);
        self.windings
            .step(shaft.v, emf, &mut shaft.i, &mut state.i_short, REFERENCE_STEP);
    }

    /// Motion of the motor and of the load.
    fn mechanical(&self, state: &mut DetailedState) {
        let shaft = &mut state.shaft;
        let t = shaft.steps as f64 * REFERENCE_STEP;
        let load = self.load_torque + self.effects.load.torque(shaft.theta_out - state.spring_zero, t);
        let load_at_motor = load / self.transmission.gear_ratio;
        let before = shaft.omega_m;
        let drive = shaft.torque + self.cogging.torque_at(shaft.theta_m) - self.viscous * before;
        let [moving, breakaway] = self.friction.torques(before, shaft.theta_m);
        let brake = UnmodelledFault::brake_torque(self.unmodelled_fault);
        let Some(masses) = &self.two_masses else {
            let dry = DryFriction::under_load(&self.transmission, load_at_motor, moving, breakaway);
            shaft.omega_m = dry
                .with_brake_torque(brake)
                .step(before, drive, REFERENCE_STEP / self.inertia);
            shaft.theta_m += 0.5 * (before + shaft.omega_m) * REFERENCE_STEP;
            shaft.theta_out = follow_through_play(
                shaft.theta_out,
                shaft.theta_m / self.transmission.gear_ratio,
                self.half_play,
            );
            (state.load_speed, state.load_angle) = (shaft.omega_m, shaft.theta_m);
            return;
        };
        let transmitted = masses.transmitted(shaft.theta_m - state.load_angle, before - state.load_speed);
        let dry = DryFriction::under_load(&self.transmission, 0.0, moving, breakaway);
        shaft.omega_m = dry.step(before, drive - transmitted, REFERENCE_STEP / masses.motor_inertia);
        let [moving, breakaway] = self.load_friction.torques(state.load_speed, state.load_angle);
        let dry = DryFriction::under_load(&self.transmission, load_at_motor, moving, breakaway);
        state.load_speed =
            dry.with_brake_torque(brake)
                .step(state.load_speed, transmitted, REFERENCE_STEP / masses.load_inertia);
        // Angles by the new speeds: this keeps the energy of an undamped oscillation bounded.
        shaft.theta_m += shaft.omega_m * REFERENCE_STEP;
        state.load_angle += state.load_speed * REFERENCE_STEP;
        shaft.theta_out = state.load_angle / self.transmission.gear_ratio;
    }

    /// Filter in the path of the sampled currents.
    fn filter(&self, state: &mut DetailedState) {
        if self.effects.sensors.current_filter > 0.0 {
            let seen = self.effects.sensors.currents(state.shaft.i);
            for (filtered, seen) in state.filtered.iter_mut().zip(seen) {
                *filtered += self.filter_share * (seen - *filtered);
            }
        }
    }
}

/// What the resolver shows of a motor angle.
struct Resolver {
    /// Motor angle, rad.
    theta_m: f64,
    /// Sine and cosine of the electrical angle.
    sin_cos: (f64, f64),
    /// Speed relative to the true one.
    speed_factor: f64,
}
