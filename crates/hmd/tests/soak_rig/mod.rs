//! Sixteen actuators on four buses at 400 Hz for any length of time: two recorded minutes of each kind of unit, looped.

pub(crate) mod program;

use std::sync::Arc;

use ema_models::reference::{Actuations, CurrentSensing, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile, REFERENCE_TEMPERATURE_DEG_C};
use ema_wire::can::Status;
use ema_wire::{ActuatorId, Frame, Sample, quantity};
use hmd_core::frame::{FrameFlags, RawFrame};
use hmd_ingest::feed::Input;
use hmd_lab::simulate::{EPOCH_NS, encode};

/// Actuators, on buses with as many each, so that none runs ahead of the others.
pub(crate) const ACTUATORS: u64 = 16;
pub(crate) const BUSES: u64 = 4;
pub(crate) const ACTUATORS_PER_BUS: u64 = ACTUATORS / BUSES;

/// Samples of an actuator in a minute.
pub(crate) const SAMPLES_PER_MINUTE: u64 = 60 * RATE_HZ;

const RATE_HZ: u64 = 400;
const PERIOD_NS: u64 = 1_000_000_000 / RATE_HZ;

/// Time of one frame of eight bytes on the bus, ns.
const FRAME_NS: u64 = 120_000;

/// Rest before the actuation of a minute and after it as they are simulated, samples; the rest of the minute repeats its
/// end.
const REST: u64 = RATE_HZ;

/// Samples from one status frame to the next: 10 Hz.
const STATUS_EVERY: u64 = 40;

/// Samples from the trigger to the end of a window, as configured without a word: 500 ms, 20 ms of them before it.
const ACTUATION_SAMPLES: u64 = 480 * RATE_HZ / 1000;

/// Current noise of the sensors, rms, A.
const NOISE_A: f64 = 0.05;

/// A configuration of all of them, each on its bus.
pub(crate) fn config() -> String {
    let mut text = format!("type.bench.tolerances = \"exact\"\n[type.bench.sensors]\nsample_rate_hz = {RATE_HZ}\n");
    for id in 0..ACTUATORS {
        text += &format!("[[actuator]]\nid = {id}\nbus = \"can{}\"\n", id / ACTUATORS_PER_BUS);
    }
    text
}

/// Two minutes of a unit: an actuation there, and one back.
pub(crate) struct Template(Vec<Sample>);

impl Template {
    /// Those of four units; actuator n has the one of n modulo 4.
    pub(crate) fn all() -> Arc<[Self; 4]> {
        let mut faults = [FaultVector::NOMINAL.to_array(); 4];
        // Friction, backlash and gain.
        for (fault, (at, damage)) in faults[1..].iter_mut().zip([(0, 0.4), (1, 0.5), (7, 0.75)]) {
            fault[at] = damage;
        }
        Arc::new(faults.map(Self::of))
    }

    fn of(fault: [f64; 8]) -> Self {
        let mut params = ActuatorParams::bench();
        params.sensors.sample_rate = RATE_HZ as f64;
        let scenario = Scenario {
            actuations: Actuations {
                // The first two end where every further two begin.
                count: 4,
                rest: REST as f64 / RATE_HZ as f64,
                ..Actuations::single(Profile::Mixed)
            },
            sensing: CurrentSensing {
                noise_rms: NOISE_A,
                ..CurrentSensing::IDEAL
            },
            ..Scenario::new(params, FaultVector::from_array(fault), 1)
        };
        let id = ActuatorId::new(0).expect("an actuator");
        let samples: Vec<Sample> = scenario.run().map(|sensed| encode(id, &sensed, 0)).collect();
        let period = (scenario.actuations.period() * RATE_HZ as f64) as usize;
        let mut minutes = Vec::new();
        for from in [2 * period, 3 * period] {
            let minute = &samples[from..from + period + REST as usize];
            let (_, end) = minute.split_at(minute.len() - REST as usize / 2);
            let held = end.iter().cycle();
            minutes.extend(minute.iter().chain(held).take(SAMPLES_PER_MINUTE as usize));
        }
        Self(minutes)
    }

