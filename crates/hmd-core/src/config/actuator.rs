//! The actuators that are watched: every `[[actuator]]`, or whatever is seen when there is none.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ema_models::{ActuatorParams, DriveParams, FaultId, Tolerances};
use ema_wire::ActuatorId;
use serde::Serialize;

use super::ConfigError;
use super::actuator_type::{ActuatorType, DEFAULT_TYPE, parameters_as_text};
use super::drive_bus;
use super::name::{NAME_EXPECTED, is_name};
use super::reader::Section;
use super::signals::{self, DbcFiles};
use super::specification::Specification;
use crate::dbc::SignalMap;
use crate::drive_bus::DriveBus;
use crate::log_map::{Gap, LogMap};

const KEYS: &[&str] = &[
    "name",
    "id",
    "bus",
    "type",
    "calibration",
    "learn_windows",
    "learn_folder",
    "dbc",
    "signals",
    "drive",
    "part_number",
    "serial_number",
    "passive",
];

/// First parts of other topics; an actuator of this name would write between them.
const RESERVED_NAMES: [&str; 3] = ["bus", "hmd", "log"];

/// One actuator: where its frames come from, what it is, and which unit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ActuatorConfig {
    /// Name in records and topics.
    pub name: String,
    /// Number in its CAN identifiers; of a mapped one, on its interface.
    pub id: ActuatorId,
    /// Interface it is on; `None`: any.
    pub bus: Option<String>,
    /// Name of its type.
    #[serde(rename = "type")]
    pub type_name: String,
    /// Parameters of its type.
    #[serde(skip)]
    pub params: ActuatorParams,
    /// How well its type's parameters are known.
    #[serde(skip)]
    pub tolerances: Tolerances,
    /// Drive of its type.
    #[serde(skip)]
    pub drive: DriveParams,
    /// Calibration of its type, as written in the file.
    #[serde(skip)]
    pub type_calibration: Option<PathBuf>,
    /// What its type must still do.
    #[serde(skip)]
    pub specification: Specification,
    /// Calibration of this very unit, as written in the file.
    pub calibration: Option<PathBuf>,
    /// How this very unit is learnt from its first windows; `None`: not at all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub learning: Option<Learning>,
    /// DBC file of the bus that it is on, as written in the file; `None`: the built-in dictionary.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dbc: Option<PathBuf>,
    /// Its signals in there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub map: Option<Arc<SignalMap>>,
    /// The drive that it is of, where its frames are those of one as they are sold.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drive_bus: Option<Arc<DriveBus>>,
    /// EDS or DCF file of the drive, as written in the file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub eds: Option<PathBuf>,
    /// Its columns in logs of measured signals, or as a drive's quantities.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub log: Option<Arc<LogMap>>,
    /// Part number, for the records.
    pub part_number: Option<String>,
    /// Serial number of the unit, for the records.
    pub serial_number: Option<String>,
    /// Monitored and recorded like any other, but a change of its state raises no alarm: for a unit under test.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub passive: bool,
}

/// How a unit is learnt by the daemon itself.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Learning {
    /// Windows that it is learnt from.
    pub windows: usize,
    /// Folder of what was learnt, as written in the file. A replay neither reads nor writes there.
    pub folder: PathBuf,
}

impl Learning {
    /// Windows that a unit can be learnt from. Commissioning runs on the identification thread, and its time grows with their number:
    /// 20 take some 13 s on one core, and a minute counts as stuck; each is some 100 kB.
    const WINDOWS: RangeInclusive<u32> = 5..=20;

    fn read(section: &Section<'_>) -> Result<Option<Self>, ConfigError> {
        let windows = section.integer("learn_windows", Self::WINDOWS)?;
        let folder = section.text("learn_folder")?.map(PathBuf::from);
        let Some(windows) = windows else {
            return match folder {
                Some(_) => Err(section.refuse("learn_folder", "learn_windows beside it")),
                None => Ok(None),
            };
        };
        if section.text("calibration")?.is_some() {
            return Err(section.refuse("learn_windows", "either calibration or learn_windows"));
        }
        match folder {
            Some(folder) => Ok(Some(Self {
                windows: windows as usize,
                folder,
            })),
            None => Err(section.refuse("learn_windows", "learn_folder beside it")),
        }
    }
}

impl ActuatorConfig {
    fn of_type(id: ActuatorId, type_name: &str, found: &ActuatorType) -> Self {
        Self {
            name: id.to_string(),
            id,
            bus: None,
            type_name: type_name.to_owned(),
            params: found.params,
            tolerances: found.tolerances,
            drive: found.drive,
            type_calibration: found.calibration.clone(),
            specification: found.specification,
            calibration: None,
            learning: None,
            dbc: None,
            map: None,
            drive_bus: None,
            eds: None,
            log: None,
            part_number: None,
            serial_number: None,
            passive: false,
        }
    }

