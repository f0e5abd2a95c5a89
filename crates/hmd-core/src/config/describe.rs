//! What is configured, in words, for `hmd check-config`.

use std::fmt::{self, Write};
use std::path::Path;

use super::actuator_type::DEFAULT_TYPE;
use super::effective::write_parameters;
use super::{ActuatorConfig, Config, HoursOf, LOAD_MAX, MONITOR_NAMES, RulConfig, SearchObjective};
use crate::dbc::{Role, SignalMap};
use crate::health::Levels;
use ema_models::FaultId;

pub(super) fn describe(config: &Config) -> String {
    let mut text = String::new();
    write_all(&mut text, config).expect("writing to a String does not fail");
    text
}

fn write_all(out: &mut String, config: &Config) -> fmt::Result {
    write_actuators(out, config)?;
    match config.interfaces("hmd run refuses this configuration") {
        Ok(names) => writeln!(
            out,
            "hmd run: listens to {}",
            names.iter().collect::<Vec<_>>().join(", ")
        )?,
        Err(refusal) => writeln!(out, "{refusal}")?,
    }
    write_types(out, config)?;
    let window = config.window();
    writeln!(
        out,
        "window: {} ms, {} ms of it before the trigger; invalid above {} % missing samples ({} % if scattered) or a gap \
         of {} ms",
        window.duration_ms,
        window.pre_trigger_ms,
        100.0 * window.max_gap_fraction,
        100.0 * window.scattered_max_fraction(),
        window.longest_gap_ms
    )?;
    let search = config.identification();
    writeln!(
        out,
        "identification: {} with the {} monitor{}{}",
        search.method.name(),
        name_of(search.monitor, &MONITOR_NAMES),
        match search.objective {
            SearchObjective::Residual => "",
            SearchObjective::Eq14 => ", objective eq14",
        },
        if search.population == 0 {
            String::new()
        } else {
            format!(
                ", population {}, generations {}, at most {} evaluations",
                search.population, search.generations, search.evaluations_max
            )
        }
    )?;
    write_health(out, config)?;
    write_rul(out, config)?;
    let output = config.output();
    match (output.raw_frames, output.captures) {
        (true, _) => writeln!(out, "raw frames: stored")?,
        (false, false) => writeln!(out, "raw frames: not stored")?,
        (false, true) => writeln!(
            out,
            "raw frames: in a folder, those from {} s before to {} s behind windows that are unmodelled or whose health got \
             worse, or times asked for by hmd event --keep",
            output.capture_before_s, output.capture_after_s
        )?,
    }
    writeln!(
        out,
        "output in a folder: segments of {} MiB or {} s, at most {} MiB of them, {} MiB left free",
        output.segment_mib, output.segment_age_s, output.disk_budget_mib, output.disk_free_min_mib
    )?;
    writeln!(out, "hash: {}", config.hash())
}

fn write_actuators(out: &mut String, config: &Config) -> fmt::Result {
    let bus = config.bus();
    if config.is_auto() {
        let rate = config.types[DEFAULT_TYPE].params.sensors.sample_rate;
        let load = bus.load_of_one(rate);
        writeln!(
            out,
            "actuators: every one seen on a bus, as ema<n> of type {DEFAULT_TYPE}"
        )?;
        for actuator in config.actuators() {
            write_log_map(out, actuator)?;
        }
        return writeln!(
            out,
            "bus load: {:.0} % of {} bit/s by each at {rate} Hz, so {} fit on one bus",
            100.0 * load,
            bus.bitrate_bit_s,
            (LOAD_MAX / load).floor()
        );
    }
    writeln!(out, "actuators: {}", config.actuators().len())?;
    for actuator in config.actuators() {
        write!(
            out,
            "  {}: number {} on {}, type {} with {} drive at {} Hz",
            actuator.name,
            actuator.id.index(),
            actuator.bus.as_deref().unwrap_or("any bus"),
            actuator.type_name,
            actuator.drive.kind.name(),
            actuator.params.sensors.sample_rate
        )?;
        for (what, file) in [("type", &actuator.type_calibration), ("unit", &actuator.calibration)] {
            if let Some(file) = file {
                write!(out, ", {what} calibrated by {}", file.display())?;
            }
        }
        if let Some(learning) = &actuator.learning {
            let (windows, folder) = (learning.windows, learning.folder.display());
            write!(out, ", unit learnt from {windows} windows, kept in {folder}")?;
        }
        for (what, value) in [("part", &actuator.part_number), ("serial", &actuator.serial_number)] {
            if let Some(value) = value {
                write!(out, ", {what} {value}")?;
            }
        }
        writeln!(out)?;
        if let Some(map) = &actuator.map {
            write_map(out, actuator, map)?;
        }
        write_log_map(out, actuator)?;
    }
    for line in &config.serial {
        writeln!(out, "serial line: {} at {}", line.bus, line.device.display())?;
    }
    for load in config.bus_loads() {
        let (name, percent) = (load.name(), 100.0 * load.load);
        writeln!(out, "bus load: {name} {percent:.0} % of {} bit/s", load.bitrate_bit_s)?;
    }
    Ok(())
}

