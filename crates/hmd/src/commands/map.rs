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
const OFFERED: [Quantity; 7] = [
    Quantity::Time,
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
            None if signal.texts.is_empty() => "no number".to_owned(),
            None => signal
                .texts
                .iter()
                .map(|text| quoted(text))
                .collect::<Vec<_>>()
                .join(", "),
        };
        let unit = plain(signal.unit_or_guess().unwrap_or("-"));
        writeln!(out, "#   {name:width$}  {rate:>8} Hz  {range} {unit}")?;
    }
    writeln!(
        out,
        "# What follows is guessed by names and units: check it, above all the signs and the zero of the motor's angle."
    )?;
    writeln!(out, "[map]")?;
    if has_several_rates(signals, |signal| {
        signal.guess.is_some_and(|guess| guess.is_continuous())
    }) {
        writeln!(out, "# Currents and angles have several rates: they are interpolated.")?;
        writeln!(out, "resample = true")?;
    } else if !has_all_continuous(signals) && has_several_rates(signals, |_| true) {
        writeln!(out, "# resample = true  # where currents and angles have several rates")?;
    }
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
        if quantity == Quantity::Of(Role::CurrentC)
            && [quantity, Quantity::CurrentQ].iter().all(|of| guessed(*of).is_none())
        {
            writeln!(
                out,
                "# Instead of phase currents: currents.q, and currents.d where it is known."
            )?;
        }
    }
    if guessed(Quantity::Of(Role::MotorPosition)).is_none() {
        for signal in signals.iter().filter(|signal| is_electrical_angle(&signal.name)) {
            writeln!(
                out,
                "# position.motor = {{ signal = {}, unit = \"…\", scale = …, wraps_after = … }}  # scale: 1 / pole pairs; wraps_after: a turn, as \
                 the log has it",
                quoted(&signal.name)
            )?;
        }
    }
    write!(out, "{OWN_TYPE}")?;
    Ok(out)
}

/// What else a configuration of an actuator has.
const OWN_TYPE: &str = "\
# The actuator, where it is none of the type bench; every number that is not given is that of bench (docs/config.md):
# [[actuator]]
# id = 0
# type = \"own\"
# [type.own]
# based_on = \"bench\"
# [type.own.motor]
# pole_pairs = …
# [type.own.transmission]
# gear_ratio = …
# [type.own.drive]
# kind = \"vector\"
";

/// Whether a name says the electrical angle, which turns once for each pair of poles.
fn is_electrical_angle(name: &str) -> bool {
    let plain: String = name.to_lowercase().chars().filter(|c| c.is_alphanumeric()).collect();
    [
        "thetael",
        "thetae",
        "electricalangle",
        "anglee",
        "angleel",
        "elangle",
        "phiel",
    ]
    .iter()
    .any(|known| plain.ends_with(known))
}

/// Whether currents and both angles look like ones.
fn has_all_continuous(signals: &[SurveyedSignal]) -> bool {
    let has = |quantity: Quantity| signals.iter().any(|signal| signal.guess == Some(quantity));
    let angles = [Role::MotorPosition, Role::OutputPosition];
    (has(Quantity::CurrentQ) || has(Quantity::Of(Role::CurrentA)))
        && angles.into_iter().all(|role| has(Quantity::Of(role)))
}

/// Whether the signals that count come at different rates.
fn has_several_rates(signals: &[SurveyedSignal], counts: impl Fn(&SurveyedSignal) -> bool) -> bool {
    /// Share by which two rates of one log are the same.
    const SAME: f64 = 0.02;
    let mut rates = signals
        .iter()
        .filter(|signal| counts(signal))
        .filter_map(|signal| signal.rate_hz);
    let Some(first) = rates.next() else { return false };
    rates.any(|rate| (rate - first).abs() > SAME * first)
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
    if quantity == Quantity::MODE && !signal.texts.is_empty() {
        return mode_line(&name, &signal.texts);
    }
    let needs_unit = !matches!(quantity, Quantity::Counter | Quantity::MODE);
    let wraps = wraps_after(quantity, signal);
    let unit = match (&signal.unit, &signal.unit_of_name) {
        (None, None) if needs_unit => ", unit = \"…\"".to_owned(),
        (None, None) => String::new(),
        (Some(_), _) if wraps.is_none() => return format!("{} = {name}", quantity.key()),
        (Some(unit), _) | (None, Some(unit)) => format!(", unit = {}", quoted(unit)),
    };
    let wraps = wraps.map_or(String::new(), |range| format!(", wraps_after = {range}"));
    if unit.is_empty() && wraps.is_empty() {
        return format!("{} = {name}", quantity.key());
    }
    format!("{} = {{ signal = {name}{unit}{wraps} }}", quantity.key())
}

/// A mode whose values are texts, with those that look like position and speed mode.
fn mode_line(name: &str, texts: &[String]) -> String {
    let like = |starts: &[&str]| {
        let is_like = |text: &&String| starts.iter().any(|start| text.to_ascii_lowercase().starts_with(start));
        texts
            .iter()
            .find(is_like)
            .map_or("\"…\"".to_owned(), |text| quoted(text))
    };
    let (position, speed) = (like(&["pos", "angle"]), like(&["speed", "spd", "vel"]));
    let key = Quantity::MODE.key();
    let comment = if position.contains('…') { "# " } else { "" };
    // A mode that this log does not have needs no text.
    let speed = if speed.contains('…') {
        String::new()
    } else {
        format!(", speed = {speed}")
    };
    format!("{comment}{key} = {{ signal = {name}, position = {position}{speed} }}")
}

