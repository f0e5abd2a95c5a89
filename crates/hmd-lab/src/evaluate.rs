//! Accuracy suites: identification against the reference model, on vectors and seeds that no calibration uses.

mod detection;
mod estimator;
mod matched;
mod motors;
mod noise;
mod profiles;
pub mod robust;
mod rul;
pub mod sensors;
pub mod tables;

use ema_ga::ConfigError;
use ema_models::{FAULT_COUNT, FaultVector, Profile, eq15_pct, rss_pct};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::Serialize;

use crate::calibrate_type::random_faults;
use crate::simulated::SimulatedWindow;
use ema_identify::Estimate;
use hmd_core::seed::mix;

pub use detection::{ByFault, DetectionError, DetectionReport, Wrong, detection};
pub use estimator::Estimator;
pub use noise::{NOISE_RATES_HZ, NoiseAtRate, NoiseReport, noise};
pub use profiles::{CONDITION_ROWS, PROFILE_ROWS, ProfileRow, ProfilesError, ProfilesReport, conditions, profiles};
pub use rul::{
    AtLambda, Comparison, ComparisonError, Group as RulGroup, Growth, History, RemainingHoursSamples, RulReport,
    Scored, Scores, Seen, compare_forecasts, rul, rul_histories,
};

/// Random vector of the paper's Table III.
pub const TABLE_III: [f64; FAULT_COUNT] = [0.2383, 0.5003, 5.32e-7, 0.4503, 0.0404, 0.0028, 0.2785, 0.5];

/// Seeds of each case of the `paper` suite.
const PAPER_SEEDS: u64 = 10;

/// One identified window beside its truth.
#[derive(Clone, Debug, Serialize)]
pub struct Case {
    /// What is wrong with the actuator.
    pub name: String,
    /// Seed of the simulated window.
    pub seed: u64,
    /// True fault vector.
    pub truth: [f64; FAULT_COUNT],
    /// Estimated fault vector.
    pub k: [f64; FAULT_COUNT],
    /// Its standard deviations; `None` where the window shows nothing.
    pub sigma: [Option<f64>; FAULT_COUNT],
    /// Root sum of squares of the errors, percent.
    pub rss_pct: f64,
    /// The paper's eq. 15, percent.
    pub eq15_pct: f64,
    /// Monitor runs spent.
    pub evaluations: u64,
}

/// Errors of a group of cases.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Group {
    /// Mean of `rss_pct`.
    pub mean_rss_pct: f64,
    /// Largest.
    pub max_rss_pct: f64,
    /// Mean of `eq15_pct`.
    pub mean_eq15_pct: f64,
}

/// Result of `hmd evaluate paper`.
#[derive(Clone, Debug, Serialize)]
pub struct PaperReport {
    /// Name of the suite.
    pub suite: &'static str,
    /// The actuator.
    pub actuator: String,
    /// Suite seed.
    pub seed: u64,
    /// The 15 single faults.
    pub single: Group,
    /// The vector of Table III.
    pub multi: Group,
    /// Every window.
    pub cases: Vec<Case>,
}

/// Result of `hmd evaluate random`.
#[derive(Clone, Debug, Serialize)]
pub struct RandomReport {
    /// Name of the suite.
    pub suite: &'static str,
    /// The actuator.
    pub actuator: String,
    /// Suite seed.
    pub seed: u64,
    /// Median of `rss_pct`.
    pub median_rss_pct: f64,
    /// 95th percentile.
    pub p95_rss_pct: f64,
    /// Median of `eq15_pct`.
    pub median_eq15_pct: f64,
    /// Every window.
    pub cases: Vec<Case>,
}

struct Plan {
    name: String,
    truth: FaultVector,
    seed: u64,
}

