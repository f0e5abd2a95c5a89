//! Scenarios: a series of actuations of one simulated unit, and the samples that its electronics send.

use super::sensors::{CurrentSensing, encoder_count};
use super::{Effects, Reference, ReferenceState, UnmodelledFault};
use crate::command::Profile;
use crate::control::Setpoint;
use crate::fault::FaultVector;
use crate::params::{ActuatorParams, REFERENCE_STEP};
use crate::samples::SensedSample;
use crate::temperature::REFERENCE_TEMPERATURE_DEG_C;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A series of equal actuations with rests between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Actuations {
    /// Command of each actuation; the direction alternates.
    pub profile: Profile,
    /// Number of actuations.
    pub count: u32,
    /// Rest before the first actuation and after each, s.
    pub rest: f64,
    /// Length of each actuation, s; its last setpoint is held during the rest.
    pub length: f64,
}

impl Actuations {
    /// One actuation of this profile with the timing of the accuracy suites.
    #[must_use]
    pub fn single(profile: Profile) -> Self {
        Self {
            profile,
            count: 1,
            rest: 0.04,
            length: 0.5,
        }
    }

    /// Time from one actuation to the next, s.
    #[must_use]
    pub fn period(&self) -> f64 {
        self.length + self.rest
    }

    /// Duration of the whole series, s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.rest + f64::from(self.count) * self.period()
    }

    /// Setpoint at time t, s, for a first direction `sign` and the angle `rest_angle` before the first actuation, rad.
    fn setpoint(&self, t: f64, sign: f64, rest_angle: f64) -> Setpoint {
        let cycle = self.period();
        let since_first = t - self.rest;
        let done = libm::floor(since_first / cycle).clamp(0.0, f64::from(self.count) - 1.0);
        let tau = since_first - done * cycle;
        let direction = if done % 2.0 == 0.0 { sign } else { -sign };
        // Between two actuations in speed mode, the commanded speed is zero.
        if let Some(speed) = self.profile.commanded_speed(tau) {
            let speed = if tau > self.length { 0.0 } else { direction * speed };
            return Setpoint::Speed(libm::round(speed / SPEED_LSB) * SPEED_LSB);
        }
        let travel = self.profile.commanded_angle(self.length);
        // Directions alternate, so after an odd number of actuations the output is one travel away.
        let base = if done % 2.0 == 0.0 { 0.0 } else { sign * travel };
        let commanded = rest_angle + (base + direction * self.profile.commanded_angle(tau.min(self.length)));
        Setpoint::Position(libm::round(commanded / POSITION_LSB) * POSITION_LSB)
    }
}

/// Input of a simulation.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// The actuator type, for which the controller is set.
    pub nominal: ActuatorParams,
    /// Parameters of the simulated unit.
    pub unit: ActuatorParams,
    /// Fault vector of the unit.
    pub fault: FaultVector,
    /// Constant load at the output, Nm; positive opposes positive motion.
    pub load_torque: f64,
    /// Winding temperature, °C; `unit` has the parameters at 20 °C.
    pub winding_temp_deg_c: f64,
    /// A fault that the fault vector does not contain.
    pub unmodelled_fault: Option<UnmodelledFault>,
    /// What the unit has besides; its deviations apply to `unit` and to the controller of `nominal`.
    pub effects: Effects,
    /// Current measurement.
    pub sensing: CurrentSensing,
    /// Commands.
    pub actuations: Actuations,
    /// Seed of the initial rotor angle, the position in the backlash, the sign of the command and the noise.
    pub seed: u64,
}

/// Resolution of a transmitted position setpoint, rad.
const POSITION_LSB: f64 = 1e-6;

/// Resolution of a transmitted speed setpoint, rad/s.
const SPEED_LSB: f64 = 1e-3;

