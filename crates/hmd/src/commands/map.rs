//! `hmd map`: what a log of measured signals holds, and a configuration to edit.

mod guesses;
mod line;

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::Context;
use hmd_core::dbc::Role;
use hmd_core::log_map::Quantity;
use hmd_ingest::file::{Survey, SurveyedSignal, survey};

use super::{Exit, say};
use guesses::Guesses;
use line::{line, plain, quoted};

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
    let survey = survey(&args.log)?;
    let text = configuration(&args.log.display().to_string(), &survey).context("writing a text")?;
    say(text.trim_end())?;
    Ok(Exit::Done)
}

fn configuration(log: &str, survey: &Survey) -> Result<String, std::fmt::Error> {
    let mut out = String::new();
    write_signals(&mut out, log, survey)?;
    writeln!(
        out,
        "# What follows is guessed by names and units: check it, above all the signs and the zero of the motor's angle."
    )?;
    writeln!(out, "[map]")?;
    let guesses = Guesses::of(&survey.signals);
    let continuous = Quantity::all().filter(Quantity::is_continuous);
    if has_several_rates(continuous.filter_map(|quantity| guesses.written(quantity))) {
        writeln!(out, "# Currents and angles have several rates: they are interpolated.")?;
        writeln!(out, "resample = true")?;
    } else if !has_all_continuous(&guesses) && has_several_rates(&survey.signals) {
        writeln!(out, "# resample = true  # where currents and angles have several rates")?;
    }
    for quantity in order() {
        write_quantity(&mut out, quantity, &guesses)?;
        if quantity == Quantity::Of(Role::CurrentC)
            && [quantity, Quantity::CurrentQ]
                .iter()
                .all(|of| guesses.meant(*of).is_none())
        {
            writeln!(
                out,
                "# Instead of phase currents: currents.q, and currents.d where it is known."
            )?;
        }
    }
    write!(out, "{OWN_TYPE}")?;
    Ok(out)
}

/// What the log holds.
fn write_signals(out: &mut String, log: &str, survey: &Survey) -> std::fmt::Result {
    let signals = &survey.signals;
    writeln!(out, "# Signals of {}:", plain(log))?;
    let width = signals.iter().map(|signal| signal.name.chars().count());
    let width = width.max().unwrap_or(0).min(40);
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
    for name in &survey.not_read {
        writeln!(
            out,
            "#   {:width$}  not read: of a type without plain numbers",
            plain(name)
        )?;
    }
    Ok(())
}

