//! A whole stream of bytes at once, for files and tests.

use std::io::{self, Write};

use ema_models::reference::Scenario;
use ema_wire::serial::MAX_FRAME_LEN;
use ema_wire::{ActuatorId, SerialPacket};

use crate::device::Plan;

/// The packets of a scenario without wear, in the order in which they go out.
pub fn packets(scenario: &Scenario, actuator: ActuatorId) -> impl Iterator<Item = SerialPacket> + use<> {
    Plan::new(actuator, scenario.clone()).start().map(|timed| timed.what)
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
