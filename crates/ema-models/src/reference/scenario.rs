//! Scenarios: a series of actuations of one simulated unit, and the samples that its electronics send.

use super::sensors::{CurrentSensing, encoder_count};
use super::{DetailedReference, DetailedState, Effects, Reference, ReferenceState, UnmodelledFault};
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
        let done = libm::floor(since_first / cycle).clamp(0.0, (f64::from(self.count) - 1.0).max(0.0));
        let tau = since_first - done * cycle;
        let direction = if done % 2.0 == 0.0 { sign } else { -sign };
        // Between two actuations in speed mode, the commanded speed is zero. A step is held: it rests, so that its end would be
        // an actuation too.
        if let Some(speed) = self.profile.commanded_speed(tau) {
            let ended = tau > self.length && self.profile != Profile::SpeedStep;
            let speed = if ended { 0.0 } else { direction * speed };
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
        let seen = self.effects.sensors.output_angle(theta_out);
        let at_rest = DetailedState::at_rest(theta_m, theta_out, reference.gear_ratio);
        let gear_ratio = reference.gear_ratio;
        ScenarioRun {
            state: at_rest,
            earlier: at_rest,
            reference,
            detailed: self.detailed(),
            scenario: self.clone(),
            rest_angle: if self.effects.controller.closes_over_motor {
                theta_m / gear_ratio
            } else {
                encoder_count(seen, lsb) as f64 * lsb
            },
            sign,
            seq: 0,
            diverged: false,
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

    /// The unit at its temperature, under its fault vector, without effects but deviations.
    fn reference(&self) -> Reference {
        let controller = self.effects.deviations.controller(&self.nominal);
        Reference::new(&self.hardware(), &controller, &self.fault, self.load_torque)
            .with_unmodelled_fault(self.unmodelled_fault)
    }

    /// The unit with its effects, where it has any that the plain model does not know.
    fn detailed(&self) -> Option<DetailedReference> {
        (!self.effects.only_change_parameters()).then(|| {
            let controller = self.effects.deviations.controller(&self.nominal);
            DetailedReference::new(
                &self.hardware(),
                &controller,
                &self.fault,
                self.load_torque,
                self.temperature_deg_c(),
                &self.effects,
            )
            .with_unmodelled_fault(self.unmodelled_fault)
        })
    }
}

/// A running simulation, an iterator of samples. It ends early where the state is no longer finite ([`ScenarioRun::diverged`]).
#[derive(Clone, Debug)]
pub struct ScenarioRun {
    reference: Reference,
    /// The model with effects, which then takes the place of `reference`.
    detailed: Option<DetailedReference>,
    state: DetailedState,
    /// With effects, the state at the earlier of the two instants of the last sample; `state` is that at the later one.
    earlier: DetailedState,
    scenario: Scenario,
    rest_angle: f64,
    sign: f64,
    seq: u64,
    samples: u64,
    /// Whether the samples ended before `seq` because the state was no longer finite.
    diverged: bool,
    steps_per_sample: u64,
    rng: ChaCha8Rng,
}

impl ScenarioRun {
    /// The true state one sample period after the last sample; with effects, at the instant of the last
    /// sample, the later one where currents and angles have two.
    #[must_use]
    pub fn state(&self) -> &ReferenceState {
        &self.state.shaft
    }

    /// Time at which the samples ended because the state was no longer finite, s.
    #[must_use]
    pub fn diverged(&self) -> Option<f64> {
        self.diverged
            .then(|| self.seq as f64 / self.scenario.nominal.sensors.sample_rate)
    }

    /// Whether the quantities that reach a sample are numbers.
    fn is_finite(&self, sample: &SensedSample) -> bool {
        let shaft = &self.state.shaft;
        sample.currents.iter().chain(&shaft.i).all(|i| i.is_finite())
            && shaft.theta_m.is_finite()
            && shaft.theta_out.is_finite()
    }

    /// Changes the fault vector; the motion continues from its present state.
    pub fn set_fault(&mut self, fault: FaultVector) {
        self.scenario.fault = fault;
        self.reference = self.scenario.reference();
        self.detailed = self.scenario.detailed();
    }

    /// Setpoint latched with a sample.
    fn setpoint(&self, seq: u64) -> Setpoint {
        let t = seq as f64 / self.scenario.nominal.sensors.sample_rate;
        self.scenario.actuations.setpoint(t, self.sign, self.rest_angle)
    }

    /// The next sample of the plain model, which then takes the steps of one sample period.
    fn plain_sample(&mut self) -> SensedSample {
        let sensors = &self.scenario.nominal.sensors;
        let setpoint = self.setpoint(self.seq);
        let state = &mut self.state.shaft;
        let sample = SensedSample {
            seq: self.seq,
            currents: self.scenario.sensing.measure(sensors, state.i, &mut self.rng),
            motor_counts: encoder_count(
                UnmodelledFault::resolver_angle(self.scenario.unmodelled_fault, state.theta_m),
                sensors.motor_lsb(),
            ),
            output_counts: encoder_count(state.theta_out, sensors.output_lsb()),
            setpoint,
        };
        for _ in 0..self.steps_per_sample {
            self.reference.step(state, setpoint);
        }
        sample
    }

    /// The next sample of a unit with effects: currents and angles are latched at instants of their own.
    ///
    /// The motion does not depend on the samples, so the state of each instant is reached from the nearest one before it; an
    /// instant of angles may lie before the currents of earlier samples. An instant before the first step counts as the first.
    fn detailed_sample(&mut self, detailed: &DetailedReference) -> SensedSample {
        let sensing = self.scenario.sensing;
        let (sensors, effects) = (self.scenario.nominal.sensors, self.scenario.effects.sensors);
        let jitter = if effects.sample_jitter > 0.0 {
            self.rng.random_range(-effects.sample_jitter..effects.sample_jitter)
        } else {
            0.0
        };
        let period = self.steps_per_sample as f64;
        let instant =
            |age: f64| libm::round((self.seq as f64 + jitter) * period - age / REFERENCE_STEP).max(0.0) as u64;
        let (currents_at, angles_at) = (instant(effects.current_latency), instant(effects.angle_latency));
        let first = currents_at.min(angles_at);
        if self.state.shaft.steps <= first {
            self.earlier = self.state;
        }
        self.earlier = self.run_until(detailed, self.earlier, first);
        if self.state.shaft.steps < first {
            self.state = self.earlier;
        }
        self.state = self.run_until(detailed, self.state, currents_at.max(angles_at));
        let (at_currents, at_angles) = if currents_at < angles_at {
            (&self.earlier, &self.state)
        } else {
            (&self.state, &self.earlier)
        };
        let currents = detailed.sampled_currents(at_currents);
        SensedSample {
            seq: self.seq,
            currents: effects.completed(sensing.measure(&sensors, currents, &mut self.rng)),
            motor_counts: detailed.motor_counts(at_angles),
            output_counts: encoder_count(detailed.output_angle(at_angles), sensors.output_lsb()),
            setpoint: self.setpoint(self.seq),
        }
    }

    /// The state at an instant, from one that is not later.
    fn run_until(&self, detailed: &DetailedReference, mut state: DetailedState, instant: u64) -> DetailedState {
        while state.shaft.steps < instant {
            let seq = state.shaft.steps / self.steps_per_sample;
            let setpoint = self.setpoint(seq);
            let end = instant.min((seq + 1) * self.steps_per_sample);
            while state.shaft.steps < end {
                detailed.step(&mut state, setpoint);
            }
        }
        state
    }
}

impl Iterator for ScenarioRun {
    type Item = SensedSample;

    fn next(&mut self) -> Option<SensedSample> {
        if self.diverged || self.seq >= self.samples {
            return None;
        }
        let sample = match self.detailed.take() {
            None => self.plain_sample(),
            Some(detailed) => {
                let sample = self.detailed_sample(&detailed);
                self.detailed = Some(detailed);
                sample
            }
        };
        self.diverged = !self.is_finite(&sample);
        if self.diverged {
            return None;
        }
        self.seq += 1;
        Some(sample)
    }
}
