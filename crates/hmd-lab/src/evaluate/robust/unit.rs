//! One simulated unit of an entry, and windows of it as the pipeline cuts them from its frames.

use std::sync::Arc;

use ema_models::reference::{Actuations, CurrentSensing, Drive, EFFECTS, EffectError, EffectInfo, Effects, Scenario};
use ema_models::{ActuatorParams, DriveParams, FaultVector, Profile};
use hmd_core::config::Config;
use hmd_core::frame::BusNames;
use hmd_core::outbox::WindowJob;
use hmd_core::pipeline::Pipeline;
use hmd_core::seed::{mix, name_hash};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::RobustError;
use super::entries::{Entry, Size};
use crate::simulate::{EPOCH_NS, traffic};

/// Current noise of each phase, A rms, beside the converters of the type.
const NOISE_RMS_A: f64 = 0.03;

/// Rest before and after the actuation of a window, s.
const REST_S: f64 = 0.06;

/// Damage of a faulty window.
const DAMAGE: std::ops::Range<f64> = 0.15..0.4;

/// Interface that the frames are on.
const INTERFACE: &str = "can0";

/// Name of the calibration of the unit; no file is written.
pub(super) const UNIT_FILE: &str = "unit.toml";

/// Places of the fault vector with the sign in which each grows worse; the controller gain drifts both ways.
const DIRECTIONS: [(usize, f64); 8] = [
    (0, 1.0),
    (1, 1.0),
    (2, 1.0),
    (3, 1.0),
    (4, 1.0),
    (5, 1.0),
    (7, 0.5),
    (7, -0.5),
];

/// Effects of the unit of an entry. They depend on the seed, the entry's name and the type; between types, on the same random
/// numbers.
///
/// # Errors
/// An effect that the reference does not know.
pub(super) fn draw_effects(
    entry: &Entry,
    params: &ActuatorParams,
    drive: &DriveParams,
    seed: u64,
) -> Result<Effects, EffectError> {
    let mut effects = Effects {
        drive: Drive::of_type(drive),
        ..Effects::default()
    };
    let mut done: Vec<&str> = Vec::new();
    for imperfection in &entry.imperfections {
        let parts = [name_hash(&entry.name), name_hash(imperfection.name)];
        let mut rng = ChaCha8Rng::seed_from_u64(mix(seed, &parts));
        for (name, size) in imperfection.values {
            let share = rng.random_range(0.0..1.0);
            if done.contains(name) {
                continue;
            }
            done.push(name);
            let info = EFFECTS.iter().find(|info| info.name == *name);
            let value = info.map_or(f64::NAN, |info| value(info, *size, params, share));
            effects.set(name, value)?;
        }
    }
    Ok(effects)
}

/// Value of an effect by its law, for a uniform random number in [0, 1).
fn value(info: &EffectInfo, size: Size, params: &ActuatorParams, share: f64) -> f64 {
    let usual = info.usual_on(params);
    let between = |low: f64, high: f64| low + share * (high - low);
    let value = match size {
        Size::Tolerance(sigma) => {
            let side = 2.0 * share - 1.0;
            sigma * usual.1 / info.usual.1 * (side + 0.5_f64.copysign(side))
        }
        Size::Usual => between(usual.0, usual.1),
        Size::Between(low, high) => between(low, high),
        Size::Exactly(value) => value,
    };
    let value = if info.whole { value.round() } else { value };
    value.clamp(info.limits.0, info.limits.1)
}

/// A single fault of damage 0.15 to 0.4: the place of the damaged element, and the vector. `n` counts through the directions.
pub(in crate::evaluate) fn single_fault(n: u64, seed: u64) -> (usize, FaultVector) {
    let mut rng = ChaCha8Rng::seed_from_u64(mix(seed, &[1]));
    let damage = rng.random_range(DAMAGE);
    let phase = rng.random_range(0.0..1.0);
    let mut k = FaultVector::NOMINAL.to_array();
    let (place, sign) = DIRECTIONS[(n % DIRECTIONS.len() as u64) as usize];
    k[place] += sign * damage;
    if place == 5 {
        k[6] = phase;
    }
    (place, FaultVector::from_array(k))
}

/// The configuration of an actuator of this type, number 0.
///
/// # Errors
/// A rate that the type's control period does not allow.
pub(super) fn config_of(type_name: &str, rate_hz: f64) -> Result<Config, hmd_core::config::ConfigError> {
    Config::from_toml_str(
        &format!(
            "[[actuator]]\nid = 0\ntype = \"{type_name}\"\ncalibration = \"{UNIT_FILE}\"\n\
             [type.{type_name}.sensors]\nsample_rate_hz = {rate_hz:?}"
        ),
        "robust.toml",
    )
}

/// Motions that the calibration of a unit has not seen.
pub(super) const OTHER_PROFILES: [Profile; 4] = [Profile::Step, Profile::Ramp, Profile::Chirp, Profile::Speed];

