//! Section `[actuator.signals]`: which signals of a DBC file are the actuator's quantities.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ema_models::ActuatorParams;

use super::ConfigError;
use super::reader::Section;
use super::spelling::nearest;
use crate::dbc::{Binding, Database, DbcMessage, DbcSignal, MapDraft, ModeCodes, Role, Signal, SignalMap};

/// Names that are offered for one that is unknown.
const OFFERED: usize = 3;

/// What each section of signals may have.
const SECTIONS: [(&str, &[&str]); 5] = [
    ("currents", &["a", "b", "c"]),
    ("position", &["motor", "output"]),
    ("command", &["position", "speed", "mode"]),
    ("sample", &["counter", "time"]),
    ("status", &["dc_link", "winding_temp", "load_torque"]),
];

/// DBC files that were read, each once.
pub(super) struct DbcFiles<'a> {
    directory: &'a Path,
    read_file: &'a dyn Fn(&Path) -> Result<Vec<u8>, String>,
    read: BTreeMap<PathBuf, Database>,
}

impl<'a> DbcFiles<'a> {
    /// Relative paths start at `directory`; `read_file` gives a file's bytes.
    pub(super) fn new(directory: &'a Path, read_file: &'a dyn Fn(&Path) -> Result<Vec<u8>, String>) -> Self {
        Self {
            directory,
            read_file,
            read: BTreeMap::new(),
        }
    }

    /// The bytes of a file of another kind, or why there are none.
    pub(super) fn bytes(&self, path: &Path) -> Result<Vec<u8>, String> {
        (self.read_file)(&self.directory.join(path))
    }

    /// A file, or what was expected and found instead.
    fn get(&mut self, path: &Path) -> Result<&Database, String> {
        if !self.read.contains_key(path) {
            let database = parse((self.read_file)(&self.directory.join(path))?)?;
            self.read.insert(path.to_owned(), database);
        }
        Ok(&self.read[path])
    }
}

fn parse(bytes: Vec<u8>) -> Result<Database, String> {
    // The editors of such files write UTF-8 or the code page of Western Europe, which matters for units alone.
    let text = String::from_utf8(bytes).unwrap_or_else(|e| e.into_bytes().into_iter().map(char::from).collect());
    Database::parse(text.trim_start_matches('\u{feff}')).map_err(|e| e.to_string())
}

/// The map of one `[[actuator]]`; `None` if it has no DBC file.
pub(super) fn read(
    actuator: &Section<'_>,
    params: &ActuatorParams,
    files: &mut DbcFiles<'_>,
) -> Result<Option<SignalMap>, ConfigError> {
    let Some(path) = actuator.text("dbc")? else {
        return if actuator.has("signals") {
            Err(actuator.refuse_effective("dbc", "the DBC file of the signals", "no such key"))
        } else {
            Ok(None)
        };
    };
    let database = files
        .get(Path::new(&path))
        .map_err(|why| actuator.refuse("dbc", &format!("a DBC file of at most 16 MiB that can be read ({why})")))?;
    let names: Vec<&str> = SECTIONS.iter().map(|(name, _)| *name).collect();
    let signals = actuator.section("signals", &names)?;
    let reader = MapReader {
        database,
        file: &path,
        params,
    };
    let mut draft = MapDraft::default();
    for (name, keys) in SECTIONS {
        let section = signals.section(name, keys)?;
        for &key in keys {
            reader.read(&section, key, &format!("{name}.{key}"), &mut draft)?;
        }
    }
    let map = draft.finish();
    map.map(Some)
        .map_err(|misfit| signals.refuse_self(&misfit.to_string(), "none"))
}

struct MapReader<'a> {
    database: &'a Database,
    file: &'a str,
    params: &'a ActuatorParams,
}

