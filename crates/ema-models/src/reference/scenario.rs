//! Actuations one after the other, sampled as the control electronics would send them.

use super::sensors::{CurrentSensing, count};
use super::{Alien, Reference, ReferenceState};
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
    /// What each actuation commands; the direction changes from one to the next.
    pub profile: Profile,
    /// How many.
    pub count: u32,
    /// Rest before the first and after each, s.
    pub rest: f64,
    /// Length of each actuation, s; then its last setpoint is held.
    pub length: f64,
}

impl Actuations {
    /// One window of the given profile, as the accuracy suites use it.
    #[must_use]
    pub fn one(profile: Profile) -> Self {
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

    /// What is commanded at time t, for a first direction `sign`, from the rest position `rest_angle` on, rad.
    fn setpoint(&self, t: f64, sign: f64, rest_angle: f64) -> Setpoint {
        let cycle = self.period();
        let since_first = t - self.rest;
        let done = libm::floor(since_first / cycle).clamp(0.0, f64::from(self.count) - 1.0);
        let tau = since_first - done * cycle;
        let direction = if done % 2.0 == 0.0 { sign } else { -sign };
        // Between two actuations in speed mode the motor is told to stand.
        if let Some(speed) = self.profile.speed(tau) {
            let speed = if tau > self.length { 0.0 } else { direction * speed };
            return Setpoint::Speed(libm::round(speed / SPEED_LSB) * SPEED_LSB);
        }
        let travel = self.profile.angle(self.length);
        // Directions alternate, so after an odd number of actuations one travel is left over.
        let base = if done % 2.0 == 0.0 { 0.0 } else { sign * travel };
        let commanded = rest_angle + (base + direction * self.profile.angle(tau.min(self.length)));
        Setpoint::Position(libm::round(commanded / POSITION_LSB) * POSITION_LSB)
    }
}

/// Everything that decides what a simulated actuator sends.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// The actuator type: what its controller is set for.
    pub nominal: ActuatorParams,
    /// This very unit.
    pub unit: ActuatorParams,
    /// Its state of wear.
    pub fault: FaultVector,
    /// Constant load at the output, Nm; positive opposes positive motion.
    pub load_torque: f64,
    /// Winding temperature, °C; the unit's motor is given at 20 °C.
    pub winding_temp_deg_c: f64,
    /// A fault that the fault vector does not have.
    pub alien: Option<Alien>,
    /// Current sensors.
    pub sensing: CurrentSensing,
    /// What is commanded.
    pub actuations: Actuations,
    /// Draws the initial rotor angle, the place in the backlash, the sign of the command and the noise.
    pub seed: u64,
}

/// Resolution of a transmitted position setpoint, rad.
const POSITION_LSB: f64 = 1e-6;

/// Resolution of a transmitted speed setpoint, rad/s.
const SPEED_LSB: f64 = 1e-3;

impl Scenario {
    /// A healthy `bench`-like unit of one type with ideal current sensors, one mixed actuation.
    #[must_use]
    pub fn new(params: ActuatorParams, fault: FaultVector, seed: u64) -> Self {
        Self {
            nominal: params,
            unit: params,
            fault,
            load_torque: 0.0,
            winding_temp_deg_c: REFERENCE_TEMPERATURE_DEG_C,
            alien: None,
            sensing: CurrentSensing::IDEAL,
            actuations: Actuations::one(Profile::Mixed),
            seed,
        }
    }

    /// Starts the simulation; the samples come out of the iterator.
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
            rest_angle: count(theta_out, lsb) as f64 * lsb,
            sign,
            seq: 0,
            samples: libm::round(self.actuations.duration() * self.nominal.sensors.sample_rate) as u64,
            steps_per_sample: libm::round(1.0 / (self.nominal.sensors.sample_rate * REFERENCE_STEP)) as u64,
            rng,
        }
    }

    /// The unit at its temperature, in its state of wear.
    fn reference(&self) -> Reference {
        let warm = ActuatorParams {
            motor: self.unit.motor.at_temperature(self.winding_temp_deg_c),
            ..self.unit
        };
        Reference::new(&warm, &self.nominal, &self.fault, self.load_torque).with_alien(self.alien)
    }
}

/// A running simulation: an iterator of samples.
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
    /// The true state behind the last sample, one sample period later.
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
            currents: self.scenario.sensing.read(sensors, self.state.i, &mut self.rng),
            motor_counts: count(
                Alien::resolver(self.scenario.alien, self.state.theta_m),
                sensors.motor_lsb(),
            ),
            output_counts: count(self.state.theta_out, sensors.output_lsb()),
            setpoint,
        };
        for _ in 0..self.steps_per_sample {
            self.reference.step(&mut self.state, setpoint);
        }
        self.seq += 1;
        Some(sample)
    }
}
