//! The suites `profiles` and `conditions`: every kind of command, of which most show less than the mixed one, and windows
//! of cold and hot motors on high and low supply; and the assessments of them.

use ema_ga::ConfigError;
use ema_models::{FAULT_COUNT, FaultId, FaultVector, MotorKnowledge, Profile, wrapped_phase_difference};
use rayon::prelude::*;
use serde::Serialize;

use super::motors::{Motor, Surroundings};
use super::noise::{NOISE_RATES_HZ, covered};
use super::percentile;
use crate::calibrate_type::random_faults;
use crate::simulated::SimulatedWindow;
use ema_identify::{Estimate, Identifier};
use hmd_core::assess::{damage_evidence, motor_knowledge_at};
use hmd_core::health::{Health, HealthState, Levels, LevelsError};
use hmd_core::seed::mix;

/// Commands of the `profiles` suite; each service command is drawn with its window.
const PROFILES: [(&str, Profile); 6] = [
    ("step", Profile::Step),
    ("ramp", Profile::Ramp),
    ("chirp", Profile::Chirp),
    ("mixed", Profile::Mixed),
    ("speed", Profile::Speed),
    ("service", Profile::Service(0)),
];

/// Circumstances of the `conditions` suite: winding temperature in °C, whether it is measured, and supply.
const CONDITIONS: [(&str, f64, bool, f64); 7] = [
    ("-40 °C", -40.0, true, 1.0),
    ("20 °C", 20.0, true, 1.0),
    ("120 °C", 120.0, true, 1.0),
    ("-40 °C, not measured", -40.0, false, 1.0),
    ("120 °C, not measured", 120.0, false, 1.0),
    ("supply -10 %", 20.0, true, 0.9),
    ("supply +10 %", 20.0, true, 1.1),
];

/// Rows of `profiles`: each command, without and with noise, at both rates.
pub const PROFILE_ROWS: u64 = 2 * (PROFILES.len() * NOISE_RATES_HZ.len()) as u64;

/// Rows of `conditions`: each at both rates.
pub const CONDITION_ROWS: u64 = (CONDITIONS.len() * NOISE_RATES_HZ.len()) as u64;

/// Result of `hmd evaluate profiles` and of `hmd evaluate conditions`.
#[derive(Clone, Debug, Serialize)]
pub struct ProfilesReport {
    /// Name of the suite.
    pub suite: &'static str,
    /// The actuator.
    pub actuator: String,
    /// Suite seed.
    pub seed: u64,
    /// Healthy windows of each row, and as many of the `random` suite's vectors.
    pub windows: u64,
    /// Results by what the windows were taken under.
    pub rows: Vec<ProfileRow>,
}

/// Windows of one kind.
#[derive(Clone, Debug, Serialize)]
pub struct ProfileRow {
    /// Name of the command or of the circumstances.
    pub name: &'static str,
    /// Whether sensors, load and motor are those of the `noise` suite.
    pub noise: bool,
    /// Sample rate, Hz.
    pub sample_rate_hz: f64,
    /// Median of `rss_pct` over the observable components of the faulty windows.
    pub median_rss_pct: f64,
    /// 95th percentile.
    pub p95_rss_pct: f64,
    /// Share of the sigmas stated in faulty windows whose 95 % interval holds the truth.
    pub coverage_95: f64,
    /// The same for each component of the fault vector.
    pub coverage_95_by_component: [Option<f64>; FAULT_COUNT],
    /// The same in healthy windows.
    pub healthy_coverage_95: f64,
    /// Share of the faulty windows that show each component.
    pub observable: [f64; FAULT_COUNT],
    /// Healthy windows in which a fault is named.
    pub false_faults: u64,
    /// Healthy and faulty windows that are called unmodelled.
    pub unmodelled: u64,
    /// Healthy and faulty windows that are called ambiguous.
    pub ambiguous: u64,
    /// Largest cost of both: how near good windows come to being unmodelled.
    pub max_cost: f64,
}

