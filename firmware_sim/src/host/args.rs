//! The command line: options, and the plan, link faults and output they give.

use std::path::PathBuf;

use clap::{Parser, ValueEnum};
use ema_models::reference::{Drive, EffectSettings};
use ema_models::{FAULT_COUNT, FaultVector, Profile};
use ema_wire::ActuatorId;
use firmware_sim::{ActuatorKind, LinkFaults, Plan, Settings};

use crate::output::Output;

/// Send a simulated actuator's samples and status on a serial line or a CAN bus.
#[derive(Debug, Parser)]
#[command(version, about)]
pub(crate) struct Args {
    /// File or serial device to write to (default: stdout). The speed of a serial device is not changed.
    #[arg(short, long, value_name = "PATH", group = "where")]
    output: Option<PathBuf>,
    /// Create a pseudo-terminal and this symbolic link to it. Bytes that are not read in time are lost, as on a wire.
    #[arg(long, value_name = "LINK", group = "where")]
    pty: Option<PathBuf>,
    /// CAN interface to send on.
    #[arg(long, value_name = "INTERFACE", group = "where")]
    can: Option<String>,
    /// Send in real time (default on a serial device, a pseudo-terminal and CAN) or as fast as possible (default otherwise).
    #[arg(long, value_enum)]
    pub(crate) pace: Option<Pace>,
    /// The fault vector, k1,…,k8.
    #[arg(long, value_parser = fault_vector, default_value = "0,0,0,0,0,0,0.5,0.5", value_name = "K1,…,K8")]
    k: FaultVector,
    /// Wear: the increase of the fault vector with each actuation.
    #[arg(long, value_parser = numbers, value_name = "K1,…,K8", allow_hyphen_values = true)]
    growth: Option<[f64; FAULT_COUNT]>,
    /// One effect of a real actuator by name, as in hmd simulate (hmd simulate --list-effects prints all).
    #[arg(long, value_parser = effect, value_name = "EFFECT=VALUE")]
    with: Vec<EffectSettings>,
    /// Power electronics; default those of the type.
    #[arg(long, value_parser = drive, value_name = "hysteresis|vector")]
    drive: Option<Drive>,
    /// Command of each actuation.
    #[arg(long, value_parser = profile, default_value = "mixed", value_name = "step|ramp|chirp|mixed")]
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
    /// Number of actuations, one per second, in alternating directions.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    windows: u32,
    /// Sampling rate, Hz (default: that of the actuator type).
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Current noise, A rms; a value above 0 also switches the 12-bit converters on.
    #[arg(long, default_value_t = 0.0, value_parser = not_negative)]
    noise: f64,
    /// Constant load at the output, Nm; positive opposes positive motion.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_parser = finite, value_name = "NM")]
    load: f64,
    /// Type of the actuator.
    #[arg(long, default_value = "bench", value_parser = ["bench", "servo28", "servo270"])]
    actuator: String,
    /// Number of the actuator in its frames.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..16))]
    id: u8,
    /// Seed of rotor angle, position in the backlash, first direction, noise and link faults.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Probability that a frame is lost.
    #[arg(long, default_value_t = 0.0, value_parser = probability, help_heading = "Link faults")]
    drop: f64,
    /// Probability that a frame arrives twice.
    #[arg(long, default_value_t = 0.0, value_parser = probability, help_heading = "Link faults")]
    duplicate: f64,
    /// Probability that a frame arrives after the next one.
    #[arg(long, default_value_t = 0.0, value_parser = probability, help_heading = "Link faults")]
    reorder: f64,
    /// Probability that one bit of a frame is flipped; on CAN an error frame, or a value wrong by 1 A or 50 counts.
    #[arg(long, default_value_t = 0.0, value_parser = probability, help_heading = "Link faults")]
    flip: f64,
    /// Probability at each sample that a signal becomes stuck, for up to 8 samples.
    #[arg(long, default_value_t = 0.0, value_parser = probability, help_heading = "Link faults")]
    stuck: f64,
    /// Largest delay of a frame, ms.
    #[arg(long, default_value_t = 0.0, value_parser = not_negative, value_name = "MS", help_heading = "Link faults")]
    delay: f64,
    /// Drift of the device's clock, ppm; a positive drift is a fast clock.
    #[arg(
        long, default_value_t = 0.0, allow_negative_numbers = true, value_parser = ppm, value_name = "PPM",
        help_heading = "Link faults"
    )]
    drift: f64,
}