    /// Actuator `id`'s sample number `seq`: their actuations are spread over the minute.
    fn sample(&self, id: u8, seq: u64) -> Sample {
        let length = self.0.len() as u64;
        let at = seq + length - u64::from(id) * SAMPLES_PER_MINUTE / ACTUATORS;
        Sample {
            actuator: ActuatorId::new(id).expect("an actuator"),
            seq: seq as u16,
            time_us: (seq * PERIOD_NS / 1000) as u16,
            ..self.0[(at % length) as usize]
        }
    }
}

/// Traffic of one bus, in its order; the first has a tick each second as well, so that everything that the daemon does in the
/// course of time is compressed with it.
pub(crate) struct Bus {
    templates: Arc<[Template; 4]>,
    ids: std::ops::Range<u8>,
    seq: u64,
    end: u64,
    /// What one sample of all actuators brings, last first.
    waiting: Vec<Input>,
    /// Called before each second of traffic, with its number.
    before: Box<dyn FnMut(u64) + Send>,
}

impl Bus {
    pub(crate) fn new(
        templates: Arc<[Template; 4]>,
        bus: u64,
        minutes: u64,
        before: Box<dyn FnMut(u64) + Send>,
    ) -> Self {
        Self {
            templates,
            ids: (bus * ACTUATORS_PER_BUS) as u8..((bus + 1) * ACTUATORS_PER_BUS) as u8,
            seq: 0,
            end: minutes * SAMPLES_PER_MINUTE,
            waiting: Vec::new(),
            before,
        }
    }
}

impl Iterator for Bus {
    type Item = Input;

    fn next(&mut self) -> Option<Input> {
        if self.waiting.is_empty() {
            if self.seq == self.end {
                return None;
            }
            if self.seq.is_multiple_of(RATE_HZ) {
                (self.before)(self.seq / RATE_HZ);
            }
            let mut stamp_ns = EPOCH_NS + self.seq * PERIOD_NS;
            for id in self.ids.clone() {
                let sample = self.templates[usize::from(id % 4)].sample(id, self.seq);
                let status = self
                    .seq
                    .is_multiple_of(STATUS_EVERY)
                    .then(|| Frame::Status(status(&sample)));
                for frame in sample.to_frames().into_iter().chain(status) {
                    let mut bytes = [0; 64];
                    let id = u32::from(frame.message().id(sample.actuator));
                    let frame = RawFrame::new(stamp_ns, 0, id, FrameFlags::NONE, frame.emit(&mut bytes));
                    self.waiting.push(Input::Frame(frame.expect("a classic frame")));
                    stamp_ns += FRAME_NS;
                }
            }
            // One of them has the clock.
            if self.ids.start == 0 && self.seq.is_multiple_of(RATE_HZ) {
                self.waiting.push(Input::Tick { stamp_ns });
            }
            self.waiting.reverse();
            self.seq += 1;
        }
        self.waiting.pop()
    }
}

/// A second of any bus: frames of all actuators.
pub(crate) const FRAMES_PER_SECOND: u64 = ACTUATORS * (3 * RATE_HZ + RATE_HZ / STATUS_EVERY);

fn status(sample: &Sample) -> Status {
    let motor = ActuatorParams::bench().motor;
    Status {
        dc_link_dv: quantity::dc_link_dv(motor.v_dc),
        winding_temp_dc: quantity::winding_temp_dc(REFERENCE_TEMPERATURE_DEG_C),
        load_torque_dnm: Some(quantity::load_torque_dnm(0.0)),
        fault_flags: 0,
        seq8: sample.seq8(),
    }
}

/// A figure of the kernel's account of a process, KiB.
pub(crate) fn kib(status: &str, key: &str) -> u64 {
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix(key))
        .expect("a status");
    let number = line.trim().strip_suffix(" kB").expect("a unit");
    number.parse().expect("a number")
}
