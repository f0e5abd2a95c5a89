//! From the best optimum of a search to the estimate of a window whose numbers have tolerances.

use ema_ga::{LmConfig, levenberg_marquardt};
use ema_models::{
    Comparison, FAULT_COUNT, FaultVector, SIGNAL_COUNT, Scale, Signals, Tolerances, UNKNOWN_COUNT, Weights,
};
use std::vec::Vec;

use super::basis::Basis;
use super::nuisance::NUISANCE_COUNT;
use super::problem::{DIMENSION, Linearised, NUISANCE_MAX, Point, Problem};
use crate::calibration::Mismatch;
use crate::estimate::{Estimate, OBSERVABLE_SIGMA};
use crate::monitor_fit::conclusion::Search;
use crate::monitor_fit::least_squares::constant_box;
use crate::monitor_fit::locked::is_locked;
use crate::monitor_fit::window::MonitoredWindow;
use ema_models::Coordinates;

/// An estimate with its nuisances.
pub(crate) struct ToleratedEstimate {
    pub(crate) estimate: Estimate,
    /// In standard deviations.
    pub(crate) nuisances: [f64; NUISANCE_COUNT],
}

/// Step of the finite differences along the unknowns.
const STEP: f64 = 1e-3;

/// Linearisations at most of one descent.
const MAX_ITERATIONS: u32 = 8;

/// Blocks of consecutive samples whose contributions to an estimate are compared.
const BLOCKS: usize = 16;

/// Fits unknowns and nuisances of a window, from the best optimum of the search and from health.
pub(crate) fn conclude_with_tolerances(
    window: &Comparison<'_>,
    mismatch: &Mismatch,
    tolerances: &Tolerances,
    search: &Search,
) -> ToleratedEstimate {
    let basis = Basis::new(window);
    let problem = Problem::new(*window, &basis, tolerances, STEP);
    let best = search.best().at;
    let mut healthy = Scale::new(window.params).coordinates(&window.unknowns_with_fault(FaultVector::NOMINAL));
    healthy.0[8..].copy_from_slice(&best.0[8..]);
    let mut descents: Vec<Descent> = [best, healthy]
        .into_iter()
        .map(|start| descend(&problem, point(&start)))
        .collect();
    descents.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let reweighted = problem.with_weights(weights_by_noise(&problem, mismatch, &descents[0].at));
    let refined = descend(&reweighted, descents[0].at);
    let spent = search.evaluations + descents.iter().map(|d| d.spent).sum::<u64>() + refined.spent;
    let mut estimate = assess(&reweighted, mismatch, &refined.at, spent);
    estimate.cost = problem.mean_cost(&refined.at);
    estimate.cut = search.cut;
    ToleratedEstimate {
        estimate,
        nuisances: core::array::from_fn(|n| refined.at[UNKNOWN_COUNT + n]),
    }
}

fn point(at: &Coordinates) -> Point {
    core::array::from_fn(|p| at.0.get(p).copied().unwrap_or(0.0))
}

struct Descent {
    at: Point,
    cost: f64,
    spent: u64,
}

fn descend(problem: &Problem<'_>, start: Point) -> Descent {
    let side = |own: [f64; UNKNOWN_COUNT], nuisance: f64| -> Point {
        core::array::from_fn(|p| own.get(p).copied().unwrap_or(nuisance))
    };
    let bounds = constant_box(
        side(Coordinates::LOWER, -NUISANCE_MAX),
        side(Coordinates::UPPER, NUISANCE_MAX),
    );
    let config = LmConfig {
        max_iterations: MAX_ITERATIONS,
        max_evaluations: 4 * MAX_ITERATIONS,
        step_tolerance: 1e-6,
        cost_tolerance: 1e-4,
        ..LmConfig::default()
    };
    let found = levenberg_marquardt(problem, &bounds, start, &config);
    Descent {
        at: found.genes,
        cost: found.cost,
        spent: u64::from(found.iterations) * (DIMENSION as u64 + 1) + u64::from(found.evaluations - found.iterations),
    }
}

/// As without tolerances: less weight where a signal is noisier than in the windows of the calibration.
fn weights_by_noise(problem: &Problem<'_>, mismatch: &Mismatch, at: &Point) -> Weights {
    let expected = Signals::from(mismatch.residual_rms).to_array();
    let (squares, count) = problem.squared_residuals(at);
    let mut weights = problem.comparison().weights.to_array();
    for signal in 0..SIGNAL_COUNT {
        let found = libm::sqrt(squares[signal] / (count as f64).max(1.0));
        weights[signal] *= (expected[signal] / found.max(f64::MIN_POSITIVE)).min(1.0);
    }
    Signals::from_array(weights)
}

