//! Section `[bus]`: bit rates of CAN, and how full the configured actuators make each bus.

use std::collections::BTreeMap;

use ema_wire::bus_load::{Stuffing, bus_load, classic_frame_bits, fd_bus_load, fd_frame_seconds};
use ema_wire::can::CLASSIC_LEN;
use serde::Serialize;

use super::reader::Section;
use super::{ActuatorConfig, ConfigError, SerialConfig};
use crate::dbc::{MessageUse, SignalMap};
use crate::drive_bus::{Coding, DriveBus, DriveMessage};

/// Largest load of an interface that is accepted; 1.0 is a full bus.
pub const LOAD_MAX: f64 = 0.9;

/// Bit rates of the CAN interfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct BusConfig {
    /// Bit rate, of the arbitration phase with FD, bit/s.
    pub bitrate_bit_s: u32,
    /// Whether samples come in CAN FD frames.
    pub fd: bool,
    /// Bit rate of the data phase of FD frames, bit/s; without meaning unless `fd`.
    pub data_bitrate_bit_s: u32,
}

/// How full one interface is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BusLoad {
    /// Interface; `None` for the actuators without one, which count as sharing one.
    pub bus: Option<String>,
    /// Actuators on it.
    pub actuators: usize,
    /// Load with nominal bit stuffing, of a serial line with the longest frames; 1.0 is full.
    pub load: f64,
    /// Its bit rate, bit/s.
    pub bitrate_bit_s: u32,
}

impl BusLoad {
    /// Interface name, `(any)` for none.
    #[must_use]
    pub fn name(&self) -> &str {
        self.bus.as_deref().unwrap_or("(any)")
    }
}

impl Default for BusConfig {
    fn default() -> Self {
        Self {
            bitrate_bit_s: 1_000_000,
            fd: false,
            data_bitrate_bit_s: 5_000_000,
        }
    }
}

impl BusConfig {
    pub(super) const KEYS: &[&str] = &["bitrate_bit_s", "fd", "data_bitrate_bit_s", "eds"];

    pub(super) fn read(section: &Section<'_>) -> Result<Self, ConfigError> {
        let default = Self::default();
        let bus = Self {
            bitrate_bit_s: section
                .integer("bitrate_bit_s", 10_000..=1_000_000)?
                .unwrap_or(default.bitrate_bit_s),
            fd: section.flag("fd", default.fd)?,
            data_bitrate_bit_s: section
                .integer("data_bitrate_bit_s", 10_000..=8_000_000)?
                .unwrap_or(default.data_bitrate_bit_s),
        };
        if bus.data_bitrate_bit_s < bus.bitrate_bit_s {
            return Err(section.refuse(
                "data_bitrate_bit_s",
                &format!("at least bitrate_bit_s = {}", bus.bitrate_bit_s),
            ));
        }
        Ok(bus)
    }

    /// Load of a bus by one actuator that sends `sample_rate_hz` samples a second; 1.0 is full.
    #[must_use]
    pub fn load_of_one(&self, sample_rate_hz: f64) -> f64 {
        let bitrate = f64::from(self.bitrate_bit_s);
        if self.fd {
            fd_bus_load(sample_rate_hz, 1, bitrate, f64::from(self.data_bitrate_bit_s))
        } else {
            bus_load(sample_rate_hz, 1, bitrate)
        }
    }

    /// Load of a bus by the samples of one mapped actuator, one frame of each of their messages and multiplexor values.
    fn load_of_map(&self, map: &SignalMap, sample_rate_hz: f64) -> f64 {
        let per_sample: f64 = map
            .messages
            .iter()
            .map(|message| message.frames_per_sample() as f64 * self.frame_s(message))
            .sum();
        per_sample * sample_rate_hz
    }

    /// Load of a bus by the samples of one drive: its frames with parts of them, and one command.
    fn load_of_drive(&self, drive: &DriveBus, sample_rate_hz: f64) -> f64 {
        /// Bytes of a subframe's head and of a register.
        const REGISTER_BYTES: usize = 6;
        let bytes = |message: &DriveMessage| match message.coding {
            Coding::Bits { length } => length,
            Coding::Registers { .. } => REGISTER_BYTES * message.fields.len(),
        };
        let sampled = drive.layout().sampled();
        let per_sample: f64 = sampled
            .map(|message| self.seconds(bytes(message), message.extended == Some(true)))
            .sum();
        (per_sample + self.seconds(CLASSIC_LEN, false)) * sample_rate_hz
    }

    /// Time that a frame takes, s.
    fn frame_s(&self, message: &MessageUse) -> f64 {
        self.seconds(message.length, message.extended)
    }

    /// Time that a frame of so many bytes takes, s; of more than eight bytes it can only be FD.
    fn seconds(&self, length: usize, extended: bool) -> f64 {
        /// Further bits of a long identifier, stuffing included.
        const EXTENSION_BITS: f64 = 22.0;
        let (bitrate, bytes) = (f64::from(self.bitrate_bit_s), length as u32);
        let frame_s = if length > CLASSIC_LEN {
            fd_frame_seconds(bytes, bitrate, f64::from(self.data_bitrate_bit_s))
        } else {
            f64::from(classic_frame_bits(bytes, Stuffing::Nominal)) / bitrate
        };
        let extension_s = if extended { EXTENSION_BITS / bitrate } else { 0.0 };
        frame_s + extension_s
    }

    pub(super) fn loads(&self, actuators: &[ActuatorConfig], serial: &[SerialConfig]) -> Vec<BusLoad> {
        let line = |bus: Option<&str>| serial.iter().find(|line| Some(line.bus.as_str()) == bus);
        let mut by_bus: BTreeMap<Option<&str>, (usize, f64)> = BTreeMap::new();
        // The samples of a log of signals are on no bus.
        let is_on_bus = |actuator: &&ActuatorConfig| actuator.log.is_none() || actuator.drive_bus.is_some();
        for actuator in actuators.iter().filter(is_on_bus) {
            let (count, load) = by_bus.entry(actuator.bus.as_deref()).or_default();
            *count += 1;
            let sample_rate_hz = actuator.params.sensors.sample_rate;
            *load += match line(actuator.bus.as_deref()) {
                Some(line) => line.load_of_one(sample_rate_hz),
                None => match (&actuator.map, &actuator.drive_bus) {
                    (Some(map), _) => self.load_of_map(map, sample_rate_hz),
                    (None, Some(drive)) => self.load_of_drive(drive, sample_rate_hz),
                    (None, None) => self.load_of_one(sample_rate_hz),
                },
            };
        }
        let to_load = |(bus, (actuators, load)): (Option<&str>, _)| BusLoad {
            bus: bus.map(str::to_owned),
            actuators,
            load,
            bitrate_bit_s: line(bus).map_or(self.bitrate_bit_s, |line| line.bitrate_bit_s),
        };
        by_bus.into_iter().map(to_load).collect()
    }
}

#[cfg(test)]
mod tests {
    use crate::config::Config;

    #[test]
    fn the_samples_of_a_log_load_no_bus() {
        let actuator = "[[actuator]]\nid = 0\n[type.bench.sensors]\nsample_rate_hz = 5000\n";
        let map = "[map]\ntime = \"t\"\ncurrents.q = \"i\"\nposition.motor = \"m\"\n";
        assert!(
            Config::from_toml_str(actuator, "a.toml").is_err(),
            "more than a bus carries"
        );
        let of_log = Config::from_toml_str(&format!("{actuator}{map}"), "a.toml").unwrap();
        assert!(of_log.bus_loads().is_empty());
    }
}
