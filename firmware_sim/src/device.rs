//! The device: from a [`Plan`] to the timed packets that the actuator's electronics send.

use ema_models::reference::{LoadEffects, Scenario, ScenarioRun};
use ema_models::{FAULT_COUNT, FaultVector, SensedSample, Setpoint};
use ema_wire::{ActuatorId, Mode, Sample, SerialPacket, Status, quantity};

/// Status packets per second.
const STATUS_RATE_HZ: f64 = 10.0;

/// Input of a simulated device.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Number of the actuator in its frames.
    pub actuator: ActuatorId,
    /// The actuator, its effects, its load, its sensors, its commands, and the seed.
    pub scenario: Scenario,
    /// Wear per actuation, in fault-vector order: added to the fault vector at the end of each actuation and limited to 0
    /// to 1.
    pub growth: [f64; FAULT_COUNT],
}

impl Plan {
    /// A plan without wear.
    #[must_use]
    pub fn new(actuator: ActuatorId, scenario: Scenario) -> Self {
        Self {
            actuator,
            scenario,
            growth: [0.0; FAULT_COUNT],
        }
    }

    /// Fault vector during an actuation, numbered from 0.
    #[must_use]
    pub fn fault_during(&self, actuation: u64) -> FaultVector {
        let mut k = self.scenario.fault.to_array();
        for (k, growth) in k.iter_mut().zip(self.growth) {
            *k = (*k + growth * actuation as f64).clamp(0.0, 1.0);
        }
        FaultVector::from_array(k)
    }

    /// The device at its first sample.
    #[must_use]
    pub fn start(&self) -> Device {
        let rate_hz = self.scenario.nominal.sensors.sample_rate;
        // Nothing measures a load that an effect adds.
        let has_measured_load = self.scenario.effects.load == LoadEffects::default();
        Device {
            run: self.scenario.run(),
            rate_hz,
            status_every: ((rate_hz / STATUS_RATE_HZ + 0.5) as u64).max(1),
            status: Status {
                dc_link_dv: quantity::dc_link_dv(self.scenario.unit.motor.v_dc),
                winding_temp_dc: quantity::winding_temp_dc(self.scenario.temperature_deg_c()),
                load_torque_dnm: has_measured_load.then(|| quantity::load_torque_dnm(self.scenario.load_torque)),
                fault_flags: 0,
                seq8: 0,
            },
            status_at_us: None,
            actuations_done: 0,
            plan: self.clone(),
        }
    }
}

/// A packet or frame with the time at which it is sent or received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timed<T> {
    /// Time since the first sample, µs.
    pub at_us: u64,
    /// The packet or frame.
    pub value: T,
}

impl<T> Timed<T> {
    /// Another value at the same time.
    pub fn map<U>(self, f: impl FnOnce(T) -> U) -> Timed<U> {
        Timed {
            at_us: self.at_us,
            value: f(self.value),
        }
    }
}

/// The running device: an iterator over its packets, in the order of transmission.
///
/// It yields one [`SerialPacket::Sample`] per sample, and one [`SerialPacket::Status`] after the first sample of every tenth
/// of a second.
#[derive(Clone, Debug)]
pub struct Device {
    plan: Plan,
    run: ScenarioRun,
    rate_hz: f64,
    status_every: u64,
    status: Status,
    /// Time of the sample after which a status packet is due, µs.
    status_at_us: Option<u64>,
    actuations_done: u64,
}

impl Iterator for Device {
    type Item = Timed<SerialPacket>;

    fn next(&mut self) -> Option<Timed<SerialPacket>> {
        let actuator = self.plan.actuator;
        if let Some(at_us) = self.status_at_us.take() {
            let status = self.status;
            let value = SerialPacket::Status { actuator, status };
            return Some(Timed { at_us, value });
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
            self.run.set_fault(self.plan.fault_during(done));
        }
        let value = SerialPacket::Sample(sample);
        Some(Timed { at_us, value })
    }
}

/// A sample in wire units, latched at `at_us` of the device's clock; of counters and device time it has the low bits.
#[must_use]
pub fn encode(actuator: ActuatorId, sensed: &SensedSample, at_us: u64) -> Sample {
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
