//! `hmd simulate`: the reference model writes a log, and its truth beside it.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use ema_models::reference::{Actuations, CurrentSensing, Drive, EFFECTS, EffectSettings, Effects, Scenario};
use ema_models::{ActuatorParams, DriveParams, FAULT_COUNT, FaultVector, Profile};
use ema_wire::ActuatorId;
use ema_wire::bus_load::bus_load;

use super::instant::instant;
use super::outputs::{Content, Outputs};
use super::{Exit, Misuse, load_config, say, unknown_type};
use hmd_core::config::LOAD_MAX;
use hmd_core::drive_bus::Preset;
use hmd_lab::drive_traffic::DriveLink;
use hmd_lab::effects_file::{self, EffectsFileError};
use hmd_lab::recording::{self, RecordingFormat, Sender};

/// Bit rate of the simulated bus.
const BIT_RATE_BIT_S: f64 = 1e6;

/// Write a log of simulated actuations.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n\
    \x20 hmd simulate -o worn.log --fault friction=0.4 --noise 0.05 --seed 7\n\
    \x20 hmd simulate -o slow.mcap --rate 400 --windows 5 --k 0.2,0,0,0.1,0,0,0.5,0.5\n\
    \x20 hmd simulate -o real.log --drive vector --with dead_time_s=1.5e-6 --with cogging_nm=0.05")]
pub struct Args {
    /// Log to write: `.mcap`, or `.log` for candump text.
    #[arg(short, long, required_unless_present = "list_effects")]
    output: Option<PathBuf>,
    /// The whole fault vector, k1,…,k8.
    #[arg(long, value_delimiter = ',', value_name = "K1,…,K8")]
    k: Vec<f64>,
    /// One fault by name (friction, backlash, short_a, short_b, short_c, eccentricity, eccentricity_phase, gain).
    #[arg(long, value_parser = named_fault, value_name = "NAME=K")]
    fault: Vec<(usize, f64)>,
    /// One effect of a real actuator by name (see --list-effects); holds over the same effect in --effects.
    #[arg(long, value_parser = named_effect, value_name = "EFFECT=VALUE")]
    with: Vec<EffectSettings>,
    /// Power electronics; default those of the type.
    #[arg(long, value_parser = named_drive, value_name = "hysteresis|vector")]
    drive: Option<Drive>,
    /// Effects from a TOML file: lines EFFECT = VALUE, and drive = "vector".
    #[arg(long, value_name = "FILE")]
    effects: Option<PathBuf>,
    /// Print name, unit, usual range for the type, equation and source ([D]: declared here) of each effect, and write nothing.
    #[arg(long)]
    list_effects: bool,
    /// What each actuation commands.
    #[arg(long, value_parser = named_profile, default_value = "mixed", value_name = "step|ramp|chirp|mixed")]
    profile: Profile,
    /// What the profile commands: the output angle or the motor speed.
    #[arg(
        long,
        value_enum,
        default_value_t,
        value_name = "position|speed",
        hide_possible_values = true
    )]
    mode: Mode,
    /// Number of actuations, their direction alternating.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    windows: u32,
    /// When it begins, as 2026-11-20T14:00Z, 2026-11-20T15:00+01:00 or UTC ns.
    #[arg(long, default_value = "2023-11-14T22:13:20Z", value_name = "TIME", value_parser = instant)]
    start: u64,
    /// Sampling rate, Hz; default that of the type.
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Current noise, A rms; above 0 the current converters are in the path too.
    #[arg(long, default_value_t = 0.0, value_parser = not_negative)]
    noise: f64,
    /// Constant load at the output, Nm; positive opposes positive motion.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite, value_name = "NM")]
    load: f64,
    /// Type of the actuator: bench, servo28, servo270 or one of the configuration's.
    #[arg(long, default_value = "bench", value_name = "TYPE")]
    actuator: String,
    /// CAN number of the actuator.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..16))]
    id: u8,
    /// Frames of a drive as it is sold, of node `--id`, instead of the built-in ones.
    #[arg(long, value_parser = named_preset, value_name = "cia402|odrive|moteus|vesc|damiao")]
    preset: Option<Preset>,
    /// With `--preset`: a second encoder at the output is sent too.
    #[arg(long, requires = "preset")]
    output_encoder: bool,
    /// Configuration that defines further types.
    #[arg(short, long)]
    config: Option<PathBuf>,
    /// Draws rotor angle, place in the backlash, first direction and noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// What the profile commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum Mode {
    #[default]
    Position,
    Speed,
}

