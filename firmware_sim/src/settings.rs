//! Settings of a simulated device, from the options of the host program or a line of text, and the [`Plan`] they give.

use core::str::FromStr;

use ema_models::reference::{Actuations, CurrentSensing, Drive, EffectSettings, Scenario};
use ema_models::{ActuatorParams, FAULT_COUNT, FaultVector, Profile};
use ema_wire::ActuatorId;

use crate::device::Plan;

/// Rest before the first actuation and after each, and length of each, s.
const REST_S: f64 = 0.5;
const LENGTH_S: f64 = 0.5;

/// Settings of a device, in the units of the command line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Type of the actuator.
    pub actuator: ActuatorKind,
    /// Number of the actuator in its frames.
    pub id: ActuatorId,
    /// The fault vector of the first actuation.
    pub k: FaultVector,
    /// Wear: the increase of the fault vector with each actuation.
    pub growth: [f64; FAULT_COUNT],
    /// Effects of real actuators, by name.
    pub effects: EffectSettings,
    /// Command of each actuation.
    pub profile: Profile,
    /// Whether the profile commands the motor speed, in place of the output angle.
    pub speed_mode: bool,
    /// Number of actuations, one per second, in alternating directions.
    pub windows: u32,
    /// Sampling rate, Hz; `None` for that of the type.
    pub rate_hz: Option<f64>,
    /// Current noise, A rms; a value above 0 also switches the 12-bit converters on.
    pub noise_a: f64,
    /// Constant load at the output, Nm; positive opposes positive motion.
    pub load_nm: f64,
    /// Seed of rotor angle, position in the backlash, first direction and noise.
    pub seed: u64,
}

/// The built-in actuator types.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ActuatorKind {
    /// [`ActuatorParams::bench`].
    #[default]
    Bench,
    /// [`ActuatorParams::servo28`].
    Servo28,
    /// [`ActuatorParams::servo270`].
    Servo270,
}

/// A rejected setting, by its name in the text; `""` for a word that is not a setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BadSetting(pub &'static str);

impl core::fmt::Display for BadSetting {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.0 {
            "" => write!(f, "expected settings {NAMES}, found another word"),
            name => write!(f, "{name}: invalid value"),
        }
    }
}

impl core::error::Error for BadSetting {}

/// Names of the settings in text.
const NAMES: &str = "actuator=, id=, k=, growth=, with=, drive=, profile=, mode=, windows=, rate=, noise=, load=, \
                     seed=";

impl Settings {
    /// A healthy `bench` actuator, number 0, without noise and load, one mixed actuation.
    #[must_use]
    pub fn new(id: ActuatorId, seed: u64) -> Self {
        Self {
            actuator: ActuatorKind::Bench,
            id,
            k: FaultVector::NOMINAL,
            growth: [0.0; FAULT_COUNT],
            effects: EffectSettings::default(),
            profile: Profile::Mixed,
            speed_mode: false,
            windows: 1,
            rate_hz: None,
            noise_a: 0.0,
            load_nm: 0.0,
            seed,
        }
    }

    /// The settings changed by `name=value` words, in any order and separated by blanks.
    ///
    /// ```
    /// use ema_wire::ActuatorId;
    /// use firmware_sim::{BadSetting, Settings};
    /// let settings = Settings::new(ActuatorId::new(0).expect("0 to 15"), 1);
    /// let changed = settings.with_text("k=0.4,0,0,0,0,0,0.5,0.5 profile=ramp rate=400 seed=7")?;
    /// assert_eq!((changed.k.friction, changed.rate_hz, changed.seed), (0.4, Some(400.0), 7));
    /// let real = settings.with_text("drive=vector with=dead_time_s=1e-6 with=cogging_nm=0.05 mode=speed")?;
    /// assert_eq!(real.plan()?.scenario.effects.vector_drive().map(|drive| drive.dead_time), Some(1e-6));
    /// assert_eq!(settings.with_text("k=1"), Err(BadSetting("k")));
    /// # Ok::<(), BadSetting>(())
    /// ```
    ///
    /// # Errors
    /// [`BadSetting`] for the first word that is not a setting or whose value cannot be parsed.
    pub fn with_text(mut self, text: &str) -> Result<Self, BadSetting> {
        for word in text.split_ascii_whitespace() {
            let (name, value) = word.split_once('=').ok_or(BadSetting(""))?;
            match name {
                "actuator" => self.actuator = valid("actuator", ActuatorKind::from_name(value))?,
                "id" => self.id = valid("id", parse(value).and_then(ActuatorId::new))?,
                "k" => self.k = valid("k", parse_fault_vector(value).map(FaultVector::from_array))?,
                "growth" => self.growth = valid("growth", parse_fault_vector(value))?,
                "with" => valid("with", set_effect(&mut self.effects, value))?,
                "drive" => self.effects.drive = Some(valid("drive", Drive::from_name(value))?),
                "profile" => self.profile = valid("profile", profile_by_name(value))?,
                "mode" => self.speed_mode = valid("mode", is_speed_mode(value))?,
                "windows" => self.windows = valid("windows", parse(value))?,
                "rate" => self.rate_hz = Some(valid("rate", parse(value))?),
                "noise" => self.noise_a = valid("noise", parse(value))?,
                "load" => self.load_nm = valid("load", parse(value))?,
                "seed" => self.seed = valid("seed", parse(value))?,
                _ => return Err(BadSetting("")),
            }
        }
        Ok(self)
    }

