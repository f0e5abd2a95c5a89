//! The reference model with effects: the plain model's laws, with those of [`Effects`] composed around them.
//!
//! Input and output are those of [`Reference`](super::Reference), which stays the model of a unit without effects. Each family
//! of effects has its law in its own file; this module only connects them: controller, drive, windings, shaft, sensors.
//!
//! Currents, speeds and angles take steps of 1 µs. What varies far more slowly (friction curve, cogging, loads, voltage of the
//! link) is computed every fifth step and held; everything on then costs less than three times the plain model.

mod windings;

use self::windings::Windings;
use super::effects::{
    Cogging, Controller, ControllerState, DriveInput, Effects, FrictionCurve, ResolverCurve, TwoMasses, VectorControl,
    VectorState,
};
use super::sensors::encoder_count;
use super::{ReferenceState, UnmodelledFault, worn_play};
use crate::backlash::follow_through_play;
use crate::control::{Encoder, Setpoint};
use crate::fault::FaultVector;
use crate::frames::phase_shapes;
use crate::friction::DryFriction;
use crate::params::{ActuatorParams, REFERENCE_STEP};
use crate::real::Real;
use crate::winding::Winding;

/// Steps between two updates of the slow quantities.
const HOLD_STEPS: u64 = 5;

/// Constants of one simulated actuator with effects.
#[derive(Clone, Debug)]
pub struct DetailedReference {
    effects: Effects,
    unmodelled_fault: Option<UnmodelledFault>,
    controller: Controller,
    encoder: Encoder<f64>,
    control_steps: u64,
    half_band: f64,
    vector: Option<VectorControl>,
    v_dc: f64,
    pole_pairs: f64,
    resolver: Option<ResolverCurve>,
    motor_lsb: f64,
    k: f64,
    winding: Winding<f64>,
    windings: Windings,
    cogging: Cogging,
    viscous: f64,
    /// Δt / J of the motor side; of the whole shaft where it is rigid.
    motor_step: f64,
    /// Δt / J_l of the load side.
    load_step: f64,
    two_masses: Option<TwoMasses>,
    /// Friction of the motor side; of the whole shaft where it is rigid.
    friction: FrictionCurve,
    load_friction: FrictionCurve,
    gear_loss: [f64; 2],
    output_per_motor: f64,
    half_play: f64,
    load_torque: f64,
    /// Share of the difference by which the filtered currents move in one step.
    filter_share: f64,
}