/// Why the suite could not run.
#[derive(Debug, thiserror::Error)]
pub enum ProfilesError {
    /// Settings of the search.
    #[error(transparent)]
    Search(#[from] ConfigError),
    /// Levels of health.
    #[error(transparent)]
    Levels(#[from] LevelsError),
}

/// What came of one window.
struct Outcome {
    rss_pct: f64,
    covered: [Option<bool>; FAULT_COUNT],
    observable: [bool; FAULT_COUNT],
    named: bool,
    unmodelled: bool,
    ambiguous: bool,
    cost: f64,
}

/// What windows are taken under.
#[derive(Clone, Copy, Debug)]
struct Kind {
    name: &'static str,
    around: Surroundings,
    noise: bool,
    rate: f64,
}

/// The `profiles` suite: `n` faulty and `n` healthy windows of every command, without noise (the unit is its type, the load
/// is measured) and with that of the `noise` suite, at both rates.
///
/// # Errors
/// Settings that contradict each other.
pub fn profiles(
    identifier: &Identifier,
    levels: [Levels; FaultId::COUNT],
    actuator: &str,
    n: u64,
    seed: u64,
    done: &(dyn Fn() + Sync),
) -> Result<ProfilesReport, ProfilesError> {
    let kinds = PROFILES.into_iter().flat_map(|(name, profile)| {
        let around = Surroundings {
            profile,
            ..Surroundings::USUAL
        };
        [false, true].into_iter().flat_map(move |noise| {
            NOISE_RATES_HZ.map(|rate| Kind {
                name,
                around,
                noise,
                rate,
            })
        })
    });
    report(identifier, levels, "profiles", actuator, n, seed, kinds.collect(), done)
}

/// The `conditions` suite: `n` faulty and `n` healthy mixed windows under the noise of the `noise` suite, of motors that are
/// colder or warmer, or on more or less supply, than where they were learnt.
///
/// # Errors
/// Settings that contradict each other.
pub fn conditions(
    identifier: &Identifier,
    levels: [Levels; FaultId::COUNT],
    actuator: &str,
    n: u64,
    seed: u64,
    done: &(dyn Fn() + Sync),
) -> Result<ProfilesReport, ProfilesError> {
    let kinds = CONDITIONS
        .into_iter()
        .flat_map(|(name, winding_temp_deg_c, temperature_measured, supply)| {
            NOISE_RATES_HZ.map(|rate| Kind {
                name,
                around: Surroundings {
                    winding_temp_deg_c,
                    temperature_measured,
                    supply,
                    ..Surroundings::USUAL
                },
                noise: true,
                rate,
            })
        });
    report(
        identifier,
        levels,
        "conditions",
        actuator,
        n,
        seed,
        kinds.collect(),
        done,
    )
}

#[expect(
    clippy::too_many_arguments,
    reason = "what both suites are given, and what tells them apart"
)]
fn report(
    identifier: &Identifier,
    levels: [Levels; FaultId::COUNT],
    suite: &'static str,
    actuator: &str,
    n: u64,
    seed: u64,
    kinds: Vec<Kind>,
    done: &(dyn Fn() + Sync),
) -> Result<ProfilesReport, ProfilesError> {
    let mut rows = Vec::new();
    for (place, kind) in kinds.into_iter().enumerate() {
        let outcomes: Vec<[Outcome; 2]> = (0..n)
            .into_par_iter()
            .map(|n| {
                let pair = Pair::new(identifier, &kind, mix(seed, &[3, n]), mix(seed, &[11, place as u64, n]));
                let outcomes = [pair.outcome(0, levels)?, pair.outcome(1, levels)?];
                done();
                Ok(outcomes)
            })
            .collect::<Result<_, ProfilesError>>()?;
        rows.push(row(&kind, &outcomes));
    }
    Ok(ProfilesReport {
        suite,
        actuator: actuator.to_owned(),
        seed,
        windows: n,
        rows,
    })
}

fn drawn(profile: Profile, seed: u64) -> Profile {
    match profile {
        Profile::Service(_) => Profile::Service(mix(seed, &[1])),
        other => other,
    }
}

/// A faulty and a healthy window of one motor, with what is known of it.
struct Pair {
    identifier: Identifier,
    windows: [SimulatedWindow; 2],
    seed: u64,
}

