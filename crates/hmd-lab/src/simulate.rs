//! A simulated actuator's traffic: the reference model's samples as the frames its control electronics would send.

use ema_models::reference::{LoadEffects, Scenario, ScenarioRun};
use ema_models::{SensedSample, Setpoint};
use ema_wire::can::Status;
use ema_wire::{ActuatorId, Frame, Mode, Sample, quantity};

use hmd_core::frame::{FrameFlags, RawFrame};

/// UTC time of a simulated log's first sample: 2023-11-14 22:13:20, ns.
pub const EPOCH_NS: u64 = 1_700_000_000_000_000_000;

/// Time one classic frame of eight bytes takes on a 1 Mbit/s bus, ns (whole microseconds).
const FRAME_TIME_NS: u64 = 120_000;

/// Period of the status frames, s.
const STATUS_PERIOD_S: f64 = 0.1;

/// Frames of one simulated actuator, in bus order.
#[derive(Debug)]
pub struct Traffic<I> {
    samples: I,
    actuator: ActuatorId,
    period_ns: u64,
    start_ns: u64,
    status_every: u64,
    status: Status,
    queue: std::collections::VecDeque<RawFrame>,
}

/// The traffic of a scenario from the given time on, bus 0.
///
/// Its status reports the temperature of the unit, the supply that the scenario has without its effects, and the load unless an
/// effect adds to it: nothing measures that one.
#[must_use]
pub fn traffic(scenario: &Scenario, actuator: ActuatorId, start_ns: u64) -> Traffic<ScenarioRun> {
    let rate_hz = scenario.nominal.sensors.sample_rate;
    Traffic::of_samples(scenario.run(), rate_hz, actuator, start_ns, status_of(scenario))
}

/// What the status frames of a scenario report.
#[must_use]
pub fn status_of(scenario: &Scenario) -> Status {
    let has_measured_load = scenario.effects.load == LoadEffects::default();
    Status {
        dc_link_dv: quantity::dc_link_dv(scenario.unit.motor.v_dc),
        winding_temp_dc: quantity::winding_temp_dc(scenario.temperature_deg_c()),
        load_torque_dnm: has_measured_load.then(|| quantity::load_torque_dnm(scenario.load_torque)),
        fault_flags: 0,
        seq8: 0,
    }
}

impl<I: Iterator<Item = SensedSample>> Iterator for Traffic<I> {
    type Item = RawFrame;

    fn next(&mut self) -> Option<RawFrame> {
        if self.queue.is_empty() {
            let sensed = self.samples.next()?;
            let since_start_ns = sensed.seq * self.period_ns;
            let sample = encode(self.actuator, &sensed, since_start_ns / 1000);
            let mut stamp_ns = self.start_ns + since_start_ns;
            for frame in sample.to_frames() {
                self.enqueue(&frame, stamp_ns);
                stamp_ns += FRAME_TIME_NS;
            }
            if sensed.seq % self.status_every == 0 {
                self.status.seq8 = sample.seq8();
                self.enqueue(&Frame::Status(self.status), stamp_ns);
            }
        }
        self.queue.pop_front()
    }
}

impl Traffic<ScenarioRun> {
    /// Time at which the frames ended because the simulated state was no longer finite, s.
    #[must_use]
    pub fn diverged(&self) -> Option<f64> {
        self.samples.diverged()
    }
}

impl<I: Iterator<Item = SensedSample>> Traffic<I> {
    /// The traffic of these samples, taken at `rate_hz`, with this status.
    #[must_use]
    pub fn of_samples(samples: I, rate_hz: f64, actuator: ActuatorId, start_ns: u64, status: Status) -> Self {
        Self {
            samples,
            actuator,
            period_ns: (1e9 / rate_hz).round() as u64,
            start_ns,
            status_every: ((STATUS_PERIOD_S * rate_hz).round() as u64).max(1),
            status,
            // At most one sample's frames wait here.
            queue: std::collections::VecDeque::with_capacity(4),
        }
    }
}

impl<I> Traffic<I> {
    fn enqueue(&mut self, frame: &Frame, stamp_ns: u64) {
        let id = u32::from(frame.message().id(self.actuator));
        let mut bytes = [0; 64];
        if let Ok(raw) = RawFrame::new(stamp_ns, 0, id, FrameFlags::NONE, frame.emit(&mut bytes)) {
            self.queue.push_back(raw);
        }
    }
}

/// A sample in wire units.
#[must_use]
pub fn encode(actuator: ActuatorId, sensed: &SensedSample, time_us: u64) -> Sample {
    let [i_a_ma, i_b_ma, i_c_ma] = sensed.currents.map(quantity::current_ma);
    let (mode, setpoint) = match sensed.setpoint {
        Setpoint::Idle => (Mode::Idle, 0),
        Setpoint::Position(angle) => (Mode::Position, quantity::position_setpoint_urad(angle)),
        Setpoint::Speed(speed) => (Mode::Speed, quantity::speed_setpoint_mrad_s(speed)),
    };
    Sample {
        actuator,
        seq: sensed.seq as u16,
        time_us: time_us as u16,
        i_a_ma,
        i_b_ma,
        i_c_ma,
        motor_counts: sensed.motor_counts as i32,
        output_counts: quantity::wrap_s24(sensed.output_counts),
        setpoint,
        mode,
    }
}
