//! TOML to a checked [`Config`]; every key has a default, and no key is ignored.
//!
//! The one way to a `Config` is through the checks, so nothing behind it tests a setting again. Sections are read by
//! hand from the spanned document instead of by derived `Deserialize`: a value out of range is then reported with its
//! line and key like a syntax error. `docs/config.md` is the reference of every key, `fixtures/hmd.toml` an example.

mod actuator;
mod actuator_type;
mod bus;
mod describe;
mod drive;
mod drive_bus;
mod effective;
mod error;
mod health;
mod identification;
mod map;
mod name;
mod output;
mod params;
mod reader;
mod rul;
mod serial;
mod set;
mod signals;
mod specification;
mod spelling;
mod storage_limits;
mod tolerances;
mod window;

pub use actuator::{ActuatorConfig, Learning};
pub use actuator_type::ActuatorType;
pub use bus::{BusConfig, BusLoad, LOAD_MAX};
pub use effective::{EffectiveParameter, Origin, parameters_of_unit, write_parameters};
pub use error::ConfigError;
pub use health::HealthConfig;
pub use identification::{IdentificationConfig, MONITOR_NAMES, SearchMethod, SearchObjective};
pub use output::OutputConfig;
pub use rul::{HoursOf, RulConfig};
pub use serial::{DEFAULT_BITRATE_BIT_S, SerialConfig};
pub use specification::Specification;
pub use storage_limits::Limits;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ema_wire::ActuatorId;
use serde::Serialize;
use sha2::{Digest, Sha256};

use crate::dbc::SignalMap;
use crate::drive_bus::{DriveBus, DriveJoiner};
use crate::frame::BusNames;
use crate::log_map::LogMap;
use crate::metadata_checksum::hex;
use crate::window::WindowConfig;
use reader::{Document, Section};

/// Everything that the user decides, checked.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Config {
    /// Whether there is no `[[actuator]]`, and `actuators` holds all sixteen instead.
    auto: bool,
    actuators: Vec<ActuatorConfig>,
    #[serde(rename = "type")]
    types: BTreeMap<String, ActuatorType>,
    window: WindowConfig,
    identification: IdentificationConfig,
    health: HealthConfig,
    rul: RulConfig,
    output: OutputConfig,
    bus: BusConfig,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    serial: Vec<SerialConfig>,
    /// The files that were read. Not part of the hash.
    #[serde(skip)]
    files: Vec<PathBuf>,
    /// Where relative paths start. Not part of the hash: moving a configuration does not change it.
    #[serde(skip)]
    directory: PathBuf,
}