/// State of a simulated actuator with effects.
#[derive(Clone, Copy, Debug)]
pub struct DetailedState {
    /// What the plain model knows too. `v` are mean phase voltages over the last step, `torque` is that of the currents.
    pub shaft: ReferenceState,
    /// Angle of the load side at the motor shaft, n θ_out, rad; that of the motor where the shaft is rigid.
    pub load_angle: f64,
    /// Speed of the load side at the motor shaft, rad/s; that of the motor where the shaft is rigid.
    pub load_speed: f64,
    /// Currents in the shorted turns of each phase, A.
    pub i_short: [f64; 3],
    /// DC link voltage of the last step, V.
    pub link_voltage: f64,
    /// Load torque at the output of the last step, Nm.
    pub load_torque: f64,
    controller: ControllerState,
    steps_to_control: u64,
    drive: VectorState,
    link_current: f64,
    filtered: [f64; 3],
    /// Output angle at which the spring has no torque, rad.
    spring_zero: f64,
    cogging: f64,
    friction: DryFriction<f64>,
    load_friction: DryFriction<f64>,
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
            load_torque: 0.0,
            controller: ControllerState::default(),
            steps_to_control: 0,
            drive: VectorState::default(),
            link_current: 0.0,
            filtered: [0.0; 3],
            spring_zero: theta_out,
            cogging: 0.0,
            friction: DryFriction::default(),
            load_friction: DryFriction::default(),
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
        let (m, t) = (&unit.motor, &unit.transmission);
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
        let half_play = 0.5 * worn_play(t.backlash, controller.transmission.backlash, fault);
        let two_masses = TwoMasses::new(&effects.compliance, m.j, half_play * t.gear_ratio);
        let (load_share, motor_inertia, load_inertia) = match &two_masses {
            None => (0.0, m.j, m.j),
            Some(masses) => (
                effects.compliance.load_friction,
                masses.motor_inertia,
                masses.load_inertia,
            ),
        };
        let per_filter_time = core::f64::consts::TAU * effects.sensors.current_filter;
        Self {
            effects: *effects,
            unmodelled_fault: None,
            controller: Controller::new(controller, fault.gain_factor(), &effects.controller),
            encoder: Encoder::new(controller.sensors.output_lsb()),
            control_steps: libm::round(controller.controller.period / REFERENCE_STEP) as u64,
            half_band: controller.controller.hysteresis,
            vector: effects
                .vector_drive()
                .map(|drive| VectorControl::new(drive, &controller.motor)),
            v_dc: m.v_dc,
            pole_pairs: m.pole_pairs,
            resolver: effects.sensors.resolver(),
            motor_lsb: controller.sensors.motor_lsb(),
            k: m.k,
            winding: Winding::new(&full_turns),
            windings: Windings::new(m, fault.winding_turns_ratio(), effects),
            cogging: effects.cogging.of_motor(m.pole_pairs),
            viscous: viscous * m.c,
            motor_step: REFERENCE_STEP / motor_inertia,
            load_step: REFERENCE_STEP / load_inertia,
            two_masses,
            friction: friction.share(1.0 - load_share),
            load_friction: friction.share(load_share),
            gear_loss: t.gear_loss_shares(),
            output_per_motor: 1.0 / t.gear_ratio,
            half_play,
            load_torque,
            filter_share: 1.0 - libm::exp(-REFERENCE_STEP * per_filter_time),
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
        if state.steps_to_control == 0 {
            state.steps_to_control = self.control_steps;
            self.control(state, setpoint, true_angle);
        }
        if state.shaft.steps.is_multiple_of(HOLD_STEPS) {
            self.hold(state);
        }
        self.switch(state, true_angle);
        self.electrical(state, true_angle);
        self.mechanical(state);
        self.filter(state);
        state.steps_to_control -= 1;
        state.shaft.steps += 1;
    }

