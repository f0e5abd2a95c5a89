//! The `noise` suite: sensors, load and motor as they are in service.

use ema_ga::ConfigError;
use ema_models::{FAULT_COUNT, FaultVector, wrapped_phase_difference};
use rayon::prelude::*;
use serde::Serialize;

use super::matched::crlb_ratio;
use super::motors::Motor;
use super::{Case, case, percentile};
use crate::calibrate_type::random_faults;
use ema_identify::{Estimate, Identifier};
use hmd_core::seed::mix;

/// Sample rates of the suite, Hz.
pub const NOISE_RATES_HZ: [f64; 2] = [2000.0, 400.0];

/// Normal deviate of a two-sided 95 % interval.
pub(super) const NORMAL_95: f64 = 1.959_964;

/// Result of `hmd evaluate noise`.
#[derive(Clone, Debug, Serialize)]
pub struct NoiseReport {
    /// Name of the suite.
    pub suite: &'static str,
    /// The actuator.
    pub actuator: String,
    /// Suite seed.
    pub seed: u64,
    /// Results by sample rate.
    pub rates: Vec<NoiseAtRate>,
}

/// The suite at one sample rate.
#[derive(Clone, Debug, Serialize)]
pub struct NoiseAtRate {
    /// Sample rate, Hz.
    pub sample_rate_hz: f64,
    /// Median of `rss_pct`.
    pub median_rss_pct: f64,
    /// 95th percentile.
    pub p95_rss_pct: f64,
    /// Share of the stated sigmas whose 95 % interval holds the truth.
    pub coverage_95: f64,
    /// The same for each component of the fault vector.
    pub coverage_95_by_component: [Option<f64>; FAULT_COUNT],
    /// Root-mean-square error over the Cramér–Rao bound, on data that the monitor itself wrote.
    pub crlb_ratio: f64,
    /// Every window.
    pub cases: Vec<Case>,
}

/// The `noise` suite: `n` motors with the vectors of the `random` suite, at both rates.
///
/// # Errors
/// [`ConfigError`] when the identifier's settings contradict each other.
pub fn noise(
    identifier: &Identifier,
    actuator: &str,
    n: u64,
    seed: u64,
    done: &(dyn Fn() + Sync),
) -> Result<NoiseReport, ConfigError> {
    let mut rates = Vec::new();
    for rate in NOISE_RATES_HZ {
        rates.push(at_rate(identifier, rate, n, seed, done)?);
    }
    Ok(NoiseReport {
        suite: "noise",
        actuator: actuator.to_owned(),
        seed,
        rates,
    })
}

fn at_rate(
    identifier: &Identifier,
    rate: f64,
    n: u64,
    seed: u64,
    done: &(dyn Fn() + Sync),
) -> Result<NoiseAtRate, ConfigError> {
    let found: Vec<(Case, [Option<bool>; FAULT_COUNT])> = (0..n)
        .into_par_iter()
        .map(|n| {
            // The vectors of the random suite; everything else is drawn anew.
            let truth = random_faults(mix(seed, &[3, n]));
            let case_seed = mix(seed, &[4, n, rate.to_bits()]);
            let motor = Motor::draw(&identifier.params, rate, case_seed);
            let identifier = motor.calibrated(identifier);
            let window = motor.window(truth, mix(case_seed, &[5]));
            let estimate = identifier.identify(&window.prepared, window.conditions, case_seed)?;
            done();
            let held = covered(&estimate, &truth);
            Ok((case(format!("random {n}"), case_seed, &truth, &estimate), held))
        })
        .collect::<Result<_, ConfigError>>()?;
    let share = |held: &mut dyn Iterator<Item = bool>| {
        let (mut count, mut good) = (0_u64, 0_u64);
        for held in held {
            count += 1;
            good += u64::from(held);
        }
        (count > 0).then(|| good as f64 / count as f64)
    };
    let coverage_95_by_component = std::array::from_fn(|p| share(&mut found.iter().filter_map(|(_, held)| held[p])));
    let coverage_95 = share(&mut found.iter().flat_map(|(_, held)| held.iter().flatten().copied())).unwrap_or(0.0);
    let cases: Vec<Case> = found.into_iter().map(|(case, _)| case).collect();
    Ok(NoiseAtRate {
        sample_rate_hz: rate,
        median_rss_pct: percentile(cases.iter().map(|c| c.rss_pct), 0.5),
        p95_rss_pct: percentile(cases.iter().map(|c| c.rss_pct), 0.95),
        coverage_95,
        coverage_95_by_component,
        crlb_ratio: crlb_ratio(identifier, rate, 0..n, seed)?,
        cases,
    })
}

/// Whether the 95 % interval of each component holds the truth; `None` where none is stated.
pub(super) fn covered(estimate: &Estimate, truth: &FaultVector) -> [Option<bool>; FAULT_COUNT] {
    let (k, t) = (estimate.fault.to_array(), truth.to_array());
    std::array::from_fn(|p| {
        let off = if p == 6 {
            wrapped_phase_difference(k[p], t[p])
        } else {
            k[p] - t[p]
        };
        estimate.sigma[p].map(|sigma| off.abs() <= NORMAL_95 * sigma)
    })
}