    /// The plan of a device with these settings.
    ///
    /// # Errors
    /// [`BadSetting`] for the first value out of range.
    pub fn plan(&self) -> Result<Plan, BadSetting> {
        let mut params = match self.actuator {
            ActuatorKind::Bench => ActuatorParams::bench(),
            ActuatorKind::Servo28 => ActuatorParams::servo28(),
            ActuatorKind::Servo270 => ActuatorParams::servo270(),
        };
        if let Some(rate_hz) = self.rate_hz {
            params.sensors.sample_rate = rate_hz;
            params = params.checked().map_err(|_| BadSetting("rate"))?;
        }
        let in_range = [
            ("k", self.k.is_valid()),
            ("growth", self.growth.iter().all(|x| x.is_finite())),
            ("windows", self.windows > 0),
            ("noise", self.noise_a >= 0.0 && self.noise_a.is_finite()),
            ("load", self.load_nm.is_finite()),
        ];
        if let Some((name, _)) = in_range.iter().find(|(_, good)| !good) {
            return Err(BadSetting(name));
        }
        let profile = if self.speed_mode {
            self.profile.in_speed_mode().ok_or(BadSetting("profile"))?
        } else {
            self.profile
        };
        let scenario = Scenario {
            load_torque: self.load_nm,
            effects: self
                .effects
                .effects_on(Drive::of_built_in(self.actuator.name()))
                .map_err(|_| BadSetting("with"))?,
            sensing: CurrentSensing {
                quantised: self.noise_a > 0.0,
                noise_rms: self.noise_a,
            },
            actuations: Actuations {
                profile,
                count: self.windows,
                rest: REST_S,
                length: LENGTH_S,
            },
            ..Scenario::new(params, self.k, self.seed)
        };
        Ok(Plan {
            growth: self.growth,
            ..Plan::new(self.id, scenario)
        })
    }
}

impl ActuatorKind {
    /// The type with this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "bench" => Some(Self::Bench),
            "servo28" => Some(Self::Servo28),
            "servo270" => Some(Self::Servo270),
            _ => None,
        }
    }

    /// The name of the type.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Bench => "bench",
            Self::Servo28 => "servo28",
            Self::Servo270 => "servo270",
        }
    }
}

fn valid<T>(name: &'static str, value: Option<T>) -> Result<T, BadSetting> {
    value.ok_or(BadSetting(name))
}

fn parse<T: FromStr>(text: &str) -> Option<T> {
    text.parse().ok()
}

fn profile_by_name(name: &str) -> Option<Profile> {
    let found = Profile::NAMES.into_iter().find(|(known, _)| *known == name);
    found.map(|(_, profile)| profile)
}

fn is_speed_mode(name: &str) -> Option<bool> {
    match name {
        "position" => Some(false),
        "speed" => Some(true),
        _ => None,
    }
}

/// Sets an effect from `name=value`.
fn set_effect(effects: &mut EffectSettings, text: &str) -> Option<()> {
    let (name, value) = text.split_once('=')?;
    effects.set(name, parse(value)?).ok()
}

/// Numbers in fault-vector order, separated by commas.
fn parse_fault_vector(text: &str) -> Option<[f64; FAULT_COUNT]> {
    let mut words = text.split(',');
    let mut numbers = [0.0; FAULT_COUNT];
    for number in &mut numbers {
        *number = parse(words.next()?)?;
    }
    words.next().is_none().then_some(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> Settings {
        Settings::new(ActuatorId::new(0).expect("0 to 15"), 1)
    }

    #[test]
    fn text_can_change_every_setting() {
        let text = "actuator=servo28 id=3 k=0.1,0,0,0,0,0,0.5,0.5 growth=0,0.1,0,0,0,0,0,0 \
                    with=cogging_nm=0.1 with=decoupling=0.5 drive=vector profile=chirp mode=speed windows=9 rate=500 \
                    noise=0.05 load=-2 seed=18446744073709551615";
        let mut effects = EffectSettings::with_drive(Drive::from_name("vector"));
        effects.set("cogging_nm", 0.1).expect("within its limits");
        effects.set("decoupling", 0.5).expect("within its limits");
        let changed = settings().with_text(text).expect("every setting is valid");
        let expected = Settings {
            actuator: ActuatorKind::Servo28,
            id: ActuatorId::new(3).expect("0 to 15"),
            k: FaultVector {
                friction: 0.1,
                ..FaultVector::NOMINAL
            },
            growth: [0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            effects,
            profile: Profile::Chirp,
            speed_mode: true,
            windows: 9,
            rate_hz: Some(500.0),
            noise_a: 0.05,
            load_nm: -2.0,
            seed: u64::MAX,
        };
        assert_eq!(changed, expected);
        let actuations = changed.plan().expect("every setting is valid").scenario.actuations;
        assert_eq!(actuations.profile, Profile::SpeedChirp);
    }

    #[test]
    fn the_error_names_the_invalid_setting() {
        let wrong = [
            ("k=0,0,0,0,0,0,0.5,0.5,0", "k"),
            ("k=0,0,0,0,0,0,0.5,2", "k"),
            ("id=16", "id"),
            ("profile=sine", "profile"),
            ("windows=0", "windows"),
            ("mode=idle", "mode"),
            ("drive=stepper", "drive"),
            ("with=coging_nm=0.1", "with"),
            ("with=cogging_nm=-1", "with"),
            ("with=cogging_nm", "with"),
            ("with=decoupling=0.5", "with"),
            ("noise=nan", "noise"),
            ("rate=3", "rate"),
            ("growth=inf,0,0,0,0,0,0,0", "growth"),
            ("colour=red", ""),
            ("seed", ""),
        ];
        for (text, name) in wrong {
            let plan = settings().with_text(text).and_then(|changed| changed.plan());
            assert_eq!(plan.err(), Some(BadSetting(name)), "{text}");
        }
    }
}