/// Runs the verb.
///
/// # Errors
/// A bad configuration or argument, or a file that cannot be read or written.
pub fn run(args: &Args) -> anyhow::Result<Exit> {
    let config = load_config(args.config.as_deref())?;
    let Some(found) = config.actuator_type(&args.actuator) else {
        return Err(unknown_type(&args.actuator).into());
    };
    let mut params = found.params;
    // Without a log to write, the list of effects was asked for.
    let (Some(output), false) = (&args.output, args.list_effects) else {
        return list_effects(&params);
    };
    let Some(format) = RecordingFormat::of(output) else {
        let found = output.display();
        return Err(Misuse(format!("{found}: expected a name that ends in .mcap or .log")).into());
    };
    let content = match format {
        RecordingFormat::Mcap => Content::Recording,
        RecordingFormat::Candump => Content::Candump,
    };
    let outputs = Outputs(&[(output, content), (&recording::truth_path(output), Content::Truth)]);
    outputs.check(config.files().iter().chain(&args.effects))?;
    if let Some(rate) = args.rate {
        params.sensors.sample_rate = rate;
        params = params.checked().map_err(|e| Misuse(format!("--rate: {e}")))?;
    }
    let load = bus_load(params.sensors.sample_rate, 1, BIT_RATE_BIT_S);
    if load > LOAD_MAX {
        return Err(Misuse(format!(
            "--rate: expected at most {:.0} % of a 1 Mbit/s bus, found {:.1} %",
            100.0 * LOAD_MAX,
            // Upwards, so that what exceeds the limit also reads so.
            (1000.0 * load).ceil() / 10.0
        ))
        .into());
    }
    let Some(actuator) = ActuatorId::new(args.id) else {
        return Err(Misuse(format!("--id: expected 0 to 15, found {}", args.id)).into());
    };
    let mut effects = effects(args, &found.drive)?;
    // A drive that has no encoder at the output closes its loop over the motor's.
    effects.controller.closes_over_motor = args.preset.is_some() && !args.output_encoder;
    let scenario = Scenario {
        load_torque: args.load,
        effects,
        sensing: CurrentSensing {
            quantised: args.noise > 0.0,
            noise_rms: args.noise,
        },
        actuations: Actuations {
            profile: profile(args),
            count: args.windows,
            rest: 0.5,
            length: 0.5,
        },
        ..Scenario::new(params, fault_vector(args)?, args.seed)
    };
    let drive_of_type = Drive::of_type(&found.drive);
    let sender = match args.preset {
        Some(preset) if !preset.nodes().contains(&u32::from(args.id)) => {
            return Err(Misuse(format!("--id: expected 1 to 15 with --preset, found {}", args.id)).into());
        }
        Some(preset) => {
            let (node, has_output_encoder) = (args.id, args.output_encoder);
            let link = DriveLink {
                preset,
                node,
                has_output_encoder,
            };
            Sender::Drive(actuator, link)
        }
        None => Sender::BuiltIn(actuator),
    };
    recording::write(output, format, &scenario, args.start, &drive_of_type, sender)?;
    Ok(Exit::Done)
}

/// Prints every effect, with the range of usual values for a type.
fn list_effects(params: &ActuatorParams) -> anyhow::Result<Exit> {
    let rows = EFFECTS.iter().map(|info| {
        let equation = match info.part_of {
            None => info.equation.to_owned(),
            Some(part_of) => format!("{} (with {part_of})", info.equation),
        };
        let usual = range(info.usual_on(params));
        [
            info.name.to_owned(),
            info.unit.to_owned(),
            usual,
            equation,
            info.source.to_owned(),
        ]
    });
    let head = ["effect", "unit", "usual range", "equation", "source"].map(str::to_owned);
    let table: Vec<_> = std::iter::once(head).chain(rows).collect();
    let width = |column: usize| table.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths = [0, 1, 2, 3].map(width);
    for [name, unit, usual, equation, source] in &table {
        let [a, b, c, d] = widths;
        say(&format!("{name:a$}  {unit:b$}  {usual:c$}  {equation:d$}  {source}"))?;
    }
    Ok(Exit::Done)
}

