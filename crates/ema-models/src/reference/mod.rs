//! High-fidelity reference model: the three-phase switched actuator, which replaces a real one in tests and calibration.
//!
//! Input is a [`Scenario`], output are [`SensedSample`](crate::SensedSample)s. One step is 1 µs: ACE every control period,
//! three hysteresis comparators, unequal phases in star connection, dry friction, backlash. The model shares no averaging with
//! the monitor. The signals of a sample are latched together, before the step that starts at this instant; the ACE uses the
//! setpoint latched with the last sample.
//!
//! [`Reference`] is the ideal actuator of the specification. A scenario with [`Effects`] is simulated by [`DetailedReference`],
//! which composes the laws of the effects around the same controller, winding, friction and backlash.

mod built_in_drive;
mod detailed;
mod effect_settings;
mod effects;
mod inverter;
mod pmsm;
mod scenario;
mod sensors;
mod unmodelled_fault;

pub use detailed::{DetailedReference, DetailedState};
pub use effect_settings::{EffectConflict, EffectSettings};
pub use effects::{
    Cogging, Compliance, ControllerEffects, Deviations, Drive, EFFECTS, EffectError, EffectInfo, Effects,
    FrictionEffects, LinkEffects, LoadEffects, MotorEffects, ResolverError, Scale, SensorEffects, ShortedTurns,
    VectorDrive,
};
pub use inverter::Inverter;
pub use pmsm::Phases;
pub use scenario::{Actuations, Scenario, ScenarioRun};
pub use sensors::{CurrentSensing, encoder_count};
pub use unmodelled_fault::UnmodelledFault;

use crate::backlash::follow_through_play;
use crate::control::{Ace, AceState, Encoder, Setpoint};
use crate::fault::FaultVector;
use crate::frames::phase_shapes;
use crate::friction::DryFriction;
use crate::params::{ActuatorParams, REFERENCE_STEP};
use crate::real::Real;
use crate::winding::Winding;

/// Constants of one simulated actuator under one fault vector.
#[derive(Clone, Debug)]
pub struct Reference {
    ace: Ace<f64>,
    encoder: Encoder<f64>,
    half_band: f64,
    v_dc: f64,
    pole_pairs: f64,
    k: f64,
    viscous: f64,
    step: f64,
    step_over_j: f64,
    steps_per_period: u64,
    phases: Phases,
    winding: Winding<f64>,
    friction: DryFriction<f64>,
    gear_ratio: f64,
    half_play: f64,
    unmodelled_fault: Option<UnmodelledFault>,
}

/// State of the simulated actuator.
#[derive(Clone, Copy, Debug)]
pub struct ReferenceState {
    /// Steps taken since t₀.
    pub steps: u64,
    /// Phase currents, A.
    pub i: [f64; 3],
    /// Motor angle, rad.
    pub theta_m: f64,
    /// Motor speed, rad/s.
    pub omega_m: f64,
    /// Output angle, rad.
    pub theta_out: f64,
    /// Quadrature current reference of the running control period, A.
    pub i_ref: f64,
    /// Torque of the last step, Nm.
    pub torque: f64,
    /// Phase voltages of the last step, V.
    pub v: [f64; 3],
    ace: AceState<f64>,
    inverter: Inverter,
}

impl ReferenceState {
    /// The state at rest, without current, at these angles, rad.
    #[must_use]
    pub fn at_rest(theta_m: f64, theta_out: f64) -> Self {
        Self {
            steps: 0,
            i: [0.0; 3],
            theta_m,
            omega_m: 0.0,
            theta_out,
            i_ref: 0.0,
            torque: 0.0,
            v: [0.0; 3],
            ace: AceState::default(),
            inverter: Inverter::default(),
        }
    }
}

impl Reference {
    /// An actuator with the hardware `unit` and a controller set for `nominal`, under a fault vector and a constant load torque
    /// at the output, Nm (positive opposes positive motion).
    ///
    /// `unit` differs from `nominal` when k, R or J of the motor deviate; the controller keeps the nominal torque gain.
    #[must_use]
    pub fn new(unit: &ActuatorParams, nominal: &ActuatorParams, fault: &FaultVector, load_torque: f64) -> Self {
        Self::with_step(unit, nominal, fault, load_torque, REFERENCE_STEP)
    }

