//! Frames of several actuators: recorded actuations of the reference model, over and over.

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use ema_models::reference::{Actuations, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile, SensedSample};
use ema_wire::can::Status;
use ema_wire::{ActuatorId, Frame, quantity};
use firmware_sim::encode;
use hmd_core::frame::{FrameFlags, RawFrame};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Samples a second of each actuator.
pub const RATE_HZ: u64 = 400;
/// Time of a sample.
pub const PERIOD: Duration = Duration::from_nanos(1_000_000_000 / RATE_HZ);

/// Different recordings.
const RECORDINGS: usize = 3;
/// Actuations of a recording; an even number ends where it began.
const ACTUATIONS: u32 = 6;
const REST_S: f64 = 0.6;
const LENGTH_S: f64 = 0.5;

fn recordings() -> &'static [Arc<Vec<SensedSample>>] {
    static RECORDED: OnceLock<Vec<Arc<Vec<SensedSample>>>> = OnceLock::new();
    RECORDED.get_or_init(|| {
        let mut params = ActuatorParams::bench();
        params.sensors.sample_rate = RATE_HZ as f64;
        let recorded = |seed| {
            let scenario = Scenario {
                actuations: Actuations {
                    profile: Profile::Mixed,
                    count: ACTUATIONS,
                    rest: REST_S,
                    length: LENGTH_S,
                },
                ..Scenario::new(params, FaultVector::NOMINAL, seed)
            };
            Arc::new(scenario.run().collect())
        };
        (0..RECORDINGS as u64).map(recorded).collect()
    })
}

/// One actuator on its bus.
#[derive(Clone, Debug)]
pub struct Device {
    id: ActuatorId,
    recording: Arc<Vec<SensedSample>>,
    at: usize,
    /// Samples that it rests beyond the recording.
    rests: u32,
    /// Samples since its start.
    pub sent: u64,
}

impl Device {
    /// One of the sixteen of a bus.
    #[must_use]
    pub fn new(id: ActuatorId, rng: &mut ChaCha8Rng) -> Self {
        let recording = recordings()[rng.random_range(0..RECORDINGS)].clone();
        Self {
            id,
            recording,
            at: 0,
            rests: rng.random_range(0..400),
            // Its counter wraps in some runs.
            sent: rng.random_range(0..1 << 17),
        }
    }

    /// It starts again: its counters begin anew.
    pub fn reset(&mut self) {
        (self.sent, self.at) = (0, 0);
    }

    /// Whether its last sample may be the one that it would have sent, had it begun anew within the time before: behind a silence in which the
    /// receiver's clock steps, nothing tells that from going on. Half a second and a tenth of the time are what a receiver allows.
    pub fn may_have_begun_within(&self, time: Duration) -> bool {
        let allowed = time.mul_f64(1.1) + Duration::from_millis(500);
        let counter = (self.sent - 1) % (1 << 16);
        counter <= allowed.as_millis() as u64 * RATE_HZ / 1000
    }

    /// The frames of its next sample, the first at this time of the bus, ns.
    pub fn next_sample(&mut self, stamp_ns: &mut u64, rng: &mut ChaCha8Rng, frames: &mut Vec<RawFrame>) {
        let rest = (REST_S * RATE_HZ as f64) as usize;
        let seq = self.sent;
        let sensed = SensedSample {
            seq,
            ..self.recording[self.at]
        };
        self.sent += 1;
        if self.rests > 0 {
            // The last tenth of a second before an actuation is left to the recording.
            self.rests -= 1;
            self.at = (self.at + 1) % (rest / 2);
        } else {
            self.at += 1;
            if self.at == self.recording.len() {
                (self.at, self.rests) = (0, rng.random_range(0..400));
            }
        }
        let sample = encode(self.id, &sensed, seq * 1_000_000 / RATE_HZ);
        for frame in sample.to_frames() {
            push(self.id, &frame, stamp_ns, frames);
        }
        if seq.is_multiple_of(RATE_HZ / 10) {
            let status = Status {
                dc_link_dv: quantity::dc_link_dv(ActuatorParams::bench().motor.v_dc),
                winding_temp_dc: quantity::winding_temp_dc(20.0),
                load_torque_dnm: None,
                fault_flags: 0,
                seq8: sample.seq8(),
            };
            push(self.id, &Frame::Status(status), stamp_ns, frames);
        }
    }
}

/// Time of a classic frame at 1 Mbit/s, ns.
const FRAME_NS: u64 = 120_000;

fn push(id: ActuatorId, frame: &Frame, stamp_ns: &mut u64, frames: &mut Vec<RawFrame>) {
    let mut bytes = [0; 64];
    let can_id = u32::from(frame.message().id(id));
    frames.extend(RawFrame::new(
        *stamp_ns,
        0,
        can_id,
        FrameFlags::NONE,
        frame.emit(&mut bytes),
    ));
    *stamp_ns += FRAME_NS;
}