/// What the profile commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum Mode {
    #[default]
    Position,
    Speed,
}

/// Times of transmission.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Pace {
    /// Each frame at its time.
    RealTime,
    /// Each frame as soon as possible.
    Fast,
}

impl Args {
    pub(crate) fn plan(&self) -> Result<Plan, String> {
        let mut effects = EffectSettings::with_drive(self.drive);
        for one in &self.with {
            effects = effects.overridden_by(one);
        }
        let drive_of_type = Drive::of_built_in(&self.actuator);
        effects.effects_on(drive_of_type).map_err(|e| e.to_string())?;
        let settings = Settings {
            actuator: ActuatorKind::from_name(&self.actuator).unwrap_or_default(),
            k: self.k,
            growth: self.growth.unwrap_or_default(),
            effects,
            profile: self.profile,
            speed_mode: self.mode == Mode::Speed,
            windows: self.windows,
            rate_hz: self.rate,
            noise_a: self.noise,
            load_nm: self.load,
            ..Settings::new(ActuatorId::new(self.id).ok_or("--id: expected 0 to 15")?, self.seed)
        };
        settings.plan().map_err(|e| format!("--{e}"))
    }

    pub(crate) fn faults(&self) -> LinkFaults {
        LinkFaults {
            drop: self.drop,
            duplicate: self.duplicate,
            reorder: self.reorder,
            flip: self.flip,
            stuck: self.stuck,
            delay_us: (1e3 * self.delay) as u64,
            drift_ppm: self.drift,
        }
    }

    pub(crate) fn output(&self) -> Result<Output, String> {
        match (&self.output, &self.pty, &self.can) {
            (Some(path), _, _) => Output::path(path),
            (_, Some(link), _) => Output::pty(link),
            (_, _, Some(interface)) => Output::can(interface),
            _ => Ok(Output::stdout()),
        }
    }
}

fn numbers(text: &str) -> Result<[f64; FAULT_COUNT], String> {
    let k: Vec<f64> = text
        .split(',')
        .map(|number| finite(number.trim()).map_err(|expected| format!("{expected}, found {number:?}")))
        .collect::<Result<_, _>>()?;
    let found = k.len();
    k.try_into()
        .map_err(|_| format!("expected {FAULT_COUNT} numbers, found {found}"))
}

fn fault_vector(text: &str) -> Result<FaultVector, String> {
    let fault = FaultVector::from_array(numbers(text)?);
    if fault.is_valid() {
        Ok(fault)
    } else {
        Err("expected numbers from 0 to 1".to_owned())
    }
}

fn effect(text: &str) -> Result<EffectSettings, String> {
    let (name, value) = text.split_once('=').ok_or("expected EFFECT=VALUE")?;
    let mut settings = EffectSettings::default();
    settings.set(name, finite(value)?).map_err(|e| e.to_string())?;
    Ok(settings)
}

fn drive(text: &str) -> Result<Drive, String> {
    Drive::from_name(text).ok_or_else(|| "expected hysteresis or vector".to_owned())
}

fn profile(text: &str) -> Result<Profile, String> {
    let found = Profile::NAMES.into_iter().find(|(name, _)| *name == text);
    found
        .map(|(_, profile)| profile)
        .ok_or_else(|| "expected step, ramp, chirp or mixed".to_owned())
}

fn finite(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|x: &f64| x.is_finite())
        .ok_or_else(|| "expected a finite number".to_owned())
}

fn within(text: &str, range: std::ops::RangeInclusive<f64>) -> Result<f64, String> {
    let x = finite(text)?;
    if range.contains(&x) {
        Ok(x)
    } else {
        Err(format!("expected a number from {} to {}", range.start(), range.end()))
    }
}

fn not_negative(text: &str) -> Result<f64, String> {
    within(text, 0.0..=1e6)
}

fn probability(text: &str) -> Result<f64, String> {
    within(text, 0.0..=1.0)
}

fn ppm(text: &str) -> Result<f64, String> {
    within(text, -1e5..=1e5)
}
