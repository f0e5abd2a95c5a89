//! The `detection` suite: verdicts of single windows, healthy and faulty.

use ema_ga::ConfigError;
use ema_models::{FAULT_COUNT, FaultVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::Serialize;

use super::motors::Motor;
use ema_identify::Identifier;
use hmd_core::assess::judgement;
use hmd_core::health::{FAULTS, Health, HealthState, Levels, LevelsError, fault_name};
use hmd_core::seed::mix;

/// Healthy windows of each motor, and as many faulty ones.
const WINDOWS: u64 = 100;

/// Smallest damage of a faulty window; the largest is that of the `random` suite.
const DAMAGE: std::ops::Range<f64> = 0.1..0.6;

/// Result of `hmd evaluate detection`.
#[derive(Clone, Debug, Serialize)]
pub struct DetectionReport {
    /// Name of the suite.
    pub suite: &'static str,
    /// The actuator.
    pub actuator: String,
    /// Suite seed.
    pub seed: u64,
    /// Motors.
    pub motors: u64,
    /// Share of the healthy windows that named a fault.
    pub false_alarm_rate: f64,
    /// Share of the faulty windows that named a fault.
    pub detection_rate: f64,
    /// The same by the true fault.
    pub detection_rate_by_fault: Vec<ByFault>,
    /// Share of the faulty windows that named exactly the true one.
    pub isolation_rate: f64,
    /// Windows that were wrong: false alarms, faults missed or named otherwise.
    pub wrong: Vec<Wrong>,
}

/// Rates of one true fault.
#[derive(Clone, Debug, Serialize)]
pub struct ByFault {
    /// Its name.
    pub fault: &'static str,
    /// Windows that had it.
    pub windows: u64,
    /// Share that named a fault.
    pub detection_rate: f64,
    /// Share that named exactly this one.
    pub isolation_rate: f64,
}

/// One wrong verdict.
#[derive(Clone, Debug, Serialize)]
pub struct Wrong {
    /// The truth.
    pub truth: [f64; FAULT_COUNT],
    /// What was named.
    pub named: Vec<&'static str>,
    /// The estimate.
    pub k: [f64; FAULT_COUNT],
    /// Its sigma.
    pub sigma: [Option<f64>; FAULT_COUNT],
}

/// Why the suite could not run.
#[derive(Debug, thiserror::Error)]
pub enum DetectionError {
    /// Settings of the search.
    #[error(transparent)]
    Search(#[from] ConfigError),
    /// Levels of health.
    #[error(transparent)]
    Levels(#[from] LevelsError),
}

/// One verdict: the true fault (`None` for a healthy window), and what went wrong if anything did.
struct Verdict {
    fault: Option<usize>,
    named: Vec<&'static str>,
    wrong: Option<Wrong>,
}

/// The `detection` suite: `n` motors, each known from five healthy windows, with 100 healthy and 100 faulty windows each,
/// under the noise of the `noise` suite at the type's own rate; the verdict of each window alone, without memory.
///
/// # Errors
/// Settings that contradict each other.
pub fn detection(
    identifier: &Identifier,
    levels: [Levels; FAULTS],
    actuator: &str,
    n: u64,
    seed: u64,
    done: &(dyn Fn() + Sync),
) -> Result<DetectionReport, DetectionError> {
    let rate = identifier.params.sensors.sample_rate;
    let verdicts: Vec<Vec<Verdict>> = (0..n)
        .into_par_iter()
        .map(|motor| {
            let motor_seed = mix(seed, &[8, motor]);
            let motor = Motor::draw(&identifier.params, rate, motor_seed);
            let identifier = motor.calibrated(identifier);
            (0..2 * WINDOWS)
                .into_par_iter()
                .map(|window| {
                    let window_seed = mix(motor_seed, &[9, window]);
                    let (fault, truth) = if window < WINDOWS {
                        (None, FaultVector::NOMINAL)
                    } else {
                        let fault = (window % FAULTS as u64) as usize;
                        (Some(fault), single(fault, window_seed))
                    };
                    let simulated = motor.window(truth, window_seed);
                    let estimate = identifier.identify(&simulated.prepared, simulated.conditions, window_seed)?;
                    let explained = (!estimate.is_unmodelled()).then(|| judgement(&estimate));
                    let decision = Health::new(levels.map(Levels::at_once))?.update(0, explained.as_ref());
                    let named = if decision.state > HealthState::Nominal {
                        decision.faults
                    } else {
                        Vec::new()
                    };
                    let right = match fault {
                        None => named.is_empty(),
                        Some(fault) => named == [fault_name(fault)],
                    };
                    done();
                    let wrong = (!right).then(|| Wrong {
                        truth: truth.to_array(),
                        named: named.clone(),
                        k: estimate.fault.to_array(),
                        sigma: estimate.sigma,
                    });
                    Ok(Verdict { fault, named, wrong })
                })
                .collect::<Result<_, DetectionError>>()
        })
        .collect::<Result<_, DetectionError>>()?;
    let verdicts: Vec<Verdict> = verdicts.into_iter().flatten().collect();
    let rate = |of: &dyn Fn(&Verdict) -> bool, good: &dyn Fn(&Verdict) -> bool| {
        let chosen: Vec<&Verdict> = verdicts.iter().filter(|v| of(v)).collect();
        let count = chosen.iter().filter(|v| good(v)).count();
        (chosen.len() as u64, count as f64 / chosen.len().max(1) as f64)
    };
    let alarm = |v: &Verdict| !v.named.is_empty();
    let right = |v: &Verdict| v.wrong.is_none();
    let faulty = |v: &Verdict| v.fault.is_some();
    Ok(DetectionReport {
        suite: "detection",
        actuator: actuator.to_owned(),
        seed,
        motors: n,
        false_alarm_rate: rate(&|v| v.fault.is_none(), &alarm).1,
        detection_rate: rate(&faulty, &alarm).1,
        detection_rate_by_fault: (0..FAULTS)
            .map(|fault| {
                let of = |v: &Verdict| v.fault == Some(fault);
                let (windows, detection_rate) = rate(&of, &alarm);
                ByFault {
                    fault: fault_name(fault),
                    windows,
                    detection_rate,
                    isolation_rate: rate(&of, &right).1,
                }
            })
            .collect(),
        isolation_rate: rate(&faulty, &right).1,
        wrong: verdicts.into_iter().filter_map(|v| v.wrong).collect(),
    })
}

/// One fault of a damage between 0.1 and 0.6; the gain to either side.
fn single(fault: usize, seed: u64) -> FaultVector {
    let mut rng = ChaCha8Rng::seed_from_u64(mix(seed, &[10]));
    let damage = rng.random_range(DAMAGE);
    let mut k = FaultVector::NOMINAL;
    match fault {
        0 => k.friction = damage,
        1 => k.backlash = damage,
        2 => k.short_a = damage,
        3 => k.short_b = damage,
        4 => k.short_c = damage,
        5 => {
            k.eccentricity = damage;
            k.eccentricity_phase = rng.random_range(0.0..1.0);
        }
        _ => k.gain = 0.5 + 0.5 * if rng.random_bool(0.5) { damage } else { -damage },
    }
    k
}