/// The `paper` suite: five faults at three levels and ten seeds each, and Table III's vector at ten seeds.
///
/// Each seed also draws which phase is shorted and the eccentricity's direction; the gain drifts up, as in the paper.
///
/// # Errors
/// [`ConfigError`] when the settings of the search contradict each other.
pub fn paper(
    estimator: &Estimator,
    actuator: &str,
    seed: u64,
    done: &(dyn Fn() + Sync),
) -> Result<PaperReport, ConfigError> {
    let mut plans = Vec::new();
    for fault in ["friction", "backlash", "short", "eccentricity", "gain"] {
        for (label, level) in [("low", 0.25), ("medium", 0.5), ("high", 0.75)] {
            for n in 0..PAPER_SEEDS {
                let case_seed = mix(seed, &[1, plans.len() as u64, n]);
                plans.push(Plan {
                    name: format!("{fault} {label}"),
                    truth: single_fault(fault, level, mix(case_seed, &[1])),
                    seed: case_seed,
                });
            }
        }
    }
    let singles = plans.len();
    for n in 0..PAPER_SEEDS {
        plans.push(Plan {
            name: "table III".to_owned(),
            truth: FaultVector::from_array(TABLE_III),
            seed: mix(seed, &[2, n]),
        });
    }
    let cases = run(estimator, plans, done)?;
    let (single, multi) = cases.split_at(singles);
    Ok(PaperReport {
        suite: "paper",
        actuator: actuator.to_owned(),
        seed,
        single: Group::mean_of(single),
        multi: Group::mean_of(multi),
        cases,
    })
}

/// The `random` suite: `n` vectors of several faults.
///
/// # Errors
/// [`ConfigError`] when the identifier's settings contradict each other.
pub fn random(
    estimator: &Estimator,
    actuator: &str,
    n: u64,
    seed: u64,
    done: &(dyn Fn() + Sync),
) -> Result<RandomReport, ConfigError> {
    let plans = (0..n)
        .map(|n| {
            let case_seed = mix(seed, &[3, n]);
            Plan {
                name: format!("random {n}"),
                // Not the numbers that the window's circumstances are drawn from.
                truth: random_faults(mix(case_seed, &[1])),
                seed: case_seed,
            }
        })
        .collect();
    let cases = run(estimator, plans, done)?;
    Ok(RandomReport {
        suite: "random",
        actuator: actuator.to_owned(),
        seed,
        median_rss_pct: percentile(cases.iter().map(|c| c.rss_pct), 0.5),
        p95_rss_pct: percentile(cases.iter().map(|c| c.rss_pct), 0.95),
        median_eq15_pct: percentile(cases.iter().map(|c| c.eq15_pct), 0.5),
        cases,
    })
}

/// One of the paper's five single faults at a damage level, \[P\] section 6.2.
fn single_fault(fault: &str, level: f64, seed: u64) -> FaultVector {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut k = FaultVector::NOMINAL;
    match fault {
        "friction" => k.friction = level,
        "backlash" => k.backlash = level,
        "short" => match rng.random_range(0..3) {
            0 => k.short_a = level,
            1 => k.short_b = level,
            _ => k.short_c = level,
        },
        "eccentricity" => {
            k.eccentricity = level;
            k.eccentricity_phase = rng.random_range(0.0..1.0);
        }
        _ => k.gain = 0.5 + 0.5 * level,
    }
    k
}

fn run(estimator: &Estimator, plans: Vec<Plan>, done: &(dyn Fn() + Sync)) -> Result<Vec<Case>, ConfigError> {
    plans
        .into_par_iter()
        .map(|plan| {
            let window = SimulatedWindow::new(estimator.params(), plan.truth, Profile::Mixed, plan.seed);
            let estimate = estimator.estimate(&window, plan.seed)?;
            done();
            Ok(case(plan.name, plan.seed, &plan.truth, &estimate))
        })
        .collect()
}

/// An estimate beside its truth.
fn case(name: String, seed: u64, truth: &FaultVector, estimate: &Estimate) -> Case {
    Case {
        name,
        seed,
        truth: truth.to_array(),
        k: estimate.fault.to_array(),
        sigma: estimate.sigma,
        rss_pct: rss_pct(&estimate.fault, truth),
        eq15_pct: eq15_pct(&estimate.fault, truth),
        evaluations: estimate.evaluations,
    }
}

impl Group {
    fn mean_of(cases: &[Case]) -> Self {
        let n = cases.len().max(1) as f64;
        Self {
            mean_rss_pct: cases.iter().map(|c| c.rss_pct).sum::<f64>() / n,
            max_rss_pct: cases.iter().map(|c| c.rss_pct).fold(0.0, f64::max),
            mean_eq15_pct: cases.iter().map(|c| c.eq15_pct).sum::<f64>() / n,
        }
    }
}

/// Value below which the given share of the numbers lies (nearest rank); 0 of none.
fn percentile(values: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
}
