//! One simulated unit of the suite, and windows of it as the pipeline cuts them from frames with a mistake in them.

use std::sync::Arc;

use ema_models::reference::{Actuations, CurrentSensing, Drive, Effects, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile, SensedSample};
use ema_wire::can::Status;
use ema_wire::quantity;
use hmd_core::config::{Config, ConfigError};
use hmd_core::frame::BusNames;
use hmd_core::outbox::WindowJob;
use hmd_core::pipeline::Pipeline;
use hmd_core::seed::mix;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::SensorsError;
use super::mistakes::{Configured, Drawn};
use crate::simulate::{EPOCH_NS, Traffic, status_of};

/// Current noise of each phase, A rms for `bench`, beside the converters of the type.
pub(super) const NOISE_RMS_A: f64 = 0.03;

/// Rest before and after the actuation of a window, s.
const REST_S: f64 = 0.06;

/// Load at the output, in multiples of the dynamic friction torque there.
const LOAD: std::ops::Range<f64> = 0.5..1.5;

/// Interface that the frames are on.
const INTERFACE: &str = "can0";

/// Name of the calibration of the unit; no file is written.
pub(super) const UNIT_FILE: &str = "unit.toml";

/// What a window is recorded with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Circumstances {
    pub(super) profile: Profile,
    pub(super) rate_hz: u32,
    pub(super) drive: &'static str,
}

const PROFILES: [Profile; 4] = [Profile::Mixed, Profile::Step, Profile::Ramp, Profile::Chirp];
const RATES_HZ: [u32; 2] = [2000, 400];
const DRIVES: [&str; 2] = ["hysteresis", "vector"];

/// Windows of a unit, one of each profile.
pub(super) const SERIES: u64 = PROFILES.len() as u64;

/// Number of combinations of rate and drive.
pub(super) const COMBINATIONS: u64 = (RATES_HZ.len() * DRIVES.len()) as u64;

impl Circumstances {
    /// Those of a window of the series of a unit; the unit has the combination of a number, counted around.
    pub(super) fn of(unit: u64, window: u64) -> Self {
        let place = |number: u64, length: usize| (number % length as u64) as usize;
        Self {
            profile: PROFILES[place(window, PROFILES.len())],
            rate_hz: RATES_HZ[place(unit, RATES_HZ.len())],
            drive: DRIVES[place(unit / RATES_HZ.len() as u64, DRIVES.len())],
        }
    }
}

/// The profile of a commissioning window.
pub(super) fn commissioning_profile(number: u64) -> Profile {
    PROFILES[(number % 4) as usize]
}

/// All units of a type: rate and drive.
pub(super) fn units() -> impl Iterator<Item = (u32, &'static str)> {
    RATES_HZ
        .into_iter()
        .flat_map(|rate_hz| DRIVES.into_iter().map(move |drive| (rate_hz, drive)))
}

/// One unit, known to be of its type.
#[derive(Clone, Debug)]
pub(super) struct Unit {
    pub(super) actuator: String,
    pub(super) nominal: ActuatorParams,
    pub(super) drive: &'static str,
}

/// What was recorded of a motion.
pub(super) struct Recorded {
    /// The first window, if one was cut.
    pub(super) job: Option<WindowJob>,
    /// The samples of the whole motion.
    pub(super) samples: Vec<SensedSample>,
    /// What the pipeline reported.
    pub(super) notices: Vec<String>,
}

impl Unit {
    /// A unit of a built-in type at a rate, with a drive; `None` for an unknown type.
    pub(super) fn new(actuator: &str, rate_hz: u32, drive: &'static str) -> Option<Self> {
        let mut nominal = ActuatorParams::built_in(actuator)?;
        nominal.sensors.sample_rate = f64::from(rate_hz);
        Some(Self {
            actuator: actuator.to_owned(),
            nominal,
            drive,
        })
    }

    /// The configuration as it is written, with the mistake in it.
    ///
    /// # Errors
    /// It is refused.
    pub(super) fn config(&self, mistake: &Drawn) -> Result<Config, ConfigError> {
        let real = Configured {
            pole_pairs: self.nominal.motor.pole_pairs,
            gear_ratio: self.nominal.transmission.gear_ratio,
        };
        let Configured { pole_pairs, gear_ratio } = mistake.configured(real);
        let (actuator, drive, rate_hz) = (&self.actuator, self.drive, self.nominal.sensors.sample_rate);
        Config::from_toml_str(
            &format!(
                "[[actuator]]\nid = 0\ntype = \"{actuator}\"\ncalibration = \"{UNIT_FILE}\"\n\
                 [type.{actuator}]\nmotor.pole_pairs = {pole_pairs}\ntransmission.gear_ratio = {gear_ratio}\n\
                 sensors.sample_rate_hz = {rate_hz:?}\ndrive.kind = \"{drive}\""
            ),
            "sensors.toml",
        )
    }

    /// Records one motion; the seeds are those of the unit and of the window.
    ///
    /// # Errors
    /// An interface name that is refused.
    pub(super) fn recorded(
        &self,
        config: &Arc<Config>,
        profile: Profile,
        fault: FaultVector,
        mistake: &Drawn,
        [unit, seed]: [u64; 2],
    ) -> Result<Recorded, SensorsError> {
        let scenario = self.scenario(profile, fault, mistake, seed);
        let motor = &self.nominal.motor;
        let samples: Vec<SensedSample> = scenario.run().collect();
        let rate_hz = self.nominal.sensors.sample_rate;
        let samples = mistake.recorded(samples, motor.pole_pairs, rate_hz, REST_S, motor.i_max);
        let other_load = quantity::load_torque_dnm(self.load(mix(unit, &[4])));
        let status: Status = mistake.reported(status_of(&scenario), quantity::dc_link_dv(motor.v_dc), other_load);

        let mut names = BusNames::new();
        names.intern(INTERFACE)?;
        let mut pipeline = Pipeline::new(config.clone());
        for frame in Traffic::of_samples(
            samples.iter().copied(),
            rate_hz,
            config.actuators()[0].id,
            EPOCH_NS,
            status,
        ) {
            pipeline.push(&frame, &names);
        }
        pipeline.finish();
        Ok(Recorded {
            job: pipeline.take_windows().into_iter().next(),
            samples,
            notices: pipeline
                .take_notices()
                .into_iter()
                .map(|notice| notice.message)
                .collect(),
        })
    }

    fn scenario(&self, profile: Profile, fault: FaultVector, mistake: &Drawn, seed: u64) -> Scenario {
        let mut unit = self.nominal;
        unit.motor.v_dc *= mistake.supply_share();
        Scenario {
            unit,
            load_torque: self.load(seed),
            effects: Effects {
                drive: Drive::from_name(self.drive).unwrap_or_default(),
                ..Effects::default()
            },
            sensing: CurrentSensing {
                quantised: true,
                noise_rms: NOISE_RMS_A,
            },
            actuations: Actuations {
                rest: REST_S,
                ..Actuations::single(profile)
            },
            ..Scenario::new(self.nominal, fault, seed)
        }
    }

    /// Load at the output, Nm.
    pub(super) fn load(&self, seed: u64) -> f64 {
        let mut rng = ChaCha8Rng::seed_from_u64(mix(seed, &[3]));
        let transmission = &self.nominal.transmission;
        let size = rng.random_range(LOAD) * transmission.friction_dynamic * transmission.gear_ratio;
        if rng.random_bool(0.5) { size } else { -size }
    }
}
