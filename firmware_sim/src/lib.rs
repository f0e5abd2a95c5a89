//! The simulated actuator on a serial line: the reference model's samples as the packets its control electronics send.
//!
//! One [`SerialPacket::Sample`] per sample of a [`Scenario`], and after every tenth of a second's first sample one
//! [`SerialPacket::Status`]. A pure function of the scenario: no clock, no I/O except [`write_stream`]'s writer.

use std::io::{self, Write};

use ema_models::reference::Scenario;
use ema_models::{SensedSample, Setpoint};
use ema_wire::serial::MAX_FRAME_LEN;
use ema_wire::{ActuatorId, Mode, Sample, SerialPacket, Status, quantity};

/// Status packets per second.
const STATUS_RATE_HZ: f64 = 10.0;

/// Winding temperature at which the motor's resistance holds, °C.
const REFERENCE_TEMPERATURE_C: f64 = 20.0;

/// The packets of a scenario, in the order in which they go out.
pub fn packets(scenario: &Scenario, actuator: ActuatorId) -> impl Iterator<Item = SerialPacket> + use<> {
    let sample_rate = scenario.nominal.sensors.sample_rate;
    let status_every = ((sample_rate / STATUS_RATE_HZ).round() as u64).max(1);
    let dc_link_dv = quantity::dc_link_dv(scenario.unit.motor.v_dc);
    let load_torque_dnm = Some(quantity::load_torque_dnm(scenario.load_torque));
    scenario.run().flat_map(move |sensed| {
        let sample = encode(actuator, &sensed, sample_rate);
        let status = sensed.seq.is_multiple_of(status_every).then(|| SerialPacket::Status {
            actuator,
            status: Status {
                dc_link_dv,
                winding_temp_dc: quantity::winding_temp_dc(REFERENCE_TEMPERATURE_C),
                load_torque_dnm,
                fault_flags: 0,
                seq8: sample.seq8(),
            },
        });
        std::iter::once(SerialPacket::Sample(sample)).chain(status)
    })
}

/// Writes the packets of a scenario as one stream of bytes.
///
/// # Errors
/// What the writer says.
pub fn write_stream(scenario: &Scenario, actuator: ActuatorId, out: &mut impl Write) -> io::Result<()> {
    let mut buffer = [0; MAX_FRAME_LEN];
    for packet in packets(scenario, actuator) {
        out.write_all(packet.emit(&mut buffer).map_err(io::Error::other)?)?;
    }
    out.flush()
}

/// A sample in wire units; counters and the device's microseconds keep their low bits.
fn encode(actuator: ActuatorId, sensed: &SensedSample, sample_rate: f64) -> Sample {
    let [i_a_ma, i_b_ma, i_c_ma] = sensed.currents.map(quantity::current_ma);
    let (mode, setpoint) = match sensed.setpoint {
        Setpoint::Idle => (Mode::Idle, 0),
        Setpoint::Position(angle) => (Mode::Position, quantity::position_setpoint_urad(angle)),
        Setpoint::Speed(speed) => (Mode::Speed, quantity::speed_setpoint_mrad_s(speed)),
    };
    Sample {
        actuator,
        seq: sensed.seq as u16,
        time_us: (sensed.seq as f64 * 1e6 / sample_rate).round() as u64 as u16,
        i_a_ma,
        i_b_ma,
        i_c_ma,
        motor_counts: sensed.motor_counts as i32,
        output_counts: quantity::wrap_s24(sensed.output_counts),
        setpoint,
        mode,
    }
}
