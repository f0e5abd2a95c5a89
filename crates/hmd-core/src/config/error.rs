//! Why a configuration was refused.

use thiserror::Error;

use crate::frame::BusError;

/// Why a configuration was refused; displays as one sentence with file, line, key, expected and found.
#[derive(Debug, Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{file}: cannot be read: {source}")]
    Read {
        /// File name as given.
        file: String,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The text is not TOML.
    #[error("{file}:{line}: not valid TOML: {message}")]
    Syntax {
        /// File name as given.
        file: String,
        /// Line, from 1.
        line: usize,
        /// What the parser expected.
        message: String,
    },
    /// There is no such key.
    #[error("{file}:{line}: {key}: unknown key; {hint}")]
    UnknownKey {
        /// File name as given.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Path of the key.
        key: String,
        /// The closest known key, or all that are known here.
        hint: String,
    },
    /// A value of the wrong type, out of range, or against another value.
    #[error("{file}:{line}: {key}: expected {expected}, found {found}")]
    Value {
        /// File name as given.
        file: String,
        /// Line of the value or, when the file does not set it, of its section.
        line: usize,
        /// Path of the key.
        key: String,
        /// What the value must be.
        expected: String,
        /// What it is.
        found: String,
    },
    /// The computed load of a bus exceeds 90 %.
    #[error(
        "{file}: bus {bus}: expected a load of at most 90 %, found {load_percent:.0} % of {bitrate_bit_s} bit/s by \
         {actuators} actuator{}; lower sensors.sample_rate_hz of their type, or set actuator.bus to spread them over \
         several interfaces", if *actuators == 1 { "" } else { "s" }
    )]
    BusLoad {
        /// File name as given.
        file: String,
        /// Interface.
        bus: String,
        /// Actuators on it.
        actuators: usize,
        /// Computed load, %.
        load_percent: f64,
        /// Configured bit rate, bit/s.
        bitrate_bit_s: u32,
    },
    /// No actuator is named.
    #[error("{file}: expected an [[actuator]] with its bus to watch live, found none")]
    NoActuator {
        /// File name as given.
        file: String,
    },
    /// An actuator has no interface.
    #[error("{file}: expected a bus for every [[actuator]] that is watched live, found none for {actuator}")]
    NoBus {
        /// File name as given.
        file: String,
        /// The actuator.
        actuator: String,
    },
    /// An interface that cannot exist.
    #[error("{file}: bus {bus:?}: {cause}")]
    BadBus {
        /// File name as given.
        file: String,
        /// The name.
        bus: String,
        /// What is wrong with it.
        cause: BusError,
    },
}