impl Config {
    const KEYS: &'static [&'static str] = &[
        "actuator",
        "type",
        "window",
        "identification",
        "health",
        "rul",
        "output",
        "bus",
        "serial",
        "map",
    ];

    /// Checks `text`; `file_name` is what errors call it. A DBC file that it names is not read, but refused:
    /// [`Config::from_texts`] takes a reader of files.
    ///
    /// ```
    /// use hmd_core::config::Config;
    /// let config = Config::from_toml_str("[window]\nduration_ms = 300", "hmd.toml")?;
    /// assert_eq!(config.window().pre_trigger_ms, 20.0);
    /// let error = Config::from_toml_str("[window]\nduration_ms = -3", "hmd.toml").unwrap_err();
    /// assert_eq!(
    ///     error.to_string(),
    ///     "hmd.toml:2: window.duration_ms: expected a number from 20 to 10000, found -3"
    /// );
    /// # Ok::<(), hmd_core::config::ConfigError>(())
    /// ```
    ///
    /// # Errors
    /// [`ConfigError`] for the first thing that is wrong.
    pub fn from_toml_str(text: &str, file_name: &str) -> Result<Self, ConfigError> {
        let no_files = |_: &Path| Err("files cannot be read here".to_owned());
        let mut config = Self::from_texts(&[(file_name.to_owned(), text.to_owned())], &[], &no_files)?;
        // The text is no file that a run would read.
        config.files.clear();
        Ok(config)
    }

    /// Checks the texts of several files, each with the name that errors call it: what a later one sets again holds, and
    /// its `[[actuator]]`s are further ones. Relative paths start at the directory of the first. `settings` are of the form
    /// `KEY=VALUE` and hold over all files; errors call the n-th of them `--set:n`. `read_dbc` reads a DBC file, or returns why
    /// it cannot.
    ///
    /// # Errors
    /// [`ConfigError`] with file, line, key, what was expected and what was found.
    pub fn from_texts(
        files: &[(String, String)],
        settings: &[String],
        read_dbc: &dyn Fn(&Path) -> Result<Vec<u8>, String>,
    ) -> Result<Self, ConfigError> {
        let file_name = files.first().map_or(set::NAME, |(name, _)| name.as_str());
        let document = Document::new(&[files, &set::as_files(settings)?].concat());
        let table = document.parse()?;
        let root = Section::root(&document, &table, Self::KEYS)?;
        let types = actuator_type::read_all(&root)?;
        let bus = root.section("bus", BusConfig::KEYS)?;
        let eds = bus.text("eds")?;
        let directory = parent(Path::new(file_name));
        let configured = actuator::read_all(&root, &types, &directory, read_dbc, eds.as_deref())?;
        let uses = |actuator: &ActuatorConfig| actuator.eds.as_deref() == eds.as_deref().map(Path::new);
        if eds.is_some() && !configured.iter().flatten().any(uses) {
            let expected = "no such key without an actuator whose drive has preset \"cia402\" and no eds of its own";
            return Err(bus.refuse("eds", expected));
        }
        let auto = configured.is_none();
        let mut actuators = configured.unwrap_or_else(|| actuator::every_one(&types));
        map::read(&root, &mut actuators)?;
        let serial = serial::read_all(&root, &actuators)?;
        let sample_rates_hz = actuators.iter().map(|actuator| actuator.params.sensors.sample_rate);
        let window = window::read(&root.section("window", &window::keys())?, sample_rates_hz)?;
        let config = Self {
            auto,
            actuators,
            types,
            window,
            identification: IdentificationConfig::read(&root.section("identification", IdentificationConfig::KEYS)?)?,
            health: HealthConfig::read(&root.section("health", HealthConfig::KEYS)?)?,
            rul: RulConfig::read(&root.section("rul", RulConfig::KEYS)?)?,
            output: OutputConfig::read(&root.section("output", OutputConfig::KEYS)?)?,
            bus: BusConfig::read(&bus)?,
            serial,
            files: files.iter().map(|(name, _)| PathBuf::from(name)).collect(),
            directory,
        };
        config.named_buses(file_name)?;
        match config.bus_loads().into_iter().find(|bus| bus.load > LOAD_MAX) {
            Some(bus) => Err(ConfigError::BusLoad {
                file: file_name.to_owned(),
                bus: bus.name().to_owned(),
                actuators: bus.actuators,
                load_percent: 100.0 * bus.load,
                bitrate_bit_s: bus.bitrate_bit_s,
            }),
            None => Ok(config),
        }
    }

    /// The actuator with number `id` on interface `bus`; `None` when the configuration does not name it.
    ///
    /// Without any `[[actuator]]` every number on every interface is `ema<id>` of type `bench`.
    #[must_use]
    pub fn actuator_for(&self, bus: &str, id: ActuatorId) -> Option<&ActuatorConfig> {
        self.actuators.iter().find(|actuator| actuator.is_at(bus, id))
    }

    /// The actuators on interface `bus` that have a signal map, each with its map and its nominal sample rate, Hz.
    pub fn mapped_actuators(&self, bus: &str) -> impl Iterator<Item = (ActuatorId, &Arc<SignalMap>, f64)> {
        self.actuators.iter().filter_map(move |actuator| {
            let map = actuator.map.as_ref().filter(|_| actuator.is_at(bus, actuator.id))?;
            Some((actuator.id, map, actuator.params.sensors.sample_rate))
        })
    }

    /// The drives on interface `bus`.
    pub(crate) fn drives(&self, bus: &str) -> impl Iterator<Item = (ActuatorId, DriveJoiner)> {
        self.actuators.iter().filter_map(move |actuator| {
            let drive = actuator
                .drive_bus
                .as_ref()
                .filter(|_| actuator.is_at(bus, actuator.id))?;
            Some((
                actuator.id,
                DriveJoiner::new(actuator.id, &actuator.name, DriveBus::clone(drive)),
            ))
        })
    }

    /// The actuator that a log of measured signals is of, with its map (`[map]`).
    #[must_use]
    pub fn actuator_of_logs(&self) -> Option<(&ActuatorConfig, &Arc<LogMap>)> {
        let on_no_bus = self.actuators.iter().filter(|actuator| actuator.drive_bus.is_none());
        on_no_bus
            .into_iter()
            .find_map(|actuator| Some((actuator, actuator.log.as_ref()?)))
    }

    /// The interfaces that the actuators are on, in the order of the file; `file_name` is what errors call it.
    ///
    /// # Errors
    /// [`ConfigError`] when an actuator has no bus, because it is not known where its frames arrive.
    pub fn interfaces(&self, file_name: &str) -> Result<BusNames, ConfigError> {
        if self.is_auto() {
            return Err(ConfigError::NoActuator {
                file: file_name.to_owned(),
            });
        }
        match self.actuators.iter().find(|actuator| actuator.bus.is_none()) {
            Some(actuator) => Err(ConfigError::NoBus {
                file: file_name.to_owned(),
                actuator: actuator.name.clone(),
            }),
            None => self.named_buses(file_name),
        }
    }

    /// The interfaces that actuators name.
    fn named_buses(&self, file_name: &str) -> Result<BusNames, ConfigError> {
        let mut names = BusNames::new();
        for bus in self.actuators.iter().filter_map(|actuator| actuator.bus.as_ref()) {
            names.intern(bus).map_err(|cause| ConfigError::BadBus {
                file: file_name.to_owned(),
                bus: bus.clone(),
                cause,
            })?;
        }
        Ok(names)
    }

    /// The actuator called `name`.
    #[must_use]
    pub fn actuator_named(&self, name: &str) -> Option<&ActuatorConfig> {
        self.actuators.iter().find(|actuator| actuator.name == name)
    }

    /// The configured actuators in the order of the file; all sixteen possible ones when [`Config::is_auto`].
    #[must_use]
    pub fn actuators(&self) -> &[ActuatorConfig] {
        &self.actuators
    }

    /// Whether there is no `[[actuator]]`, so that whatever is seen on a bus is watched.
    #[must_use]
    pub fn is_auto(&self) -> bool {
        self.auto
    }

    /// The type called `name`: built in, or a `[type.NAME]`.
    #[must_use]
    pub fn actuator_type(&self, name: &str) -> Option<&ActuatorType> {
        self.types.get(name)
    }

    /// All types by name, built in or configured.
    pub fn types(&self) -> impl Iterator<Item = (&str, &ActuatorType)> {
        self.types.iter().map(|(name, found)| (name.as_str(), found))
    }

    /// Section `[window]`.
    #[must_use]
    pub fn window(&self) -> &WindowConfig {
        &self.window
    }

    /// Section `[identification]`.
    #[must_use]
    pub fn identification(&self) -> &IdentificationConfig {
        &self.identification
    }

    /// Section `[health]`.
    #[must_use]
    pub fn health(&self) -> &HealthConfig {
        &self.health
    }

    /// Section `[rul]`.
    #[must_use]
    pub fn rul(&self) -> &RulConfig {
        &self.rul
    }

    /// Section `[output]`.
    #[must_use]
    pub fn output(&self) -> &OutputConfig {
        &self.output
    }

    /// Section `[bus]`.
    #[must_use]
    pub fn bus(&self) -> &BusConfig {
        &self.bus
    }

    /// The serial line that is called `bus`; every other bus is CAN.
    #[must_use]
    pub fn serial(&self, bus: &str) -> Option<&SerialConfig> {
        self.serial.iter().find(|line| line.bus == bus)
    }

    /// Load of each interface by the configured actuators, in order of name; empty when [`Config::is_auto`].
    ///
    /// Actuators without a `bus` count as sharing one.
    #[must_use]
    pub fn bus_loads(&self) -> Vec<BusLoad> {
        if self.auto {
            Vec::new()
        } else {
            self.bus.loads(&self.actuators, &self.serial)
        }
    }

    /// Where a path of this configuration (a calibration) is: relative ones start at the directory of the file.
    #[must_use]
    pub fn resolve(&self, path: &Path) -> PathBuf {
        self.directory.join(path)
    }

    /// Where what is learnt of an actuator's unit is kept; `None` where it is not learnt.
    #[must_use]
    pub fn learnt_file(&self, actuator: &ActuatorConfig) -> Option<PathBuf> {
        let learning = actuator.learning.as_ref()?;
        Some(self.resolve(&learning.folder).join(actuator.learnt_file_name()))
    }

    /// Every file that a run with this configuration reads: itself with its drop-ins, calibrations, DBC files, events.
    #[must_use]
    pub fn files(&self) -> Vec<PathBuf> {
        let calibrations = self.types.values().filter_map(|of_type| of_type.calibration.as_ref());
        let units = self
            .actuators
            .iter()
            .flat_map(|unit| unit.calibration.iter().chain(&unit.dbc).chain(&unit.eds));
        let named = calibrations.chain(units).chain(&self.rul.events);
        let named = named.map(|path| self.resolve(path));
        self.files.iter().cloned().chain(named).collect()
    }

    /// SHA-256 in hex of the checked configuration: equal for two files that mean the same.
    #[must_use]
    pub fn hash(&self) -> String {
        let canonical = serde_json::to_vec(self).expect("numbers are finite, and the keys of every map are strings");
        hex(&Sha256::digest(canonical))
    }

    /// The checked configuration with its hash, bus loads and effective parameters, for `hmd check-config --json`.
    #[must_use]
    pub fn to_json(&self) -> serde_json::Value {
        serde_json::json!({
            "hash": self.hash(),
            "bus_load": self.bus_loads(),
            "config": self,
            "parameters": self.effective_parameters(),
        })
    }

    /// What is configured, in a few lines, for `hmd check-config`.
    #[must_use]
    pub fn describe(&self) -> String {
        describe::describe(self)
    }
}

impl Default for Config {
    /// What an empty file means.
    fn default() -> Self {
        Self::from_toml_str("", "defaults").expect("every key has a default that passes its own check")
    }
}

/// Directory of a file; empty when the name has none.
fn parent(file: &Path) -> PathBuf {
    file.parent().unwrap_or(Path::new("")).to_owned()
}