/// One actuation of a unit with these effects.
pub(super) fn scenario(
    nominal: ActuatorParams,
    effects: Effects,
    profile: Profile,
    fault: FaultVector,
    seed: u64,
) -> Scenario {
    Scenario {
        effects,
        sensing: CurrentSensing {
            quantised: true,
            noise_rms: NOISE_RMS_A,
        },
        actuations: Actuations {
            rest: REST_S,
            ..Actuations::single(profile)
        },
        ..Scenario::new(nominal, fault, seed)
    }
}

/// One unit of a type.
#[derive(Clone, Debug)]
pub(super) struct Unit {
    /// What the monitor knows.
    pub(super) config: Arc<Config>,
    nominal: ActuatorParams,
    effects: Effects,
}

impl Unit {
    /// A unit with these effects of the type that `config` names.
    pub(super) fn new(config: Arc<Config>, effects: Effects) -> Self {
        let nominal = config.actuators()[0].params;
        Self {
            config,
            nominal,
            effects,
        }
    }

    /// What [`FinishedUnit`](super::FinishedUnit) keeps of it.
    pub(super) fn drawn(&self) -> String {
        super::state::drawn(&self.effects, &self.nominal)
    }

    /// The window of one actuation; `None` where none is cut from the frames. The load is not measured.
    ///
    /// # Errors
    /// An interface name that is refused.
    pub(super) fn window(
        &self,
        profile: Profile,
        fault: FaultVector,
        seed: u64,
    ) -> Result<Option<WindowJob>, RobustError> {
        let scenario = scenario(self.nominal, self.effects, profile, fault, seed);
        let mut names = BusNames::new();
        names.intern(INTERFACE)?;
        let mut pipeline = Pipeline::new(self.config.clone());
        for frame in traffic(&scenario, self.config.actuators()[0].id, EPOCH_NS) {
            pipeline.push(&frame, &names);
        }
        pipeline.finish();
        let mut job = pipeline.take_windows().into_iter().next();
        if let Some(job) = &mut job {
            job.conditions.load_torque_nm = None;
        }
        Ok(job)
    }
}

#[cfg(test)]
mod tests {
    use super::super::entries::ENTRIES;
    use super::*;

    #[test]
    fn a_unit_depends_on_the_seed_and_the_name_of_its_entry_alone() {
        let params = ActuatorParams::bench();
        for entry in ENTRIES.iter() {
            let drawn = |entry: &Entry, seed| draw_effects(entry, &params, &DriveParams::default(), seed).unwrap();
            let effects = drawn(entry, 1);
            assert_eq!(effects, drawn(entry, 1), "{}", entry.name);
            assert!(!effects.are_off(), "{}", entry.name);
            let renamed = Entry {
                name: "other".to_owned(),
                ..entry.clone()
            };
            let constant = entry.imperfections.iter().flat_map(|i| i.values);
            if constant.clone().any(|(_, size)| !matches!(size, Size::Exactly(_))) {
                assert_ne!(effects, drawn(entry, 2), "{}", entry.name);
                assert_ne!(effects, drawn(&renamed, 1), "{}", entry.name);
            }
        }
    }

    #[test]
    fn sizes_lie_within_the_limits_on_every_built_in_type() {
        for name in ActuatorParams::BUILT_IN {
            let params = ActuatorParams::built_in(name).unwrap();
            for entry in ENTRIES.iter() {
                for seed in 0..20 {
                    assert!(
                        draw_effects(entry, &params, &DriveParams::of_built_in(name), seed).is_ok(),
                        "{name}, {}",
                        entry.name
                    );
                }
            }
        }
    }

    #[test]
    fn a_tolerance_is_a_standard_deviation() {
        let info = EFFECTS.iter().find(|info| info.name == "resistance_deviation").unwrap();
        let (mut squares, n) = (0.0, 1000);
        for k in 0..n {
            let share = (f64::from(k) + 0.5) / f64::from(n);
            let drawn = value(info, Size::Tolerance(0.05), &ActuatorParams::bench(), share);
            assert!((0.025..=0.075).contains(&drawn.abs()));
            squares += drawn * drawn;
        }
        let deviation = (squares / f64::from(n)).sqrt();
        // √(1 + 1/12) of it.
        assert!((deviation / 0.05 - 1.04).abs() < 0.01, "{deviation}");
    }

    #[test]
    fn faults_cover_all_directions() {
        let mut places: Vec<usize> = (0..8).map(|n| single_fault(n, n).0).collect();
        places.dedup();
        assert_eq!(places, [0, 1, 2, 3, 4, 5, 7]);
        for n in 0..24 {
            let (place, fault) = single_fault(n, n);
            let damage = fault.damage()[place];
            assert!(DAMAGE.contains(&damage), "{damage}");
            assert!((fault.damages().iter().sum::<f64>() - damage).abs() < 1e-12);
        }
    }
}