/// A range of numbers with at most three significant digits.
fn range((min, max): (f64, f64)) -> String {
    let short = |x: f64| {
        let digits = format!("{x:.2e}").parse().unwrap_or(x);
        if x.abs() < 1e-3 && x.abs() > 0.0 {
            format!("{digits:e}")
        } else {
            digits.to_string()
        }
    };
    let (min, max) = (short(min), short(max));
    if min == max {
        max
    } else if min.strip_prefix('-') == Some(&max) {
        format!("±{max}")
    } else {
        format!("{min} to {max}")
    }
}

/// The profile in the mode asked for.
fn profile(args: &Args) -> Profile {
    match args.mode {
        Mode::Position => args.profile,
        // Every profile that has a name has a shape in speed mode.
        Mode::Speed => args.profile.in_speed_mode().unwrap_or(Profile::Speed),
    }
}

/// The effects of the file and the options, which hold over the file; else the drive of the type.
fn effects(args: &Args, of_type: &DriveParams) -> anyhow::Result<Effects> {
    let file = args.effects.as_deref().map(from_file).transpose()?;
    let mut settings = file.unwrap_or_default();
    settings.drive = args.drive.or(settings.drive);
    for one in &args.with {
        settings = settings.overridden_by(one);
    }
    Ok(settings
        .effects_on(Drive::of_type(of_type))
        .map_err(|e| Misuse(e.to_string()))?)
}

fn from_file(path: &Path) -> anyhow::Result<EffectSettings> {
    effects_file::load(path).map_err(|error| match error {
        EffectsFileError::Read { .. } => error.into(),
        wrong => Misuse(wrong.to_string()).into(),
    })
}

fn fault_vector(args: &Args) -> anyhow::Result<FaultVector> {
    let mut k = FaultVector::NOMINAL.to_array();
    if !args.k.is_empty() {
        k = args
            .k
            .as_slice()
            .try_into()
            .map_err(|_| Misuse(format!("--k: expected {FAULT_COUNT} numbers, found {}", args.k.len())))?;
    }
    for &(index, value) in &args.fault {
        k[index] = value;
    }
    let fault = FaultVector::from_array(k);
    if let Some(p) = (0..FAULT_COUNT).find(|&p| !(0.0..=1.0).contains(&k[p])) {
        return Err(Misuse(format!(
            "{}: expected a number from 0 to 1, found {}",
            FaultVector::NAMES[p],
            k[p]
        ))
        .into());
    }
    Ok(fault)
}

fn named_fault(text: &str) -> Result<(usize, f64), String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=K")?;
    let names = FaultVector::NAMES;
    let index = names
        .iter()
        .position(|n| *n == name)
        .ok_or_else(|| format!("expected one of {}", names.join(", ")))?;
    Ok((
        index,
        value
            .parse()
            .map_err(|_| format!("expected a number, found {value:?}"))?,
    ))
}

pub(super) fn named_profile(text: &str) -> Result<Profile, String> {
    let found = Profile::NAMES.into_iter().find(|(name, _)| *name == text);
    found
        .map(|(_, profile)| profile)
        .ok_or_else(|| "expected step, ramp, chirp or mixed".to_owned())
}

fn named_effect(text: &str) -> Result<EffectSettings, String> {
    let (name, value) = text.split_once('=').ok_or("expected EFFECT=VALUE")?;
    let value = value
        .parse()
        .map_err(|_| format!("expected a number, found {value:?}"))?;
    let mut settings = EffectSettings::default();
    settings.set(name, value).map_err(|e| e.to_string())?;
    Ok(settings)
}

fn named_preset(text: &str) -> Result<Preset, String> {
    let found = Preset::NAMES.into_iter().find(|(name, _)| *name == text);
    found
        .map(|(_, preset)| preset)
        .ok_or_else(|| format!("expected one of {}", Preset::NAMES.map(|(name, _)| name).join(", ")))
}

fn named_drive(text: &str) -> Result<Drive, String> {
    Drive::from_name(text).ok_or_else(|| "expected hysteresis or vector".to_owned())
}

fn finite(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|x: &f64| x.abs() <= 1e6)
        .ok_or_else(|| "expected a number from -1e6 to 1e6".to_owned())
}

fn not_negative(text: &str) -> Result<f64, String> {
    finite(text).and_then(|x| {
        if x >= 0.0 {
            Ok(x)
        } else {
            Err("expected a number from 0 to 1e6".to_owned())
        }
    })
}