/// The estimate of a point, and how uncertain it is.
fn assess(problem: &Problem<'_>, mismatch: &Mismatch, at: &Point, evaluations: u64) -> Estimate {
    let window = problem.comparison();
    let linearised = problem.linearised(at);
    let unknowns = problem.unknowns(at);
    let fault = unknowns.fault;
    let (squares, count) = problem.squared_residuals(at);
    let n = (count as f64).max(1.0);
    let excess = (2.0 * linearised.cost() / (n * window.weighted_signals())).max(1.0);
    let [by_data, with_nuisances] = sigmas(&linearised, excess);
    let with_model = |sigma: [f64; FAULT_COUNT]| -> [f64; FAULT_COUNT] {
        core::array::from_fn(|p| sigma[p].hypot(mismatch.model_sigma[p]))
    };
    let (alone, total) = (with_model(by_data), with_model(with_nuisances));
    let mut sigma = [None; FAULT_COUNT];
    let mut observable = [false; FAULT_COUNT];
    for p in [0, 1, 2, 3, 4, 7] {
        observable[p] = alone[p] <= OBSERVABLE_SIGMA;
        sigma[p] = observable[p].then_some(total[p]);
    }
    observable[5] = alone[5].max(alone[6]) <= OBSERVABLE_SIGMA;
    let amplitude_sigma = total[5].max(total[6]);
    sigma[5] = observable[5].then_some(amplitude_sigma);
    if observable[5] && fault.eccentricity > 3.0 * amplitude_sigma {
        observable[6] = true;
        sigma[6] = Some(amplitude_sigma / fault.eccentricity / core::f64::consts::TAU);
    }
    Estimate {
        fault,
        unknowns,
        sigma,
        observable,
        cost: linearised.cost() / n,
        residual_rms_a: libm::sqrt(squares[1] / n),
        evaluations: evaluations + DIMENSION as u64 + 1,
        cut: false,
        competing_optimum: None,
        back_emf_off: unknowns.motor.back_emf - window.prior.motor.mean.back_emf,
        other_motor: false,
        locked: is_locked(window),
    }
}

/// Standard deviations of the fault coordinates: with the nuisances known, and with their tolerances.
///
/// The latter is the larger of two: that of the curvature, and that of how differently blocks of samples contribute to the
/// estimate, which also shows what no nuisance explains.
fn sigmas(linearised: &Linearised, excess: f64) -> [[f64; FAULT_COUNT]; 2] {
    let mut information = linearised.information();
    for p in 0..DIMENSION {
        information[(p, p)] += 1e-9;
    }
    let own = information
        .fixed_view::<UNKNOWN_COUNT, UNKNOWN_COUNT>(0, 0)
        .into_owned();
    let (Some(own), Some(all)) = (own.cholesky(), information.cholesky()) else {
        return [[f64::INFINITY; FAULT_COUNT]; 2];
    };
    let (own, all) = (own.inverse(), all.inverse());
    let by_data = core::array::from_fn(|p| libm::sqrt(excess * own[(p, p)]));
    let blocks = block_contributions(linearised, |p, q| all[(p, q)]);
    let with_nuisances = core::array::from_fn(|p| {
        let curvature = excess * all[(p, p)];
        libm::sqrt(curvature.max(blocks[p]))
    });
    [by_data, with_nuisances]
}

/// Sum over the blocks of their squared contributions to each fault coordinate.
fn block_contributions(linearised: &Linearised, covariance: impl Fn(usize, usize) -> f64) -> [f64; FAULT_COUNT] {
    let rows = &linearised.rows;
    let samples = rows.len() / linearised.rows_per_sample.max(1);
    let per_block = samples.div_ceil(BLOCKS).max(1) * linearised.rows_per_sample.max(1);
    let mut sums = [0.0; FAULT_COUNT];
    for block in rows.chunks(per_block) {
        let mut score = [0.0; DIMENSION];
        for row in block {
            let residual = row[DIMENSION];
            for (sum, slope) in score.iter_mut().zip(row) {
                *sum += slope * residual;
            }
        }
        for (p, sum) in sums.iter_mut().enumerate() {
            let contribution: f64 = (0..DIMENSION).map(|q| covariance(p, q) * score[q]).sum();
            *sum += contribution * contribution;
        }
    }
    sums
}