impl MapReader<'_> {
    /// Adds what one key says, if it is there.
    fn read(&self, section: &Section<'_>, key: &str, path: &str, draft: &mut MapDraft) -> Result<(), ConfigError> {
        if !section.has(key) {
            return Ok(());
        }
        let Some(&(role, _)) = Role::ALL.iter().find(|(_, of)| *of == path) else {
            // The counter is the one key without a quantity of its own: each of its signals counts in its message.
            for name in section.texts(key)? {
                let (message, _, signal) = self.signal(section, key, &name)?;
                let counted = draft.count(message, signal.clone());
                counted.map_err(|misfit| section.refuse(key, &misfit.to_string()))?;
            }
            return Ok(());
        };
        if !section.is_table(key) {
            let name = section.text(key)?.unwrap_or_default();
            return self.bind((section, key), role, &name, None, draft);
        }
        let keys: &[&str] = match role {
            Role::Mode => &["signal", "position", "speed"],
            Role::MotorPosition | Role::OutputPosition => &["signal", "unit", "wraps_after"],
            _ => &["signal", "unit"],
        };
        let table = section.section(key, keys)?;
        let Some(name) = table.text("signal")? else {
            return Err(table.refuse("signal", "a signal as \"MESSAGE.SIGNAL\""));
        };
        self.bind((&table, "signal"), role, &name, Some(&table), draft)
    }

    /// Adds a quantity whose signal's name stands at `place`, with what `table` says beside it.
    fn bind(
        &self,
        place: (&Section<'_>, &str),
        role: Role,
        name: &str,
        table: Option<&Section<'_>>,
        draft: &mut MapDraft,
    ) -> Result<(), ConfigError> {
        let (section, key) = place;
        let (message, found, signal) = self.signal(section, key, name)?;
        let sensors = &self.params.sensors;
        let dimension = role.dimension(sensors.motor_counts_per_rev, sensors.output_counts_per_rev);
        let unit_override = table.map_or(Ok(None), |table| table.text("unit"))?;
        let unit = dimension
            .unit(unit_override.as_deref().unwrap_or(&found.unit))
            .ok_or_else(|| {
                let expected = format!("one of the units {}", dimension.names());
                match (table, unit_override) {
                    (Some(table), Some(_)) => table.refuse("unit", &expected),
                    _ => {
                        let why = format!(
                            "a signal in {expected}, or {{ signal = …, unit = … }} ({} says {:?})",
                            self.file, found.unit
                        );
                        section.refuse(key, &why)
                    }
                }
            })?;
        if let (Role::Mode, Some(table)) = (role, table) {
            let codes = ModeCodes::default();
            let code = |key: &str, default: i64| Ok(table.integer(key, 0..=u32::MAX)?.map_or(default, i64::from));
            draft.set_modes(ModeCodes {
                position: code("position", codes.position)?,
                speed: code("speed", codes.speed)?,
            });
        }
        let wraps_after = match role {
            Role::MotorPosition | Role::OutputPosition => {
                let expected = || "a number above 0".to_owned();
                let wraps_after = table.map_or(Ok(None), |table| table.any_number("wraps_after", expected))?;
                if let (Some(table), false) = (table, wraps_after.is_none_or(|range| range.is_finite() && range > 0.0))
                {
                    return Err(table.refuse("wraps_after", &expected()));
                }
                // The scale of an angle is positive.
                wraps_after.or(signal.range()).map(|range| range * unit.scale)
            }
            _ => None,
        };
        let binding = Binding {
            role,
            signal: signal.clone(),
            unit,
            wraps_after,
        };
        draft
            .bind(message, binding)
            .map_err(|misfit| section.refuse(key, &misfit.to_string()))
    }

    /// The signal of this name, or those that come closest to it.
    fn signal(
        &self,
        section: &Section<'_>,
        key: &str,
        name: &str,
    ) -> Result<(&DbcMessage, &DbcSignal, &Signal), ConfigError> {
        let found = name.split_once('.').and_then(|(message, signal)| {
            let message = self.database.message(message)?;
            Some((message, message.signals.get(signal)?))
        });
        let Some((message, found)) = found else {
            let all = self.database.messages.iter().flat_map(|message| {
                let names = message.signals.keys();
                names.map(|signal| format!("{}.{signal}", message.name))
            });
            let expected = match nearest(name, all, OFFERED).as_slice() {
                [] => format!("a signal of {}, which has none", self.file),
                offered => format!("a signal of {}, the closest being {}", self.file, offered.join(", ")),
            };
            return Err(section.refuse(key, &expected));
        };
        match &found.signal {
            Ok(signal) => Ok((message, found, signal)),
            Err(why) => Err(section.refuse(key, &format!("a signal that can be ({}: {why})", self.file))),
        }
    }
}