    /// [`Reference::new`] with another step than 1 µs, for convergence studies; the control period is a multiple of it, s.
    #[must_use]
    pub fn with_step(
        unit: &ActuatorParams,
        nominal: &ActuatorParams,
        fault: &FaultVector,
        load_torque: f64,
        step: f64,
    ) -> Self {
        let winding = Winding::new(fault);
        Self {
            ace: Ace::new(nominal, fault.gain_factor()),
            encoder: Encoder::new(nominal.sensors.output_lsb()),
            half_band: nominal.controller.hysteresis,
            v_dc: unit.motor.v_dc,
            pole_pairs: unit.motor.pole_pairs,
            k: unit.motor.k,
            viscous: unit.motor.c,
            step,
            step_over_j: step / unit.motor.j,
            steps_per_period: libm::round(nominal.controller.period / step) as u64,
            phases: Phases::new(&unit.motor, winding.turns_ratio),
            winding,
            friction: DryFriction::new(&unit.transmission, fault, load_torque),
            gear_ratio: unit.transmission.gear_ratio,
            half_play: 0.5 * worn_play(unit.transmission.backlash, nominal.transmission.backlash, fault),
            unmodelled_fault: None,
        }
    }

    /// The actuator with a fault that the fault vector does not contain.
    #[must_use]
    pub fn with_unmodelled_fault(self, unmodelled_fault: Option<UnmodelledFault>) -> Self {
        Self {
            friction: self
                .friction
                .with_brake_torque(UnmodelledFault::brake_torque(unmodelled_fault)),
            unmodelled_fault,
            ..self
        }
    }

    /// One step of the actuator; `setpoint` is that of the last sample.
    pub fn step(&self, state: &mut ReferenceState, setpoint: Setpoint) {
        if state.steps.is_multiple_of(self.steps_per_period) {
            let counted = self.encoder.counted_angle(state.theta_out);
            state.i_ref = self.ace.step(&mut state.ace, setpoint, counted, state.omega_m);
        }
        let sin_cos = (self.pole_pairs * state.theta_m).sin_cos_poly();
        let seen = match self.unmodelled_fault {
            None => sin_cos,
            unmodelled_fault => {
                (self.pole_pairs * UnmodelledFault::resolver_angle(unmodelled_fault, state.theta_m)).sin_cos_poly()
            }
        };
        let i_ref = phase_shapes(seen).map(|s| state.i_ref * s);
        state.v = state.inverter.switch(i_ref, state.i, self.half_band, self.v_dc);

        let k_j = self.winding.emf_shapes(sin_cos).map(|shape| self.k * shape);
        let di = self.phases.derivative(state.v, k_j.map(|k| k * state.omega_m), state.i);
        state.torque = (0..3).map(|j| k_j[j] * state.i[j]).sum();
        for j in 0..3 {
            state.i[j] += di[j] * self.step;
        }

        let before = state.omega_m;
        state.omega_m = self
            .friction
            .step(before, state.torque - self.viscous * before, self.step_over_j);
        state.theta_m += 0.5 * (before + state.omega_m) * self.step;
        state.theta_out = follow_through_play(state.theta_out, state.theta_m / self.gear_ratio, self.half_play);
        state.steps += 1;
    }
}

/// Total play of a unit under a fault vector, rad: its own, and wear by the play b₀ of its type, `b + 99 k2 b₀`.
pub(crate) fn worn_play(of_unit: f64, of_type: f64, fault: &FaultVector) -> f64 {
    let factor = fault.backlash_factor();
    // Exactly `b₀ (1 + 99 k2)` for a unit that is its type.
    of_unit * factor + (of_type - of_unit) * (factor - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn play_wears_by_that_of_the_type() {
        let worn = FaultVector {
            backlash: 0.2,
            ..FaultVector::NOMINAL
        };
        assert!((worn_play(0.5e-4, 1e-4, &worn) - (0.5e-4 + 99.0 * 0.2 * 1e-4)).abs() < 1e-18);
        let (same, plain) = (worn_play(1e-4, 1e-4, &worn), 1e-4 * worn.backlash_factor());
        assert_eq!(same.to_bits(), plain.to_bits());
    }
}
