//! Section `[map]`: which columns of a log of measured signals are an actuator's quantities.

use std::ops::RangeInclusive;
use std::sync::Arc;

use super::reader::Section;
use super::{ActuatorConfig, ConfigError};
use crate::dbc::{ModeCodes, Role};
use crate::log_map::{Clock, Column, LogMap, ModeNames, Quantity, Resampling};

/// Keys of the section itself.
pub(super) const KEYS: [&str; 10] = [
    "actuator", "time", "clock", "resample", EVEN, "currents", "position", "command", "sample", "status",
];

/// Key of the rate at which currents and angles are interpolated.
const EVEN: &str = "resample_hz";

/// Such rates.
const EVEN_HZ: RangeInclusive<u32> = 50..=20_000;

/// Key beside the currents: where the drive filters them.
const BANDWIDTH: &str = "bandwidth_hz";

/// Tables of quantities in it.
const SECTIONS: [(&str, &[&str]); 5] = [
    ("currents", &["a", "b", "c", "d", "q", BANDWIDTH]),
    ("position", &["motor", "output"]),
    ("command", &["position", "speed", "mode"]),
    ("sample", &["counter", "time"]),
    ("status", &["dc_link", "winding_temp", "load_torque"]),
];

/// Gives the map to the actuator that it is of.
pub(super) fn read(root: &Section<'_>, actuators: &mut [ActuatorConfig]) -> Result<(), ConfigError> {
    if !root.has("map") {
        return Ok(());
    }
    let section = root.section("map", &KEYS)?;
    let wanted = section.text("actuator")?;
    let found = actuators
        .iter_mut()
        .find(|actuator| wanted.as_ref().is_none_or(|name| *name == actuator.name));
    let Some(actuator) = found else {
        return Err(section.refuse("actuator", "the name of an [[actuator]]"));
    };
    if actuator.drive_bus.is_some() {
        return Err(section.refuse_effective(
            "actuator",
            "an actuator without drive: its frames are those of a drive",
            &actuator.name,
        ));
    }
    if actuator.dbc.is_some() {
        return Err(section.refuse_effective(
            "actuator",
            "an actuator without dbc: its frames have the layout of its DBC file",
            &actuator.name,
        ));
    }
    let clock = section.choice(
        "clock",
        Clock::Device,
        &[("device", Clock::Device), ("receiver", Clock::Receiver)],
    )?;
    let mut reader = Reader::default();
    let currents = section.section(SECTIONS[0].0, SECTIONS[0].1)?;
    let bandwidth_hz = currents.integer(BANDWIDTH, super::drive_bus::BANDWIDTHS_HZ)?;
    reader.column(&section, "time", Quantity::Time)?;
    for (name, keys) in SECTIONS {
        let table = section.section(name, keys)?;
        for &key in keys {
            let path = format!("{name}.{key}");
            let quantity = Quantity::all().find(|quantity| quantity.key() == path);
            if let Some(quantity) = quantity {
                reader.column(&table, key, quantity)?;
            }
        }
    }
    let map = LogMap::new(reader.columns, clock, reader.modes, reader.names);
    let map = map.map_err(|misfit| section.refuse_self(&misfit.to_string(), "none"))?;
    let map = map.with_current_bandwidth(bandwidth_hz);
    let at_currents = section.flag("resample", false)?.then_some(Resampling::AtCurrents);
    let even = section.integer(EVEN, EVEN_HZ)?.map(Resampling::Even);
    if even.is_some() && (map.has(Quantity::Counter) || map.has(Quantity::Of(Role::Time))) {
        return Err(section.refuse(
            EVEN,
            "neither sample.counter nor sample.time beside it: its samples are others",
        ));
    }
    actuator.log = Some(Arc::new(map.with_resampling(even.or(at_currents))));
    Ok(())
}

#[derive(Default)]
struct Reader {
    columns: Vec<Column>,
    modes: ModeCodes,
    names: ModeNames,
}

impl Reader {
    /// Adds what one key says, if it is there.
    fn column(&mut self, section: &Section<'_>, key: &str, quantity: Quantity) -> Result<(), ConfigError> {
        if !section.has(key) {
            return Ok(());
        }
        let mut column = Column::plain(quantity, "");
        if section.is_table(key) {
            let keys: &[&str] = match quantity {
                Quantity::Of(Role::Mode) => &["signal", "position", "speed"],
                Quantity::Of(Role::MotorPosition | Role::OutputPosition) => {
                    &["signal", "unit", "scale", "offset", "wraps_after"]
                }
                Quantity::Counter => &["signal"],
                _ => &["signal", "unit", "scale", "offset"],
            };
            let table = section.section(key, keys)?;
            let Some(signal) = table.text("signal")? else {
                return Err(table.refuse("signal", "the name of a column or channel of the log"));
            };
            column.signal = signal;
            column.unit = table.text("unit")?;
            if let Some(unit) = &column.unit {
                // A unit needs no parameters but for counts, which every type has.
                let dimension = quantity.dimension(&ema_models::ActuatorParams::bench());
                if dimension.unit(unit).is_none() {
                    return Err(table.refuse("unit", &format!("one of the units {}", dimension.names())));
                }
            }
            column.scale = number(&table, "scale", |scale| scale != 0.0)?.unwrap_or(1.0);
            column.offset = number(&table, "offset", |_| true)?.unwrap_or(0.0);
            column.wraps_after = number(&table, "wraps_after", |range| range > 0.0)?;
            if quantity == Quantity::Of(Role::Mode) {
                (self.modes.position, self.names.position) = mode(&table, "position", self.modes.position)?;
                (self.modes.speed, self.names.speed) = mode(&table, "speed", self.modes.speed)?;
            }
        } else {
            column.signal = section.text(key)?.unwrap_or_default();
        }
        self.columns.push(column);
        Ok(())
    }
}

fn number(table: &Section<'_>, key: &str, is_good: impl Fn(f64) -> bool) -> Result<Option<f64>, ConfigError> {
    let expected = || match key {
        "scale" => "a number other than 0".to_owned(),
        "wraps_after" => "a number above 0".to_owned(),
        _ => "a number".to_owned(),
    };
    match table.any_number(key, expected)? {
        Some(value) if !value.is_finite() || !is_good(value) => Err(table.refuse(key, &expected())),
        other => Ok(other),
    }
}

/// A value of the mode: a number, or the text that the log has instead.
fn mode(table: &Section<'_>, key: &str, default: i64) -> Result<(i64, Option<String>), ConfigError> {
    if table.is_text(key) {
        return Ok((default, table.text(key)?));
    }
    Ok((table.integer(key, 0..=u32::MAX)?.map_or(default, i64::from), None))
}
