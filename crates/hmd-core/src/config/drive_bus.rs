//! Section `[actuator.drive]`: a drive as it is sold, by a preset and its number.

use std::ops::RangeInclusive;
use std::path::PathBuf;

use ema_models::ActuatorParams;
use ema_wire::ActuatorId;

use super::ConfigError;
use super::reader::Section;
use super::signals::DbcFiles;
use crate::drive_bus::{DriveBus, DriveSettings, ObjectDictionary, Preset};

/// Bandwidths of a current filter.
pub(super) const BANDWIDTHS_HZ: RangeInclusive<u32> = 1..=1_000_000;

const KEYS: [&str; 9] = [
    "preset",
    "node",
    "eds",
    "motor_units_per_rev",
    "output_encoder",
    "output_units_per_rev",
    "rated_current_a",
    "set_point",
    "current_bandwidth_hz",
];

/// Reads it with its EDS or DCF file, if it is there; `eds_of_bus` is the file of drives that name none.
pub(super) fn read(
    actuator: &Section<'_>,
    id: ActuatorId,
    params: &ActuatorParams,
    files: &DbcFiles<'_>,
    eds_of_bus: Option<&str>,
) -> Result<Option<(DriveBus, Option<PathBuf>)>, ConfigError> {
    if !actuator.has("drive") {
        return Ok(None);
    }
    if actuator.has("dbc") {
        return Err(actuator.refuse("dbc", "either dbc or drive"));
    }
    let section = actuator.section("drive", &KEYS)?;
    if !section.has("preset") {
        return Err(section.refuse("preset", &format!("one of {}", names())));
    }
    let preset = section.choice("preset", Preset::Odrive, &Preset::NAMES)?;
    let only_of = |key: &str, of: Preset| {
        let allowed = !section.has(key) || preset == of;
        let why = format!("no such key, which is of preset {}", of.name());
        if allowed {
            Ok(())
        } else {
            Err(section.refuse(key, &why))
        }
    };
    only_of("eds", Preset::Cia402)?;
    only_of("rated_current_a", Preset::Cia402)?;
    let node = section
        .integer("node", preset.nodes())?
        .unwrap_or(u32::from(id.index()));
    if !preset.nodes().contains(&node) {
        return Err(section.refuse_effective("node", "a number from 1 to 127", "0 (that of the actuator)"));
    }
    let settings = DriveSettings {
        preset,
        node: node as u8,
        motor_units_per_rev: number(&section, "motor_units_per_rev", |steps| steps > 0.0)?,
        output_encoder: section
            .integer("output_encoder", 0..=u32::from(u16::MAX))?
            .map(|n| n as u16),
        output_units_per_rev: number(&section, "output_units_per_rev", |steps| steps != 0.0)?,
        rated_current_a: number(&section, "rated_current_a", |rated| rated > 0.0)?,
        uses_commands: section.flag("set_point", true)?,
        current_bandwidth_hz: section.integer("current_bandwidth_hz", BANDWIDTHS_HZ)?,
    };
    let (mut dictionary, mut file) = (ObjectDictionary::default(), None);
    let eds = section.text("eds")?;
    let of_bus = eds_of_bus.filter(|_| preset == Preset::Cia402).map(str::to_owned);
    if let Some(path) = eds.or(of_bus) {
        let path = PathBuf::from(path);
        let why = |why: String| {
            let found = path.display().to_string();
            section.refuse_effective("eds", &format!("an EDS or DCF file that can be read ({why})"), &found)
        };
        let bytes = files.bytes(&path).map_err(why)?;
        dictionary = ObjectDictionary::parse(&bytes, settings.node).map_err(|e| why(e.to_string()))?;
        file = Some(path);
    }
    let drive = DriveBus::new(settings, params, dictionary)
        .map_err(|misfit| section.refuse_self(&misfit.to_string(), "none"))?;
    Ok(Some((drive, file)))
}

fn number(section: &Section<'_>, key: &str, is_good: impl Fn(f64) -> bool) -> Result<Option<f64>, ConfigError> {
    let expected = || match key {
        "output_units_per_rev" => "a number other than 0".to_owned(),
        _ => "a number above 0".to_owned(),
    };
    match section.any_number(key, expected)? {
        Some(value) if !value.is_finite() || !is_good(value) => Err(section.refuse(key, &expected())),
        other => Ok(other),
    }
}

fn names() -> String {
    Preset::NAMES.map(|(name, _)| name).join(", ")
}