    fn read(
        section: &Section<'_>,
        types: &BTreeMap<String, ActuatorType>,
        files: &mut DbcFiles<'_>,
        eds: Option<&str>,
    ) -> Result<Self, ConfigError> {
        let last = ActuatorId::COUNT - 1;
        let index = section
            .integer("id", 0..=u32::from(last))?
            .and_then(|id| u8::try_from(id).ok());
        let Some(id) = index.and_then(ActuatorId::new) else {
            return Err(section.refuse("id", &format!("a whole number from 0 to {last}")));
        };
        let type_name = section.text("type")?.unwrap_or_else(|| DEFAULT_TYPE.to_owned());
        let Some(found) = types.get(&type_name) else {
            let known: Vec<_> = types.keys().map(String::as_str).collect();
            return Err(section.refuse("type", &format!("a type: {}", known.join(", "))));
        };
        let mut actuator = Self::of_type(id, &type_name, found);
        if let Some(name) = section.text("name")? {
            if !is_name(&name) || RESERVED_NAMES.contains(&name.as_str()) {
                return Err(section.refuse("name", &format!("{NAME_EXPECTED}, and none of bus, hmd, log")));
            }
            actuator.name = name;
        }
        actuator.bus = section.text("bus")?;
        actuator.calibration = section.text("calibration")?.map(PathBuf::from);
        actuator.learning = Learning::read(section)?;
        actuator.dbc = section.text("dbc")?.map(PathBuf::from);
        actuator.map = signals::read(section, &actuator.params, files)?.map(Arc::new);
        if let Some((drive, eds)) = drive_bus::read(section, id, &actuator.params, files, eds)? {
            actuator.log = drive.map().ok().cloned();
            actuator.drive_bus = Some(Arc::new(drive));
            actuator.eds = eds;
        }
        actuator.part_number = section.text("part_number")?;
        actuator.serial_number = section.text("serial_number")?;
        actuator.passive = section.flag("passive", false)?;
        Ok(actuator)
    }

    /// Parameters of its type and drive under their keys, whatever the sample rate; two types with the same text are the same.
    #[must_use]
    pub fn parameters_as_text(&self) -> String {
        parameters_as_text(&self.params, &self.drive)
    }

    /// Name of the file of what is learnt of its unit: its own name and, where configured, the unit's serial number, in letters, digits,
    /// `-` and `_` behind a `+`.
    #[must_use]
    pub fn learnt_file_name(&self) -> String {
        let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
        match &self.serial_number {
            Some(serial) => {
                let serial: String = serial.chars().map(plain).collect();
                format!("{}+{serial}.unit.toml", self.name)
            }
            None => format!("{}.unit.toml", self.name),
        }
    }

    /// Whether its samples have a set point; else motion begins a window.
    #[must_use]
    pub fn has_set_point(&self) -> bool {
        self.log.as_ref().is_none_or(|log| log.has_command())
    }

    /// Whether its samples have an output angle; else it is that of the motor behind a rigid gear.
    #[must_use]
    pub fn has_output_angle(&self) -> bool {
        let log = self.log.as_ref();
        log.is_none_or(|log| log.gaps().all(|gap| gap != Gap::OutputAngle))
    }

    /// Faults that no window can show, for want of a signal in its log or drive.
    pub fn hidden_faults(&self) -> impl Iterator<Item = FaultId> {
        let gaps = self.log.iter().flat_map(|log| log.gaps());
        gaps.flat_map(|gap| gap.hides()).copied()
    }

    /// Whether frames of number `id` on interface `bus` are its own.
    #[must_use]
    pub fn is_at(&self, bus: &str, id: ActuatorId) -> bool {
        self.id == id && self.bus.as_deref().is_none_or(|own| own == bus)
    }

    /// Whether some frame could belong to both.
    fn overlaps(&self, other: &Self) -> bool {
        self.id == other.id && (self.bus.is_none() || other.bus.is_none() || self.bus == other.bus)
    }
}

/// Every `[[actuator]]`; `None` if there is none. `eds` is the file of drives that name none.
pub(super) fn read_all(
    root: &Section<'_>,
    types: &BTreeMap<String, ActuatorType>,
    directory: &Path,
    read_dbc: &dyn Fn(&Path) -> Result<Vec<u8>, String>,
    eds: Option<&str>,
) -> Result<Option<Vec<ActuatorConfig>>, ConfigError> {
    let mut files = DbcFiles::new(directory, read_dbc);
    let Some(sections) = root.list("actuator", KEYS)? else {
        return Ok(None);
    };
    let mut actuators: Vec<ActuatorConfig> = Vec::with_capacity(sections.len());
    for section in &sections {
        let actuator = ActuatorConfig::read(section, types, &mut files, eds)?;
        if let Some(other) = actuators.iter().find(|other| other.overlaps(&actuator)) {
            let place = other.bus.as_deref().or(actuator.bus.as_deref()).unwrap_or("any bus");
            let expected = format!("a number that {} on {place} does not have", other.name);
            return Err(section.refuse("id", &expected));
        }
        if actuators.iter().any(|other| other.name == actuator.name) {
            let effective = format!("{:?} (by default)", actuator.name);
            return Err(section.refuse_effective("name", "a name that no other actuator has", &effective));
        }
        actuators.push(actuator);
    }
    Ok((!actuators.is_empty()).then_some(actuators))
}

/// All sixteen numbers on any interface, as `ema<n>` of the default type.
pub(super) fn every_one(types: &BTreeMap<String, ActuatorType>) -> Vec<ActuatorConfig> {
    ActuatorId::all()
        .map(|id| ActuatorConfig::of_type(id, DEFAULT_TYPE, &types[DEFAULT_TYPE]))
        .collect()
}
