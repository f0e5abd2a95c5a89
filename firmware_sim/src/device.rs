//! The device: a running simulation, sampled, with the packets that its electronics send.

use ema_models::reference::{Scenario, ScenarioRun};
use ema_models::{FAULT_COUNT, FaultVector, SensedSample, Setpoint};
use ema_wire::{ActuatorId, Mode, Sample, SerialPacket, Status, quantity};

/// Status packets per second.
const STATUS_RATE_HZ: f64 = 10.0;

/// Winding temperature at which the motor's resistance holds, °C.
const REFERENCE_TEMPERATURE_C: f64 = 20.0;

/// What is simulated, and whose it is.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Number of the actuator in its frames.
    pub actuator: ActuatorId,
    /// The actuator, its load, its sensors, what is commanded, and the seed.
    pub scenario: Scenario,
    /// Wear: what the end of each actuation adds to the fault vector, in its order; the sum stays within 0 to 1.
    pub growth: [f64; FAULT_COUNT],
}

impl Plan {
    /// A scenario without wear.
    #[must_use]
    pub fn new(actuator: ActuatorId, scenario: Scenario) -> Self {
        Self {
            actuator,
            scenario,
            growth: [0.0; FAULT_COUNT],
        }
    }

    /// Fault vector during actuation n, from 0.
    #[must_use]
    pub fn fault(&self, actuation: u64) -> FaultVector {
        let mut k = self.scenario.fault.to_array();
        for (k, growth) in k.iter_mut().zip(self.growth) {
            *k = (*k + growth * actuation as f64).clamp(0.0, 1.0);
        }
        FaultVector::from_array(k)
    }

    /// Starts the device.
    #[must_use]
    pub fn start(&self) -> Device {
        let rate_hz = self.scenario.nominal.sensors.sample_rate;
        Device {
            run: self.scenario.run(),
            rate_hz,
            status_every: ((rate_hz / STATUS_RATE_HZ + 0.5) as u64).max(1),
            status: Status {
                dc_link_dv: quantity::dc_link_dv(self.scenario.unit.motor.v_dc),
                winding_temp_dc: quantity::winding_temp_dc(REFERENCE_TEMPERATURE_C),
                load_torque_dnm: Some(quantity::load_torque_dnm(self.scenario.load_torque)),
                fault_flags: 0,
                seq8: 0,
            },
            status_at_us: None,
            actuations_done: 0,
            plan: self.clone(),
        }
    }
}

/// Something, and when it leaves the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timed<T> {
    /// Time since the first sample, µs.
    pub at_us: u64,
    /// What leaves.
    pub what: T,
}

impl<T> Timed<T> {
    /// The same time with something else.
    pub fn map<U>(self, f: impl FnOnce(T) -> U) -> Timed<U> {
        Timed {
            at_us: self.at_us,
            what: f(self.what),
        }
    }
}

/// The running device: an iterator over its packets, in the order in which they go out.
///
/// One [`SerialPacket::Sample`] per sample, and after the first sample of every tenth of a second one
/// [`SerialPacket::Status`].
#[derive(Clone, Debug)]
pub struct Device {
    plan: Plan,
    run: ScenarioRun,
    rate_hz: f64,
    status_every: u64,
    status: Status,
    /// A status packet is due after the sample that went out then.
    status_at_us: Option<u64>,
    actuations_done: u64,
}

impl Iterator for Device {
    type Item = Timed<SerialPacket>;

    fn next(&mut self) -> Option<Timed<SerialPacket>> {
        let actuator = self.plan.actuator;
        if let Some(at_us) = self.status_at_us.take() {
            let status = self.status;
            let what = SerialPacket::Status { actuator, status };
            return Some(Timed { at_us, what });
        }
        let sensed = self.run.next()?;
        let at_us = (sensed.seq as f64 * 1e6 / self.rate_hz + 0.5) as u64;
        let sample = encode(actuator, &sensed, at_us);
        if sensed.seq.is_multiple_of(self.status_every) {
            self.status.seq8 = sample.seq8();
            self.status_at_us = Some(at_us);
        }
        let done = (sensed.seq as f64 / (self.rate_hz * self.plan.scenario.actuations.period())) as u64;
        if done > self.actuations_done {
            self.actuations_done = done;
            self.run.wear(self.plan.fault(done));
        }
        let what = SerialPacket::Sample(sample);
        Some(Timed { at_us, what })
    }
}

/// A sample in wire units; counters and the device's microseconds keep their low bits.
fn encode(actuator: ActuatorId, sensed: &SensedSample, at_us: u64) -> Sample {
    let [i_a_ma, i_b_ma, i_c_ma] = sensed.currents.map(quantity::current_ma);
    let (mode, setpoint) = match sensed.setpoint {
        Setpoint::Idle => (Mode::Idle, 0),
        Setpoint::Position(angle) => (Mode::Position, quantity::position_setpoint_urad(angle)),
        Setpoint::Speed(speed) => (Mode::Speed, quantity::speed_setpoint_mrad_s(speed)),
    };
    Sample {
        actuator,
        seq: sensed.seq as u16,
        time_us: at_us as u16,
        i_a_ma,
        i_b_ma,
        i_c_ma,
        motor_counts: sensed.motor_counts as i32,
        output_counts: quantity::wrap_s24(sensed.output_counts),
        setpoint,
        mode,
    }
}