    /// Resolver counts of a state, with the resolver's error.
    #[must_use]
    pub fn motor_counts(&self, state: &DetailedState) -> i64 {
        let theta_m = state.shaft.theta_m;
        self.resolver_count(theta_m, (self.pole_pairs * theta_m).sin_cos_poly())
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

    fn resolver_count(&self, theta_m: f64, true_angle: (f64, f64)) -> i64 {
        let error = self.resolver.map_or(0.0, |resolver| resolver.at(true_angle)[0]);
        let seen = UnmodelledFault::resolver_angle(self.unmodelled_fault, theta_m);
        encoder_count(seen + error / self.pole_pairs, self.motor_lsb)
    }

    /// Sine and cosine of the electrical angle as the resolver sees it.
    fn seen_angle(&self, theta_m: f64, true_angle: (f64, f64)) -> (f64, f64) {
        let angle = match self.unmodelled_fault {
            None => true_angle,
            fault => (self.pole_pairs * UnmodelledFault::resolver_angle(fault, theta_m)).sin_cos_poly(),
        };
        match &self.resolver {
            None => angle,
            Some(resolver) => Real::rotate(angle, resolver.at(true_angle)[0]),
        }
    }

    /// One control period.
    fn control(&self, state: &mut DetailedState, setpoint: Setpoint, true_angle: (f64, f64)) {
        let shaft = &mut state.shaft;
        let output = self.effects.sensors.output_angle(shaft.theta_out);
        let slope = self.resolver.map_or(0.0, |resolver| resolver.at(true_angle)[1]);
        shaft.i_ref = self.controller.step(
            &mut state.controller,
            setpoint,
            self.encoder.counted_angle(output),
            self.resolver_count(shaft.theta_m, true_angle),
            shaft.omega_m * (1.0 + slope),
        );
    }

    /// The slow quantities: voltage of the link, loads, cogging, friction.
    fn hold(&self, state: &mut DetailedState) {
        let shaft = &state.shaft;
        let t = shaft.steps as f64 * REFERENCE_STEP;
        state.link_voltage = self.effects.link.voltage(self.v_dc, state.link_current, t);
        state.cogging = self.cogging.torque_at(shaft.theta_m);
        state.load_torque = self.load_torque + self.effects.load.torque(shaft.theta_out - state.spring_zero, t);
        let load = state.load_torque * self.output_per_motor;
        let brake = UnmodelledFault::brake_torque(self.unmodelled_fault);
        let [moving, breakaway] = self.friction.torques(shaft.omega_m, shaft.theta_m);
        if self.two_masses.is_none() {
            let dry = DryFriction::under_load(self.gear_loss, load, moving, breakaway);
            state.friction = dry.with_brake_torque(brake);
            return;
        }
        state.friction = DryFriction::under_load(self.gear_loss, 0.0, moving, breakaway);
        let [moving, breakaway] = self.load_friction.torques(state.load_speed, state.load_angle);
        let dry = DryFriction::under_load(self.gear_loss, load, moving, breakaway);
        state.load_friction = dry.with_brake_torque(brake);
    }

    /// Voltages of the phases, and the current that the link gives.
    fn switch(&self, state: &mut DetailedState, true_angle: (f64, f64)) {
        let shaft = &mut state.shaft;
        let v_dc = state.link_voltage;
        shaft.v = match &self.vector {
            None => {
                let seen = self.seen_angle(shaft.theta_m, true_angle);
                let i_ref = phase_shapes(seen).map(|s| shaft.i_ref * s);
                let measured = self.effects.sensors.currents(shaft.i);
                shaft.inverter.switch(i_ref, measured, self.half_band, v_dc)
            }
            Some(control) => {
                let samples = control.samples_within(&state.drive, REFERENCE_STEP);
                let (measured, sin_cos) = if samples {
                    let seen = self.seen_angle(shaft.theta_m, true_angle);
                    (self.effects.sensors.currents(shaft.i), seen)
                } else {
                    (shaft.i, true_angle)
                };
                let input = DriveInput {
                    measured,
                    i: shaft.i,
                    sin_cos,
                    omega_m: shaft.omega_m,
                    i_ref: shaft.i_ref,
                    v_dc,
                };
                control.step(&mut state.drive, &input, REFERENCE_STEP)
            }
        };
        if self.effects.link.sags() {
            let power: f64 = (0..3).map(|j| shaft.v[j] * shaft.i[j]).sum();
            state.link_current = self
                .effects
                .link
                .smoothed(state.link_current, power / v_dc, REFERENCE_STEP);
        }
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
        self.windings.step(shaft.v, emf, &mut shaft.i, &mut state.i_short);
    }

    /// Motion of the motor and of the load.
    fn mechanical(&self, state: &mut DetailedState) {
        let shaft = &mut state.shaft;
        let before = shaft.omega_m;
        let drive = shaft.torque + state.cogging - self.viscous * before;
        let Some(masses) = &self.two_masses else {
            shaft.omega_m = state.friction.step(before, drive, self.motor_step);
            shaft.theta_m += 0.5 * (before + shaft.omega_m) * REFERENCE_STEP;
            let centre = shaft.theta_m * self.output_per_motor;
            shaft.theta_out = follow_through_play(shaft.theta_out, centre, self.half_play);
            (state.load_speed, state.load_angle) = (shaft.omega_m, shaft.theta_m);
            return;
        };
        let transmitted = masses.transmitted(shaft.theta_m - state.load_angle, before - state.load_speed);
        shaft.omega_m = state.friction.step(before, drive - transmitted, self.motor_step);
        state.load_speed = state.load_friction.step(state.load_speed, transmitted, self.load_step);
        // Angles by the new speeds: this keeps the energy of an undamped oscillation bounded.
        shaft.theta_m += shaft.omega_m * REFERENCE_STEP;
        state.load_angle += state.load_speed * REFERENCE_STEP;
        shaft.theta_out = state.load_angle * self.output_per_motor;
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