/// Every parameter of the types that are used or described.
fn write_types(out: &mut String, config: &Config) -> fmt::Result {
    for (name, parameters) in config.effective_parameters() {
        writeln!(out, "type {name}:")?;
        write_parameters(out, &parameters)?;
    }
    Ok(())
}

/// What is mapped of logs of measured signals, and what comes of what is not.
fn write_log_map(out: &mut String, actuator: &ActuatorConfig) -> fmt::Result {
    if let Some(Err(misfit)) = actuator.drive_bus.as_ref().map(|drive| drive.map()) {
        let name = &actuator.name;
        return writeln!(
            out,
            "    {name}: waits until its master writes the PDO: expected {misfit}"
        );
    }
    let Some(map) = &actuator.log else { return Ok(()) };
    match &actuator.drive_bus {
        Some(drive) => write!(
            out,
            "    {} node {}, listened to:",
            drive.settings().preset.name(),
            drive.settings().node
        )?,
        None => write!(out, "    {}, of logs:", actuator.name)?,
    }
    for column in map.columns() {
        write!(out, " {} {:?}", column.quantity.key(), column.signal)?;
    }
    writeln!(out)?;
    for gap in map.gaps() {
        writeln!(out, "    {gap}")?;
    }
    Ok(())
}

/// What a map has, and what comes of what it lacks.
fn write_map(out: &mut String, actuator: &ActuatorConfig, map: &SignalMap) -> fmt::Result {
    let file = actuator.dbc.as_deref().unwrap_or(Path::new(""));
    writeln!(out, "    mapped by {}:", file.display())?;
    for message in &map.messages {
        write!(out, "    {} {}:", message.name, message.shown_id())?;
        for binding in &message.bindings {
            write!(out, " {}", binding.role.key())?;
        }
        for counter in &message.counters {
            write!(out, " sample.counter of {} bits", counter.layout.size)?;
        }
        writeln!(out)?;
    }
    let rate_hz = actuator.params.sensors.sample_rate;
    for message in map.uncounted() {
        writeln!(
            out,
            "    {} has no counter: its frames join a sample by their stamps, at most {} ms apart",
            message.name,
            500.0 / rate_hz
        )?;
    }
    let lacking = [
        (Role::CurrentC, "it is what the other two leave".to_owned()),
        (Role::Time, format!("the rate is taken to be {rate_hz} Hz")),
        (Role::DcLink, "the nominal voltage of the type holds".to_owned()),
        (Role::WindingTemp, "the motor is known less well".to_owned()),
        (Role::LoadTorque, "it is an unknown of every window".to_owned()),
    ];
    for (role, consequence) in lacking.iter().filter(|(role, _)| !map.has(*role)) {
        writeln!(out, "    no {}: {consequence}", role.key())?;
    }
    Ok(())
}

/// The levels that most faults share, then those that differ.
fn write_health(out: &mut String, config: &Config) -> fmt::Result {
    let levels = config.health().levels();
    let count = |of: &Levels| levels.iter().filter(|other| *other == of).count();
    let common = levels.iter().rev().max_by_key(|own| count(own)).unwrap_or(&levels[0]);
    write_levels(out, "every fault", common)?;
    for (name, own) in FaultId::NAMES.iter().zip(levels).filter(|(_, own)| *own != common) {
        write_levels(out, &format!("except {name}"), own)?;
    }
    Ok(())
}

fn write_levels(out: &mut String, which: &str, levels: &Levels) -> fmt::Result {
    let Levels {
        watch,
        warning,
        critical,
        end_of_life,
        hysteresis,
        persistence,
    } = levels;
    writeln!(
        out,
        "health, {which}: watch {watch}, warning {warning}, critical {critical}, end of life {end_of_life}, \
         hysteresis {hysteresis}, persistence {persistence}"
    )
}

fn write_rul(out: &mut String, config: &Config) -> fmt::Result {
    let RulConfig {
        hours,
        horizon_h,
        warning_h,
        critical_h,
        state,
        events,
    } = config.rul();
    write!(
        out,
        "remaining life: {} hours, horizon {horizon_h} h, warning below {warning_h} h, critical below {critical_h} h",
        name_of(*hours, &HoursOf::NAMES)
    )?;
    for (what, path) in [("state", state), ("events", events)] {
        if let Some(path) = path {
            write!(out, ", {what} in {}", path.display())?;
        }
    }
    writeln!(out)
}

fn name_of<T: PartialEq>(value: T, names: &[(&'static str, T)]) -> &'static str {
    names
        .iter()
        .find(|(_, named)| *named == value)
        .map_or("?", |(name, _)| name)
}
