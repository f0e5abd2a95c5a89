//! A complete stream of packets or bytes, for files and tests.

use std::io::{self, Write};

use ema_models::reference::Scenario;
use ema_wire::serial::MAX_FRAME_LEN;
use ema_wire::{ActuatorId, SerialPacket};

use crate::device::Plan;

/// The packets of a scenario without wear, in the order of transmission.
pub fn packets(scenario: &Scenario, actuator: ActuatorId) -> impl Iterator<Item = SerialPacket> + use<> {
    Plan::new(actuator, scenario.clone()).start().map(|timed| timed.value)
}

/// Writes the packets of a scenario without wear as one byte stream.
///
/// # Errors
/// Those of the writer.
pub fn write_stream(scenario: &Scenario, actuator: ActuatorId, out: &mut impl Write) -> io::Result<()> {
    let mut buffer = [0; MAX_FRAME_LEN];
    for packet in packets(scenario, actuator) {
        out.write_all(packet.emit(&mut buffer).map_err(io::Error::other)?)?;
    }
    out.flush()
}