/// The lines of one quantity.
fn write_quantity(out: &mut String, quantity: Quantity, guesses: &Guesses<'_>) -> std::fmt::Result {
    let is_dq = guesses.meant(Quantity::CurrentQ).is_some();
    match guesses.meant(quantity) {
        Some(signal) if signal.is_own_time => writeln!(out, "# The log has its own time.")?,
        Some(signal) => match guesses.why_not(quantity, signal) {
            Some(why) => writeln!(out, "# {}  # {why}", line(quantity, signal))?,
            None => writeln!(out, "{}", line(quantity, signal))?,
        },
        None if OFFERED.contains(&quantity) && !(is_dq && quantity.is_current()) => {
            writeln!(out, "# {} = {{ signal = \"…\", unit = \"…\" }}", quantity.key())?;
        }
        None => {
            if let Some(signal) = guesses.by_unit(quantity) {
                writeln!(out, "# {}  # the only signal in such a unit", line(quantity, signal))?;
            }
        }
    }
    match guesses.others(quantity) {
        others if others.is_empty() => Ok(()),
        others => writeln!(out, "# {} may be {} instead.", quantity.key(), others.join(", ")),
    }
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

/// Whether currents and both angles look like ones.
fn has_all_continuous(guesses: &Guesses<'_>) -> bool {
    let has = |quantity: Quantity| guesses.written(quantity).is_some();
    let angles = [Role::MotorPosition, Role::OutputPosition];
    (has(Quantity::CurrentQ) || has(Quantity::Of(Role::CurrentA)))
        && angles.into_iter().all(|role| has(Quantity::Of(role)))
}

/// Whether signals come at different rates.
fn has_several_rates<'a>(signals: impl IntoIterator<Item = &'a SurveyedSignal>) -> bool {
    /// Share by which two rates of one log are the same.
    const SAME: f64 = 0.02;
    let mut rates = signals.into_iter().filter_map(|signal| signal.rate_hz);
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

#[cfg(test)]
mod tests {
    use super::line::wraps_after;
    use super::*;
    use hmd_core::config::Config;
    use hmd_core::log_map::Doubt;

    fn signal(name: &str, unit: &str, range: [f64; 2]) -> SurveyedSignal {
        let guess = Quantity::guess(name, Some(unit).filter(|unit| !unit.is_empty()));
        SurveyedSignal {
            name: name.to_owned(),
            unit: (!unit.is_empty()).then(|| unit.to_owned()),
            is_own_time: false,
            values: 10,
            rate_hz: Some(399.96),
            range: Some(range),
            jump: 0.0,
            texts: Vec::new(),
            guess: guess.as_ref().map(|guess| guess.quantity),
            doubt: guess.as_ref().map_or(Doubt::None, |guess| guess.doubt),
            is_ambiguous: false,
            guessed_unit: guess.and_then(|guess| guess.unit),
        }
    }

    fn configuration(log: &str, signals: &[SurveyedSignal]) -> String {
        let (signals, not_read) = (signals.to_vec(), vec!["x.y".to_owned()]);
        super::configuration(log, &Survey { signals, not_read }).unwrap()
    }

    #[test]
    fn a_name_that_several_columns_have_stands_in_a_comment() {
        let twice = SurveyedSignal {
            is_ambiguous: true,
            ..signal("I_A", "A", [-3.0, 3.0])
        };
        let text = configuration("a.csv", &[twice.clone(), twice]);
        let expected = "# currents.a = \"I_A\"  # several columns have this name: rename the others in the file\n";
        assert!(text.contains(expected), "{text}");
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
        let text = configuration("a.csv", &signals);
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
            "command.mode = { signal = \"mode\", position = \"…\" }"
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
            let text = configuration("a.csv", &signals);
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
        let text = configuration("a.csv", &signals);
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
        let text = configuration("a.mf4", &signals);
        assert!(
            text.contains(
                "# position.motor = { signal = \"ThetaEl\", unit = \"rad\", scale = …, wraps_after = … }  # the electrical angle: scale"
            ),
            "{text}"
        );
        assert!(text.contains("# resample = true  #"), "{text}");
        assert!(text.contains("# [type.own.motor]\n# pole_pairs = …\n"), "{text}");
    }

    #[test]
    fn the_only_signal_in_the_unit_of_a_condition_is_offered() {
        let signals = [
            signal("Zeit", "s", [0.0, 1.0]),
            signal("Strom_U", "mA", [-3.0, 3.0]),
            signal("Zwischenkreis", "V", [378.0, 382.0]),
            signal("Temp", "K", [290.0, 293.0]),
            signal("Last", "Nm", [0.0, 3.0]),
        ];
        let text = configuration("a.csv", &signals);
        for line in [
            "\nstatus.dc_link = \"Zwischenkreis\"\n",
            "\n# status.winding_temp = \"Temp\"  # the only signal in such a unit\n",
            "\n# status.load_torque = \"Last\"  # the only signal in such a unit\n",
        ] {
            assert!(text.contains(line), "{line}: {text}");
        }
        let two = [&signals[..], &[signal("Gehaeuse", "degC", [20.0, 21.0])]].concat();
        assert!(
            !configuration("a.csv", &two).contains("winding_temp"),
            "which of them, nobody knows"
        );
    }

    #[test]
    fn what_nothing_looks_like_is_offered() {
        let text = configuration("a.csv", &[signal("x", "", [0.0, 1.0])]);
        for offered in [
            "# time = {",
            "# currents.a = {",
            "currents.q, and currents.d",
            "# position.motor = {",
        ] {
            assert!(text.contains(offered), "{offered}: {text}");
        }
    }

    /// The lines of `[map]` that are no comments, of a configuration that hmd takes.
    fn taken(signals: &[SurveyedSignal]) -> (Vec<String>, String) {
        let text = configuration("a.csv", signals);
        let config = Config::from_toml_str(&text, "hmd.toml");
        assert!(config.is_ok_and(|config| config.actuator_of_logs().is_some()), "{text}");
        let lines = text.lines().filter(|line| !line.starts_with('#'));
        (lines.skip(1).map(str::to_owned).collect(), text)
    }

    #[test]
    fn of_several_signals_the_plainest_is_meant_and_the_others_are_named() {
        let angle = [0.0, 200.0];
        let signals = [
            signal("time", "s", [0.0, 1.0]),
            signal("I_a", "A", [-3.0, 3.0]),
            signal("I_b", "A", [-3.0, 3.0]),
            signal("motor position electrical", "deg", [0.0, 359.9]),
            signal("motor_angle_error", "deg", [0.0, 0.0]),
            signal("motor_angle_filtered", "deg", angle),
            signal("motor position", "deg", angle),
            signal("motor position 2", "deg", angle),
            signal("T_motor", "degC", [20.0, 30.0]),
            signal("T_winding", "degC", [20.0, 30.0]),
        ];
        let (lines, text) = taken(&signals);
        assert!(
            lines.contains(&"position.motor = \"motor position\"".to_owned()),
            "{text}"
        );
        assert!(
            lines.contains(&"status.winding_temp = \"T_winding\"".to_owned()),
            "{text}"
        );
        let others = "# position.motor may be \"motor_angle_filtered\", \"motor position 2\" instead.\n";
        assert!(text.contains(others), "{text}");
        assert!(text.contains("#   x.y                        not read: "), "{text}");
    }

    #[test]
    fn what_hmd_would_refuse_beside_each_other_is_a_comment() {
        let base = [
            signal("time", "s", [0.0, 1.0]),
            signal("Ia", "A", [-3.0, 3.0]),
            signal("Ib", "A", [-3.0, 3.0]),
            signal("Iq_fb", "A", [-3.0, 3.0]),
            signal("rotor_angle", "rad", [0.0, 30.0]),
            signal("setpoint_pos", "rad", [0.0, 3.0]),
            signal("setpoint_speed", "rad/s", [-1.0, 1.0]),
        ];
        let with = |more: SurveyedSignal| {
            let signals: Vec<_> = base.iter().cloned().chain([more]).collect();
            let (lines, text) = taken(&signals);
            let keys = lines.iter().map(|line| line.split(" = ").next().unwrap().to_owned());
            (
                keys.filter(|key| key.starts_with('c') || key.starts_with('s'))
                    .collect::<Vec<_>>(),
                text,
            )
        };
        let (keys, text) = with(signal("x", "", [0.0; 2]));
        assert_eq!(keys, ["currents.a", "currents.b", "command.position"], "{text}");
        assert!(
            text.contains("# command.speed = \"setpoint_speed\"  # both set points"),
            "{text}"
        );
        assert!(text.contains("# currents.q = \"Iq_fb\"  # either"), "{text}");
        let both = [
            "currents.a",
            "currents.b",
            "command.position",
            "command.speed",
            "command.mode",
        ];
        assert_eq!(with(signal("mode", "", [0.0, 2.0])).0, both);
        let (keys, text) = with(signal("mode", "", [3.0, 8.0]));
        assert_eq!(keys, both[..3]);
        assert!(
            text.contains("# command.mode = { signal = \"mode\", position = … }  # its values"),
            "{text}"
        );
        let counter = |values| SurveyedSignal {
            values,
            ..signal("counter", "", [0.0, 255.0])
        };
        assert_eq!(with(counter(1800)).0, both[..3], "it begins again");
        assert_eq!(with(counter(256)).0.last().unwrap(), "sample.counter");
        // Without the second phase it is the current of the rotor's frame.
        let signals: Vec<_> = base.iter().filter(|signal| signal.name != "Ib").cloned().collect();
        assert_eq!(taken(&signals).0[1], "currents.q = \"Iq_fb\"");
    }
}