/// The turn after which an angle begins again, if its range is nearly one, or if it jumps by most of its range.
fn wraps_after(quantity: Quantity, signal: &SurveyedSignal) -> Option<f64> {
    /// Share of a turn that a wrapping angle passes in nearly every log.
    const NEARLY: f64 = 0.99;
    /// The same of one that is seen to jump; a jump's share of its range.
    const WITH_A_JUMP: f64 = 0.9;
    if !matches!(quantity, Quantity::Of(Role::MotorPosition | Role::OutputPosition)) {
        return None;
    }
    let [least, largest] = signal.range?;
    let range = largest - least;
    let jumps = range > 0.0 && signal.jump >= WITH_A_JUMP * range;
    let turn = match signal.unit_or_guess()? {
        "deg" | "°" => 360.0,
        "rad" => core::f64::consts::TAU,
        "rev" => 1.0,
        // Of a sensor whose resolution nobody said: turns have powers of two.
        "counts" if jumps => range.log2().ceil().exp2(),
        _ => return None,
    };
    let nearly = if jumps { WITH_A_JUMP } else { NEARLY };
    (nearly * turn..=turn).contains(&range).then_some(turn)
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
        let guess = Quantity::guess(name, Some(unit).filter(|unit| !unit.is_empty()));
        let (guess, unit_of_name) = guess.map_or((None, None), |(guess, unit)| (Some(guess), unit));
        SurveyedSignal {
            name: name.to_owned(),
            unit: (!unit.is_empty()).then(|| unit.to_owned()),
            is_own_time: false,
            values: 10,
            rate_hz: Some(399.96),
            range: Some(range),
            jump: 0.0,
            texts: Vec::new(),
            guess,
            unit_of_name,
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

    #[test]
    fn an_angle_that_jumps_by_a_turn_wraps_and_modes_by_name_are_written() {
        let angle = |range: [f64; 2], jump: f64| SurveyedSignal {
            jump,
            ..signal("motor_angle", "counts", range)
        };
        let wraps = |signal: SurveyedSignal| wraps_after(Quantity::Of(Role::MotorPosition), &signal);
        assert_eq!(wraps(angle([3.0, 16_380.0], 16_300.0)), Some(16_384.0));
        assert_eq!(wraps(angle([3.0, 16_380.0], 30.0)), None, "it does not jump");
        assert_eq!(
            wraps(angle([3.0, 9_000.0], 8_990.0)),
            None,
            "no turn of that many counts"
        );
        let mode = |texts: &[&str]| {
            let texts = texts.iter().map(|text| (*text).to_owned()).collect();
            let signal = SurveyedSignal {
                texts,
                range: None,
                ..signal("mode", "", [0.0; 2])
            };
            line(Quantity::MODE, &signal)
        };
        assert_eq!(
            mode(&["Off", "Position", "Speed"]),
            "command.mode = { signal = \"mode\", position = \"Position\", speed = \"Speed\" }"
        );
        assert_eq!(
            mode(&["off", "tracking"]),
            "# command.mode = { signal = \"mode\", position = \"…\" }"
        );
    }

    #[test]
    fn signals_of_several_rates_are_resampled() {
        let angle = |rate_hz| SurveyedSignal {
            rate_hz: Some(rate_hz),
            ..signal("motor_angle", "rad", [0.0, 14.0])
        };
        let resampled = |rate_hz| {
            let signals = [
                signal("t", "s", [0.0, 1.0]),
                signal("I_A", "A", [-3.0, 3.0]),
                signal("I_B", "A", [-3.0, 3.0]),
                angle(rate_hz),
            ];
            let text = configuration("a.csv", &signals).unwrap();
            let config = Config::from_toml_str(&text, "hmd.toml").unwrap();
            config.actuator_of_logs().unwrap().1.resampling().is_some()
        };
        assert!(!resampled(398.0));
        assert!(resampled(200.0));
    }

    #[test]
    fn units_at_the_ends_of_names_are_written() {
        let columns = [
            ("time_s", [0.0, 1.0]),
            ("iq_A", [-3.0, 3.0]),
            ("id_A", [-3.0, 3.0]),
            ("motor_angle_deg", [0.1, 359.9]),
            ("setpoint_deg", [0.0, 14.0]),
        ];
        let signals = columns.map(|(name, range)| signal(name, "", range));
        let text = configuration("a.csv", &signals).unwrap();
        assert!(
            text.contains("time = { signal = \"time_s\", unit = \"s\" }\n"),
            "{text}"
        );
        assert!(text.contains("unit = \"deg\", wraps_after = 360 }\n"), "{text}");
        let config = Config::from_toml_str(&text, "hmd.toml").unwrap();
        assert!(config.actuator_of_logs().is_some());
    }

    #[test]
    fn an_electrical_angle_is_offered_with_its_scale_and_rates_that_nobody_knows_with_a_comment() {
        let signals = [
            signal("FOC.Iq", "A", [-3.0, 3.0]),
            SurveyedSignal {
                rate_hz: Some(100.0),
                ..signal("ThetaEl", "rad", [0.0, 6.2])
            },
        ];
        let text = configuration("a.mf4", &signals).unwrap();
        assert!(
            text.contains("# position.motor = { signal = \"ThetaEl\", unit = \"…\", scale"),
            "{text}"
        );
        assert!(text.contains("# resample = true  #"), "{text}");
        assert!(text.contains("# [type.own.motor]\n# pole_pairs = …\n"), "{text}");
    }

    #[test]
    fn what_nothing_looks_like_is_offered() {
        let text = configuration("a.csv", &[signal("x", "", [0.0, 1.0])]).unwrap();
        for offered in [
            "# time = {",
            "# currents.a = {",
            "currents.q, and currents.d",
            "# position.motor = {",
        ] {
            assert!(text.contains(offered), "{offered}: {text}");
        }
    }
}