impl Scenario {
    /// A unit that equals its type, under this fault vector, with ideal current measurement, no load and one mixed actuation.
    #[must_use]
    pub fn new(params: ActuatorParams, fault: FaultVector, seed: u64) -> Self {
        Self {
            nominal: params,
            unit: params,
            fault,
            load_torque: 0.0,
            winding_temp_deg_c: REFERENCE_TEMPERATURE_DEG_C,
            unmodelled_fault: None,
            effects: Effects::default(),
            sensing: CurrentSensing::IDEAL,
            actuations: Actuations::single(Profile::Mixed),
            seed,
        }
    }

    /// The simulation as an iterator of samples.
    #[must_use]
    pub fn run(&self) -> ScenarioRun {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let reference = self.reference();
        let theta_m = rng.random_range(0.0..core::f64::consts::TAU);
        let place = rng.random_range(-1.0..1.0);
        let sign = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
        let theta_out = theta_m / reference.gear_ratio + place * reference.half_play;
        let lsb = self.nominal.sensors.output_lsb();
        ScenarioRun {
            state: ReferenceState::at_rest(theta_m, theta_out),
            reference,
            scenario: self.clone(),
            rest_angle: encoder_count(theta_out, lsb) as f64 * lsb,
            sign,
            seq: 0,
            samples: libm::round(self.actuations.duration() * self.nominal.sensors.sample_rate) as u64,
            steps_per_sample: libm::round(1.0 / (self.nominal.sensors.sample_rate * REFERENCE_STEP)) as u64,
            rng,
        }
    }

    /// Temperature of the winding, which the unit measures, °C.
    #[must_use]
    pub fn temperature_deg_c(&self) -> f64 {
        self.winding_temp_deg_c + self.effects.friction.temperature_rise
    }

    /// Parameters of the unit at its temperature, with its deviations.
    fn hardware(&self) -> ActuatorParams {
        let unit = self.effects.deviations.hardware(&self.unit);
        ActuatorParams {
            motor: unit.motor.at_temperature(self.temperature_deg_c()),
            ..unit
        }
    }

    /// The unit at its temperature, under its fault vector.
    fn reference(&self) -> Reference {
        let controller = self.effects.deviations.controller(&self.nominal);
        Reference::new(&self.hardware(), &controller, &self.fault, self.load_torque)
            .with_unmodelled_fault(self.unmodelled_fault)
    }
}

/// A running simulation, an iterator of samples.
#[derive(Clone, Debug)]
pub struct ScenarioRun {
    reference: Reference,
    state: ReferenceState,
    scenario: Scenario,
    rest_angle: f64,
    sign: f64,
    seq: u64,
    samples: u64,
    steps_per_sample: u64,
    rng: ChaCha8Rng,
}

impl ScenarioRun {
    /// The true state one sample period after the last sample.
    #[must_use]
    pub fn state(&self) -> &ReferenceState {
        &self.state
    }

    /// Changes the fault vector; the motion continues from its present state.
    pub fn set_fault(&mut self, fault: FaultVector) {
        self.scenario.fault = fault;
        self.reference = self.scenario.reference();
    }
}

impl Iterator for ScenarioRun {
    type Item = SensedSample;

    fn next(&mut self) -> Option<SensedSample> {
        if self.seq >= self.samples {
            return None;
        }
        let sensors = &self.scenario.nominal.sensors;
        let t = self.seq as f64 / sensors.sample_rate;
        let setpoint = self.scenario.actuations.setpoint(t, self.sign, self.rest_angle);
        let sample = SensedSample {
            seq: self.seq,
            currents: self.scenario.sensing.measure(sensors, self.state.i, &mut self.rng),
            motor_counts: encoder_count(
                UnmodelledFault::resolver_angle(self.scenario.unmodelled_fault, self.state.theta_m),
                sensors.motor_lsb(),
            ),
            output_counts: encoder_count(self.state.theta_out, sensors.output_lsb()),
            setpoint,
        };
        for _ in 0..self.steps_per_sample {
            self.reference.step(&mut self.state, setpoint);
        }
        self.seq += 1;
        Some(sample)
    }
}
