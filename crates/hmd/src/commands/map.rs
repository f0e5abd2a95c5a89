//! `hmd map`: what a log of measured signals holds, and a configuration to edit.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::Context;
use hmd_core::dbc::Role;
use hmd_core::log_map::Quantity;
use hmd_ingest::file::{SurveyedSignal, survey};

use super::{Exit, say};

/// Look into a log of measured signals and print a configuration for it, to edit.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  hmd map bench.csv > hmd.toml")]
pub struct Args {
    /// Log: CSV, Parquet or MF4.
    log: PathBuf,
}

/// Quantities that a configuration has in any case: to fill in where no signal looks like one.
const OFFERED: [Quantity; 6] = [
    Quantity::Of(Role::CurrentA),
    Quantity::Of(Role::CurrentB),
    Quantity::Of(Role::CurrentC),
    Quantity::Of(Role::MotorPosition),
    Quantity::Of(Role::OutputPosition),
    Quantity::Of(Role::CommandPosition),
];

/// Runs the verb.
///
/// # Errors
/// No log of measured signals, or one that cannot be read.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let signals = survey(&args.log)?;
    let text = configuration(&args.log.display().to_string(), &signals).context("writing a text")?;
    say(text.trim_end())?;
    Ok(Exit::Done)
}

fn configuration(log: &str, signals: &[SurveyedSignal]) -> Result<String, std::fmt::Error> {
    let mut out = String::new();
    writeln!(out, "# Signals of {}:", plain(log))?;
    let width = signals
        .iter()
        .map(|signal| signal.name.chars().count())
        .max()
        .unwrap_or(0)
        .min(40);
    for signal in signals {
        let name = plain(&signal.name);
        let rate = signal
            .rate_hz
            .map_or("?".to_owned(), |rate| format!("{}", (rate * 10.0).round() / 10.0));
        let range = match signal.range {
            Some([least, largest]) => format!("{least} to {largest}"),
            None => "no number".to_owned(),
        };
        let unit = plain(signal.unit.as_deref().unwrap_or("-"));
        writeln!(out, "#   {name:width$}  {rate:>8} Hz  {range} {unit}")?;
    }
    writeln!(
        out,
        "# What follows is guessed by names and units: check it, above all the signs and the zero of the motor's angle."
    )?;
    writeln!(out, "[map]")?;
    let guessed = |quantity: Quantity| signals.iter().find(|signal| signal.guess == Some(quantity));
    let is_dq = guessed(Quantity::CurrentQ).is_some() && guessed(Quantity::Of(Role::CurrentA)).is_none();
    for quantity in order() {
        let is_own_time = |signal: &SurveyedSignal| quantity == Quantity::Time && signal.is_own_time;
        match guessed(quantity) {
            Some(signal) if is_own_time(signal) => writeln!(out, "# The log has its own time.")?,
            Some(signal) => writeln!(out, "{}", line(quantity, signal))?,
            None if OFFERED.contains(&quantity) && !(is_dq && quantity.key().starts_with("currents.")) => {
                writeln!(out, "# {} = {{ signal = \"…\", unit = \"…\" }}", quantity.key())?;
            }
            None => {}
        }
    }
    Ok(out)
}

/// Quantities in the order in which a person reads them.
fn order() -> Vec<Quantity> {
    let place = |quantity: &Quantity| match quantity {
        Quantity::Time => 0,
        Quantity::Of(Role::CurrentA | Role::CurrentB | Role::CurrentC) | Quantity::CurrentD | Quantity::CurrentQ => 1,
        Quantity::Counter => 3,
        Quantity::Of(Role::Time) => 4,
        Quantity::Of(role) if !role.is_sampled() => 5,
        Quantity::Of(_) => 2,
    };
    let mut all: Vec<Quantity> = Quantity::all().collect();
    all.sort_by_key(place);
    all
}

fn line(quantity: Quantity, signal: &SurveyedSignal) -> String {
    let name = quoted(&signal.name);
    let needs_unit = !matches!(quantity, Quantity::Counter | Quantity::MODE);
    let wraps = wraps_after(quantity, signal);
    let unit = match &signal.unit {
        None if needs_unit => ", unit = \"…\"".to_owned(),
        None => String::new(),
        Some(_) if wraps.is_none() => return format!("{} = {name}", quantity.key()),
        Some(unit) => format!(", unit = {}", quoted(unit)),
    };
    let wraps = wraps.map_or(String::new(), |range| format!(", wraps_after = {range}"));
    if unit.is_empty() && wraps.is_empty() {
        return format!("{} = {name}", quantity.key());
    }
    format!("{} = {{ signal = {name}{unit}{wraps} }}", quantity.key())
}

/// The turn after which an angle begins again, if its range is nearly one.
fn wraps_after(quantity: Quantity, signal: &SurveyedSignal) -> Option<f64> {
    /// Share of a turn that a wrapping angle passes in nearly every log.
    const NEARLY: f64 = 0.99;
    if !matches!(quantity, Quantity::Of(Role::MotorPosition | Role::OutputPosition)) {
        return None;
    }
    let turn = match signal.unit.as_deref()? {
        "deg" | "°" => 360.0,
        "rad" => core::f64::consts::TAU,
        "rev" => 1.0,
        _ => return None,
    };
    let [least, largest] = signal.range?;
    (NEARLY * turn..=turn).contains(&(largest - least)).then_some(turn)
}

/// A text as TOML has it.
fn quoted(text: &str) -> String {
    format!("\"{}\"", plain(text).replace('\\', "\\\\").replace('"', "\\\""))
}

/// A text without what breaks a line.
fn plain(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hmd_core::config::Config;

    fn signal(name: &str, unit: &str, range: [f64; 2]) -> SurveyedSignal {
        SurveyedSignal {
            name: name.to_owned(),
            unit: (!unit.is_empty()).then(|| unit.to_owned()),
            is_own_time: false,
            values: 10,
            rate_hz: Some(399.96),
            range: Some(range),
            guess: Quantity::guess(name, Some(unit).filter(|unit| !unit.is_empty())),
        }
    }

    #[test]
    fn a_guessed_configuration_is_one() {
        let signals = [
            signal("t", "s", [0.0, 1.0]),
            signal("I_A", "A", [-3.0, 3.0]),
            signal("I\"B\n", "A", [-3.0, 3.0]),
            signal("I_B", "mA", [-3.0, 3.0]),
            signal("motor_angle", "deg", [0.1, 359.9]),
            signal("output_angle", "deg", [0.0, 14.0]),
            signal("angle_demand", "deg", [0.0, 14.0]),
            signal("mode", "", [0.0, 1.0]),
        ];
        let text = configuration("a.csv", &signals).unwrap();
        assert!(
            text.contains("#   motor_angle        400 Hz  0.1 to 359.9 deg\n"),
            "{text}"
        );
        assert!(
            text.contains("position.motor = { signal = \"motor_angle\", unit = \"deg\", wraps_after = 360 }\n"),
            "{text}"
        );
        assert!(text.contains("# currents.c = { signal"), "{text}");
        assert!(text.contains("command.mode = \"mode\"\n"), "{text}");
        let config = Config::from_toml_str(&text, "hmd.toml").unwrap();
        assert!(config.actuator_of_logs().is_some());
    }
}