impl Pair {
    fn new(of_type: &Identifier, kind: &Kind, vector: u64, seed: u64) -> Self {
        let faults = [random_faults(vector), FaultVector::NOMINAL];
        let seeds = [mix(seed, &[2]), mix(seed, &[3])];
        let around = Surroundings {
            profile: drawn(kind.around.profile, seed),
            ..kind.around
        };
        if kind.noise {
            let motor = Motor::draw(&of_type.params, kind.rate, seed);
            let mut identifier = motor.calibrated(of_type);
            if !around.temperature_measured {
                identifier.motor = motor_knowledge_at(identifier.motor, None);
            }
            return Self {
                identifier,
                windows: [0, 1].map(|n| motor.actuation(&around, faults[n], seeds[n])),
                seed,
            };
        }
        let mut identifier = Identifier {
            motor: MotorKnowledge::default(),
            ..of_type.clone()
        };
        identifier.params.sensors.sample_rate = kind.rate;
        Self {
            windows: [0, 1].map(|n| SimulatedWindow::new(&identifier.params, faults[n], around.profile, seeds[n])),
            identifier,
            seed,
        }
    }

    fn outcome(&self, which: usize, levels: [Levels; FaultId::COUNT]) -> Result<Outcome, ProfilesError> {
        let window = &self.windows[which];
        let estimate = self
            .identifier
            .identify(&window.prepared, window.conditions, self.seed)?;
        let explained = (!estimate.is_unmodelled()).then(|| damage_evidence(&estimate));
        let decision = Health::new(levels.map(Levels::at_once))?.update(0, explained.as_ref());
        Ok(Outcome {
            rss_pct: observable_rss_pct(&estimate, &window.truth),
            covered: covered(&estimate, &window.truth),
            observable: estimate.observable,
            named: decision.state > HealthState::Nominal && !decision.faults.is_empty(),
            unmodelled: estimate.is_unmodelled(),
            ambiguous: estimate.competing_optimum.is_some(),
            cost: estimate.cost,
        })
    }
}

/// Root sum of squares of the errors of what the window shows, percent; the direction counts by the amplitude.
fn observable_rss_pct(estimate: &Estimate, truth: &FaultVector) -> f64 {
    let (k, t) = (estimate.fault.to_array(), truth.to_array());
    let square = |p: usize| match p {
        6 => t[5] * wrapped_phase_difference(k[6], t[6]).powi(2),
        _ => (k[p] - t[p]).powi(2),
    };
    let sum: f64 = (0..FAULT_COUNT).filter(|&p| estimate.observable[p]).map(square).sum();
    100.0 * sum.sqrt()
}

fn row(kind: &Kind, outcomes: &[[Outcome; 2]]) -> ProfileRow {
    let share = |held: &mut dyn Iterator<Item = bool>| {
        let (mut count, mut good) = (0_u64, 0_u64);
        for held in held {
            count += 1;
            good += u64::from(held);
        }
        (count > 0).then(|| good as f64 / count as f64)
    };
    let stated = |which: usize| {
        outcomes
            .iter()
            .flat_map(move |pair| pair[which].covered.iter().flatten().copied())
    };
    // A window that shows nothing has no error; it counts in `observable`.
    let shows = |outcome: &Outcome| outcome.observable.iter().any(|seen| *seen);
    let rss = || {
        outcomes
            .iter()
            .filter(|[faulty, _]| shows(faulty))
            .map(|[faulty, _]| faulty.rss_pct)
    };
    ProfileRow {
        name: kind.name,
        noise: kind.noise,
        sample_rate_hz: kind.rate,
        median_rss_pct: percentile(rss(), 0.5),
        p95_rss_pct: percentile(rss(), 0.95),
        coverage_95: share(&mut stated(0)).unwrap_or(0.0),
        coverage_95_by_component: std::array::from_fn(|p| {
            share(&mut outcomes.iter().filter_map(|[faulty, _]| faulty.covered[p]))
        }),
        healthy_coverage_95: share(&mut stated(1)).unwrap_or(0.0),
        observable: std::array::from_fn(|p| {
            share(&mut outcomes.iter().map(|[faulty, _]| faulty.observable[p])).unwrap_or(0.0)
        }),
        false_faults: outcomes.iter().filter(|[_, healthy]| healthy.named).count() as u64,
        unmodelled: outcomes.iter().flatten().filter(|outcome| outcome.unmodelled).count() as u64,
        ambiguous: outcomes.iter().flatten().filter(|outcome| outcome.ambiguous).count() as u64,
        max_cost: outcomes
            .iter()
            .flatten()
            .map(|outcome| outcome.cost)
            .fold(0.0, f64::max),
    }
}
