//! Frames of many actuators at 400 Hz: one simulated unit of four kinds, repeated with counters of each actuator's own.

use std::sync::Arc;

use ema_models::reference::{Actuations, CurrentSensing, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile, REFERENCE_TEMPERATURE_DEG_C};
use ema_wire::can::Status;
use ema_wire::{ActuatorId, Frame, Sample, quantity};
use hmd_core::frame::{FrameFlags, RawFrame};
use hmd_ingest::feed::Input;
use hmd_lab::simulate::{EPOCH_NS, encode};

/// Actuators of one bus: more at 400 Hz load 1 Mbit/s beyond 90 %.
pub(crate) const PER_BUS: u64 = 4;

pub(crate) const RATE_HZ: u64 = 400;
pub(crate) const SAMPLES_PER_MINUTE: u64 = 60 * RATE_HZ;
const PERIOD_NS: u64 = 1_000_000_000 / RATE_HZ;

/// Time of one frame of eight bytes on the bus, ns.
const FRAME_NS: u64 = 120_000;

/// Samples from one status frame to the next: 10 Hz.
const STATUS_EVERY: u64 = 40;

/// Two minutes of a unit at 400 Hz: an actuation there, and one back.
pub(crate) struct Template(Vec<Sample>);

impl Template {
    /// A healthy unit, and the same with more friction, backlash and less gain; actuator n has the one of n modulo 4.
    pub(crate) fn all() -> Arc<[Self; 4]> {
        let mut faults = [FaultVector::NOMINAL.to_array(); 4];
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
                rest: 1.0,
                ..Actuations::single(Profile::Mixed)
            },
            sensing: CurrentSensing {
                noise_rms: 0.05,
                ..CurrentSensing::IDEAL
            },
            ..Scenario::new(params, FaultVector::from_array(fault), 1)
        };
        let id = ActuatorId::new(0).expect("an actuator");
        let samples: Vec<Sample> = scenario.run().map(|sensed| encode(id, &sensed, 0)).collect();
        let period = (scenario.actuations.period() * RATE_HZ as f64) as usize;
        let rest = RATE_HZ as usize;
        let mut minutes = Vec::new();
        for from in [2 * period, 3 * period] {
            let minute = &samples[from..from + period + rest];
            // The rest of a minute repeats its end.
            let held = minute[minute.len() - rest / 2..].iter().cycle();
            minutes.extend(minute.iter().chain(held).take(SAMPLES_PER_MINUTE as usize));
        }
        Self(minutes)
    }

    fn sample(&self, id: ActuatorId, delay: u64, seq: u64) -> Sample {
        let length = self.0.len() as u64;
        Sample {
            actuator: id,
            seq: seq as u16,
            time_us: (seq * PERIOD_NS / 1000) as u16,
            ..self.0[((seq + length - delay) % length) as usize]
        }
    }
}

/// Traffic of one bus, in its order; the first has a tick each second of it as well.
pub(crate) struct Bus {
    pub(crate) templates: Arc<[Template; 4]>,
    /// Index of the bus.
    pub(crate) bus: u64,
    /// All actuators of all buses.
    pub(crate) actuators: u64,
    /// Whether the actuations are spread over the minute, or all at once.
    pub(crate) spread: bool,
    pub(crate) seq: u64,
    pub(crate) end: u64,
    /// What one sample of all actuators brings, last first.
    pub(crate) waiting: Vec<Input>,
    /// Called before each second of traffic, with its number.
    pub(crate) before: Box<dyn FnMut(u64) + Send>,
}

impl Bus {
    fn fill(&mut self) {
        let mut stamp_ns = EPOCH_NS + self.seq * PERIOD_NS;
        let first = self.bus * PER_BUS;
        for actuator in first..self.actuators.min(first + PER_BUS) {
            let id = ActuatorId::new((actuator - first) as u8).expect("an actuator");
            let delay = if self.spread {
                actuator * SAMPLES_PER_MINUTE / self.actuators
            } else {
                0
            };
            let sample = self.templates[(actuator % 4) as usize].sample(id, delay, self.seq);
            let with_status = self.seq.is_multiple_of(STATUS_EVERY);
            let status = with_status.then(|| Frame::Status(status(&sample)));
            for frame in sample.to_frames().into_iter().chain(status) {
                let mut bytes = [0; 64];
                let id = u32::from(frame.message().id(sample.actuator));
                let frame = RawFrame::new(stamp_ns, 0, id, FrameFlags::NONE, frame.emit(&mut bytes));
                self.waiting.push(Input::Frame(frame.expect("a classic frame")));
                stamp_ns += FRAME_NS;
            }
        }
        if self.bus == 0 && self.seq.is_multiple_of(RATE_HZ) {
            self.waiting.push(Input::Tick { stamp_ns });
        }
        self.waiting.reverse();
        self.seq += 1;
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
            self.fill();
        }
        self.waiting.pop()
    }
}

fn status(sample: &Sample) -> Status {
    Status {
        dc_link_dv: quantity::dc_link_dv(ActuatorParams::bench().motor.v_dc),
        winding_temp_dc: quantity::winding_temp_dc(REFERENCE_TEMPERATURE_DEG_C),
        load_torque_dnm: Some(quantity::load_torque_dnm(0.0)),
        fault_flags: 0,
        seq8: sample.seq8(),
    }
}
