//! A simulated actuator behind a drive as it is sold: the reference model's samples as the frames of CiA 402, ODrive, moteus, VESC or
//! Damiao, written from their published dictionaries and not from the layouts that read them.
//!
//! Besides the drive's own frames there are those to it: commands, requests, SYNC; and the jitter of a host's stamps.

mod cia402;
mod damiao;
mod moteus;
mod odrive;
mod vesc;

use std::collections::VecDeque;

use ema_models::reference::{Scenario, ScenarioRun};
use ema_models::{ActuatorParams, Real, SensedSample, Setpoint, dq_from_abc};
use hmd_core::drive_bus::Preset;
use hmd_core::frame::{FrameFlags, RawFrame};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Time from one frame to the next on the bus, ns.
const FRAME_TIME_NS: u64 = 120_000;

/// Largest delay of a host's stamp, ns.
const JITTER_NS: u64 = 100_000;

/// Which drive sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DriveLink {
    /// Its frames.
    pub preset: Preset,
    /// Its number.
    pub node: u8,
    /// Whether a second encoder at the output is sent.
    pub has_output_encoder: bool,
}

/// What a drive sends of one sample.
#[derive(Clone, Copy, Debug)]
struct DriveSample {
    /// Motor angle, turns and counts.
    motor_turns: f64,
    motor_counts: i64,
    motor_counts_per_turn: f64,
    /// The same angle behind the gear, rad.
    rotor_rad_at_output: f64,
    /// Output angle, turns and counts.
    output_turns: f64,
    output_counts: i64,
    /// Currents of the rotor's frame, A.
    i_d: f64,
    i_q: f64,
    /// Voltage across the rotor's field, V, for its sign.
    v_q: f64,
    /// The position command in turns of the motor, and in rad of the output.
    command_turns: Option<f64>,
    command_rad: Option<f64>,
    /// Whether the slow values are sent, too.
    is_slow: bool,
    dc_link_v: f64,
    winding_temp_deg_c: f64,
}

/// One frame to be sent.
struct Sent {
    id: u32,
    flags: FrameFlags,
    data: Vec<u8>,
}

impl Sent {
    fn classic(id: u32, data: impl Into<Vec<u8>>) -> Self {
        Self {
            id,
            flags: FrameFlags::NONE,
            data: data.into(),
        }
    }
}

/// Frames of one drive, in bus order.
#[derive(Debug)]
pub struct DriveTraffic {
    samples: ScenarioRun,
    link: DriveLink,
    params: ActuatorParams,
    dc_link_v: f64,
    winding_temp_deg_c: f64,
    period_ns: u64,
    start_ns: u64,
    /// Motor counts of the sample before.
    counts_before: Option<i64>,
    jitter: ChaCha8Rng,
    queue: VecDeque<RawFrame>,
}

impl DriveTraffic {
    /// The traffic of a scenario from the given time on, bus 0; of CiA 402 behind the master's configuration of the PDO.
    #[must_use]
    pub fn new(scenario: &Scenario, link: DriveLink, start_ns: u64) -> Self {
        let params = scenario.nominal;
        let mut found = Self {
            samples: scenario.run(),
            link,
            params,
            dc_link_v: scenario.unit.motor.v_dc,
            winding_temp_deg_c: scenario.temperature_deg_c(),
            period_ns: (1e9 / params.sensors.sample_rate).round() as u64,
            start_ns,
            counts_before: None,
            jitter: ChaCha8Rng::seed_from_u64(scenario.seed),
            queue: VecDeque::new(),
        };
        if link.preset == Preset::Cia402 {
            let written = cia402::configuration(&link);
            let before_ns = FRAME_TIME_NS * (written.len() as u64 + 2);
            found.send(start_ns - before_ns, written);
        }
        found
    }

    /// Time at which the frames ended because the simulated state was no longer finite, s.
    #[must_use]
    pub fn diverged(&self) -> Option<f64> {
        self.samples.diverged()
    }

    fn send(&mut self, from_ns: u64, frames: Vec<Sent>) {
        let mut stamp_ns = from_ns + self.jitter.random_range(0..JITTER_NS);
        for Sent { id, flags, data } in frames {
            if let Ok(frame) = RawFrame::new(stamp_ns, 0, id, flags, &data) {
                self.queue.push_back(frame);
            }
            stamp_ns += FRAME_TIME_NS;
        }
    }

    fn sample(&mut self, sensed: &SensedSample) -> DriveSample {
        let (sensors, gear_ratio) = (&self.params.sensors, self.params.transmission.gear_ratio);
        let motor_turns = (sensed.motor_counts as f64 + 0.5) / sensors.motor_counts_per_rev;
        let angle = core::f64::consts::TAU * (self.params.motor.pole_pairs * motor_turns).rem_euclid(1.0);
        let [i_d, i_q] = dq_from_abc(sensed.currents, angle.sin_cos_poly());
        let command_rad = match sensed.setpoint {
            Setpoint::Position(angle) => Some(angle),
            Setpoint::Idle | Setpoint::Speed(_) => None,
        };
        let counts_before = self.counts_before.replace(sensed.motor_counts);
        let moved = sensed.motor_counts - counts_before.unwrap_or(sensed.motor_counts);
        let speed = core::f64::consts::TAU * moved as f64 / sensors.motor_counts_per_rev * sensors.sample_rate;
        let motor = &self.params.motor;
        // Slow values ten times a second.
        let slow_every = (sensors.sample_rate / 10.0).round().max(1.0) as u64;
        DriveSample {
            motor_turns,
            motor_counts: sensed.motor_counts,
            rotor_rad_at_output: core::f64::consts::TAU * motor_turns / gear_ratio,
            motor_counts_per_turn: sensors.motor_counts_per_rev,
            output_turns: sensed.output_counts as f64 / sensors.output_counts_per_rev,
            output_counts: sensed.output_counts,
            i_d,
            i_q,
            v_q: motor.r_s * i_q + motor.k * speed,
            command_turns: command_rad.map(|angle| angle * gear_ratio / core::f64::consts::TAU),
            command_rad,
            is_slow: sensed.seq.is_multiple_of(slow_every),
            dc_link_v: self.dc_link_v,
            winding_temp_deg_c: self.winding_temp_deg_c,
        }
    }
}

impl Iterator for DriveTraffic {
    type Item = RawFrame;

    fn next(&mut self) -> Option<RawFrame> {
        if self.queue.is_empty() {
            let sensed = self.samples.next()?;
            let sample = self.sample(&sensed);
            let frames = match self.link.preset {
                Preset::Cia402 => cia402::frames(&self.link, &sample),
                Preset::Odrive => odrive::frames(&self.link, &sample),
                Preset::Moteus => moteus::frames(&self.link, &sample),
                Preset::Vesc => vesc::frames(&self.link, &sample),
                Preset::Damiao => damiao::frames(&self.link, &sample),
            };
            self.send(self.start_ns + sensed.seq * self.period_ns, frames);
        }
        self.queue.pop_front()
    }
}
