//! The serial lines: every `[[serial]]`.

use std::path::PathBuf;

use ema_wire::bus_load::serial_load;
use serde::Serialize;

use super::reader::Section;
use super::{ActuatorConfig, ConfigError};
use crate::frame::BusNames;

/// Rate that carries one actuator at 2 kHz, bit/s; the first that common USB adapters offer.
pub const DEFAULT_BITRATE_BIT_S: u32 = 921_600;

/// A serial line: a bus that is a terminal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SerialConfig {
    /// Name of the bus, to which `actuator.bus` refers.
    pub bus: String,
    /// Terminal or pseudo-terminal; a relative path starts at the directory of the file.
    pub device: PathBuf,
    /// Bit rate, bit/s.
    pub bitrate_bit_s: u32,
}

const KEYS: &[&str] = &["bus", "device", "bitrate_bit_s"];

impl SerialConfig {
    fn read(section: &Section<'_>) -> Result<Self, ConfigError> {
        let expected = "a name of 1 to 15 printable characters without '/' and blanks";
        let bus = section.text("bus")?.filter(|bus| BusNames::new().intern(bus).is_ok());
        Ok(Self {
            bus: bus.ok_or_else(|| section.refuse("bus", expected))?,
            device: section
                .text("device")?
                .map(PathBuf::from)
                .ok_or_else(|| section.refuse("device", "the path of a terminal"))?,
            bitrate_bit_s: section
                .integer("bitrate_bit_s", 1200..=12_000_000)?
                .unwrap_or(DEFAULT_BITRATE_BIT_S),
        })
    }

    /// Load of the line by one actuator that sends `sample_rate_hz` samples a second; 1.0 is full.
    #[must_use]
    pub fn load_of_one(&self, sample_rate_hz: f64) -> f64 {
        serial_load(sample_rate_hz, 1, f64::from(self.bitrate_bit_s))
    }
}

/// Every `[[serial]]`; each has actuators, and a name and a device of its own.
pub(super) fn read_all(root: &Section<'_>, actuators: &[ActuatorConfig]) -> Result<Vec<SerialConfig>, ConfigError> {
    let mut lines: Vec<SerialConfig> = Vec::new();
    for section in root.list("serial", KEYS)?.unwrap_or_default() {
        let line = SerialConfig::read(&section)?;
        if lines.iter().any(|other| other.bus == line.bus) {
            return Err(section.refuse("bus", "a name that no other serial line has"));
        }
        if lines.iter().any(|other| other.device == line.device) {
            return Err(section.refuse("device", "a device that no other serial line has"));
        }
        let mut on_it = actuators
            .iter()
            .filter(|actuator| actuator.bus.as_ref() == Some(&line.bus))
            .peekable();
        if on_it.peek().is_none() {
            return Err(section.refuse("bus", "the bus of an [[actuator]]"));
        }
        if on_it.any(|actuator| actuator.map.is_some() || actuator.drive_bus.is_some()) {
            return Err(section.refuse(
                "bus",
                "the bus of actuators without a DBC file or a drive, which are of CAN",
            ));
        }
        lines.push(line);
    }
    Ok(lines)
}
