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

const KEYS: [&str; 11] = [
    "preset",
    "node",
    "eds",
    "motor_units_per_rev",
    "output_encoder",
    "output_units_per_rev",
    "rated_current_a",
    "position_max_rad",
    "feedback_id",
    "set_point",
    "current_bandwidth_hz",
];

/// Keys that not every preset has.
const KEYS_OF_PRESETS: [(&str, &[Preset]); 7] = [
    ("eds", &[Preset::Cia402]),
    ("rated_current_a", &[Preset::Cia402, Preset::Damiao]),
    ("position_max_rad", &[Preset::Damiao]),
    ("feedback_id", &[Preset::Damiao]),
    (
        "motor_units_per_rev",
        &[Preset::Cia402, Preset::Odrive, Preset::Moteus, Preset::Vesc],
    ),
    ("output_encoder", &[Preset::Cia402, Preset::Odrive, Preset::Moteus]),
    (
        "output_units_per_rev",
        &[Preset::Cia402, Preset::Odrive, Preset::Moteus],
    ),
];

/// Largest identifier of 11 bits.
const STANDARD_ID_MAX: u32 = 0x7ff;

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
    for (key, of) in KEYS_OF_PRESETS {
        if section.has(key) && !of.contains(&preset) {
            let names: Vec<&str> = of.iter().map(|of| of.name()).collect();
            let why = format!("no such key, which is of preset {}", names.join(", "));
            return Err(section.refuse(key, &why));
        }
    }
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
            .integer("output_encoder", preset.output_encoders())?
            .map(|n| n as u16),
        output_units_per_rev: number(&section, "output_units_per_rev", |steps| steps != 0.0)?,
        rated_current_a: number(&section, "rated_current_a", |rated| rated > 0.0)?,
        position_max_rad: number(&section, "position_max_rad", |most| most > 0.0)?,
        feedback_id: section.integer("feedback_id", 0..=STANDARD_ID_MAX)?.map(|id| id as u16),
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
