//! From the best optimum of a search to the estimate of a window whose numbers have tolerances.

use core::cell::RefCell;
use core::mem;
use core::ops::RangeInclusive;
use std::rc::Rc;

use ema_ga::{LmConfig, LmStop, levenberg_marquardt};
use ema_models::{
    ActuatorParams, COST_LANES, Comparison, Coordinates, FAULT_COUNT, FaultVector, MOTOR_COORDINATES, MotorKnowledge,
    SIGNAL_COUNT, Scale, Signals, Tolerances, UNKNOWN_COUNT, Weights,
};

use super::basis::Basis;
use super::derivatives::Derivatives;
use super::inferred::inferred;
use super::linearised::Linearised;
use super::on_descent::{Known, OnDescent};
use super::problem::{Buffers, DIMENSION, NUISANCE_MAX, Point, Problem, coordinates};
use nalgebra::SMatrix;

use crate::calibration::Mismatch;
use crate::estimate::{Estimate, OBSERVABLE_SIGMA};
use crate::monitor_fit::coarse_time::Time;
use crate::monitor_fit::competing_optima::{differ, undecided_difference};
use crate::monitor_fit::conclusion::Search;
use crate::monitor_fit::least_squares::constant_box;
use crate::monitor_fit::locked::is_locked;
use crate::monitor_fit::timed::FineResiduals;
use crate::monitor_fit::uncertainty::reported;
use crate::monitor_fit::weak_magnet::{ALL_SHORTED, ANY_MAGNET};
use crate::monitor_fit::window::MonitoredWindow;

/// Step of the finite differences along the unknowns.
const STEP: f64 = 1e-3;

/// How a descent goes.
#[derive(Clone, Copy)]
struct How {
    /// Damping of the first step.
    damping: f64,
    /// Linearisations at most.
    iterations: u32,
    /// Decrease of the cost, as a share of it, by which no further step follows: the cost is some 1500, one standard deviation half a unit.
    cost_tolerance: f64,
    /// The same of a decrease that is expected.
    expected_tolerance: f64,
}

impl How {
    /// From where a window without nuisances led, if it fits there. Nuisances and faults explain much of a window alike: with less damping
    /// a descent follows the valleys between them further than the monitor's own mismatch allows, away from a good start. From 0.01 to 1 the
    /// errors are the same, at 0.001 half as large again.
    const FROM_A_FIT: Self = Self {
        damping: 0.1,
        iterations: 8,
        cost_tolerance: 3e-3,
        expected_tolerance: 1e-3,
    };

    /// From where it fits less well: what is left is not noise but what nuisances explain.
    const FROM_A_POOR_FIT: Self = Self {
        damping: 1e-3,
        iterations: 8,
        ..Self::FROM_A_MISFIT
    };

    /// From where it did not fit: the faults there stand for what nuisances explain, and how much those explain in the end says whether the
    /// window is modelled.
    const FROM_A_MISFIT: Self = Self {
        damping: 1e-6,
        iterations: 16,
        cost_tolerance: 1e-3,
        expected_tolerance: 1e-4,
    };

    /// From where this one ended, with other weights or another magnet.
    fn nearby(self) -> Self {
        Self {
            damping: self.damping.max(NEARBY_DAMPING),
            iterations: 4,
            ..self
        }
    }

    /// From an optimum without nuisances of this cost.
    fn from(window: &Comparison<'_>, cost: f64) -> Self {
        let expected = 0.5 * window.weighted_signals() * window.sample_count() as f64;
        if cost <= FITS * expected {
            Self::FROM_A_FIT
        } else if cost <= FITS_POORLY * expected {
            Self::FROM_A_POOR_FIT
        } else {
            Self::FROM_A_MISFIT
        }
    }
}

/// Cost, relative to what noise makes of it, up to which a window without nuisances fits, and fits poorly.
const FITS: f64 = 1.5;
const FITS_POORLY: f64 = 3.0;

/// Least damping of a descent that begins where another one ended.
const NEARBY_DAMPING: f64 = 1e-3;

/// Trials that a linearisation takes at most, on average.
const TRIALS_PER_STEP: u32 = 3;

/// Monitor runs of a whole linearisation at most: the point and one step along each coordinate.
const RUNS_PER_LINEARISATION: u64 = DIMENSION as u64 + 1;

/// Monitor runs of the further linearisations of a descent, without the slow coordinates, at most.
const RUNS_PER_FURTHER: u64 = COST_LANES as u64;

/// The budget's share of the first descent, one in as many; and of each of the later ones: from another start, after the reweighting, and
/// with another magnet.
const FIRST_SHARE: u64 = 2;
const LATER_SHARE: u64 = 6;

/// Blocks of consecutive samples whose contributions to an estimate are compared.
const BLOCKS: usize = 16;

/// Cost from which on a residual is taken for something that no nuisance describes: it lasts, and so does not average out as noise
/// does; sigmas grow with the cost. Units with any imperfection that a nuisance describes cost 0.9 to 1.9.
const SYSTEMATIC_COST: f64 = 2.0;

/// Fits unknowns and nuisances of a window. `kept` are residuals of the search; `budget` are the monitor runs that the whole identification
/// may take.
///
/// After a search with the derivatives of coarse time this has them, too, and begins at its best optimum; where that leaves a short in all
/// three phases, also without it. After a search in fine time it begins at the best optimum and at another one, or at health.
pub(crate) fn conclude_with_tolerances(
    window: &Comparison<'_>,
    coarse: &ActuatorParams,
    mismatch: &Mismatch,
    tolerances: &Tolerances,
    search: &Search,
    kept: &RefCell<FineResiduals>,
    budget: u64,
) -> Estimate {
    let basis = Basis::new(window, tolerances);
    let best = search.best().at;
    let unknowns = Scale::new(window.params).unknowns(&best);
    let buffers = Buffers::with_residuals(point(&best), kept.borrow_mut().at(window, &unknowns).to_vec());
    let differentiated = match search.time {
        Time::Fine => window.params,
        Time::Both | Time::Coarse => coarse,
    };
    let problem = Problem::new(*window, differentiated, &basis, tolerances, STEP, &buffers);
    let left = budget.saturating_sub(search.evaluations + RUNS_PER_LINEARISATION);
    let share = left / LATER_SHARE;
    let how = How::from(window, search.best().cost);
    let from = |start: Point, budget: u64| {
        let mut known = Known::default();
        let end = descend(&problem, start, &mut known, how, budget);
        (end, known)
    };
    let (mut first, mut known) = from(point(&best), left / FIRST_SHARE);
    let other = match search.time {
        Time::Fine => Some(point(&other_start(window, search))),
        Time::Both | Time::Coarse => without_common_short(&first.at),
    };
    let mut second = None;
    if let Some((other, nearby)) = other.map(|other| from(other, share)) {
        if other.cost < first.cost {
            second = Some(mem::replace(&mut first, other));
            known = nearby;
        } else {
            second = Some(other);
        }
    }
    let reweighted = problem.with_weights(weights_by_noise(&problem, mismatch, &first.at));
    let refined = descend(&reweighted, first.at, &mut known, how.nearby(), share);
    let undecided = undecided_difference(window, first.cost);
    let (second_spent, second_cut) = second.as_ref().map_or((0, false), |second| (second.spent, second.cut));
    let as_good = second
        .filter(|second| second.cost - first.cost < undecided)
        .map(|second| second.at);
    let (magnet, more) = weak_magnet(&reweighted, &refined, &mut known, how.nearby(), share);
    let (at, other_motor) = match &magnet {
        WeakMagnet::Yes(other) => (*other, true),
        WeakMagnet::No | WeakMagnet::Perhaps(_) => (refined.at, false),
    };
    let competing = match magnet {
        WeakMagnet::Perhaps(other) => Some(other),
        WeakMagnet::No | WeakMagnet::Yes(_) => as_good,
    };
    let cost = problem.mean_cost(&at);
    let misfit = (cost / SYSTEMATIC_COST).max(1.0);
    let spent = search.evaluations + first.spent + second_spent + refined.spent + more;
    Estimate {
        cost,
        cut: search.cut || first.cut || second_cut || refined.cut,
        other_motor,
        ..assess(&reweighted, mismatch, &at, competing, misfit, spent)
    }
}

/// The best optimum that differs from the very best one; without one health, with the load, integral and motor of that.
fn other_start(window: &Comparison<'_>, search: &Search) -> Coordinates {
    let best = search.best().at;
    let others = search.optima.iter().map(|optimum| optimum.at);
    let differs = |other: &Coordinates| differ(other, &best, |_| true);
    others.skip(1).find(differs).unwrap_or_else(|| {
        let mut healthy = Scale::new(window.params).coordinates(&window.unknowns_with_fault(FaultVector::NOMINAL));
        healthy.0[FAULT_COUNT..].copy_from_slice(&best.0[FAULT_COUNT..]);
        healthy
    })
}

/// Least short that is one.
const ANY_SHORT: f64 = 0.02;

/// A point without the short that all three phases share, where there is one: other friction, inertia and magnets look much the same.
fn without_common_short(at: &Point) -> Option<Point> {
    let common = common_short(at);
    (common > ANY_SHORT).then(|| {
        let mut other = *at;
        for phase in &mut other[SHORTS] {
            *phase -= common;
        }
        other
    })
}

/// Places of the shorts among the coordinates.
const SHORTS: RangeInclusive<usize> = 2..=4;

/// The short that all three phases share.
fn common_short(at: &Point) -> f64 {
    at[SHORTS].iter().copied().fold(f64::INFINITY, f64::min)
}

/// Calls `visit` with index and unweighted residuals of each measured sample for an estimate with deviations.
pub(crate) fn residuals_with_tolerances(
    window: &Comparison<'_>,
    tolerances: &Tolerances,
    estimate: &Estimate,
    mut visit: impl FnMut(usize, Signals<f64>),
) {
    let basis = Basis::new(window, tolerances);
    let buffers = Buffers::default();
    let problem = Problem::new(*window, window.params, &basis, tolerances, STEP, &buffers);
    let mut at = point(&Scale::new(window.params).coordinates(&estimate.unknowns));
    for (slot, deviation) in at[UNKNOWN_COUNT..].iter_mut().zip(&estimate.deviations) {
        *slot = *deviation;
    }
    problem.residuals(&at, |n, residuals| visit(n, Signals::from_array(residuals)));
}

/// Whether the magnets are weak, rather than all three phases shorted.
enum WeakMagnet {
    No,
    Perhaps(Point),
    Yes(Point),
}

/// As without tolerances: where all three phases are shorted, tries whether the motor's back-EMF, left open, takes their place.
/// Monitor runs spent, too.
fn weak_magnet<'a>(
    problem: &Problem<'a>,
    optimum: &Descent,
    derivatives: &mut Known<'a>,
    how: How,
    budget: u64,
) -> (WeakMagnet, u64) {
    let common = common_short(&optimum.at);
    let known = problem.comparison().prior.motor;
    if common < ALL_SHORTED || known.information().is_none() {
        return (WeakMagnet::No, 0);
    }
    let open = problem.with_motor(MotorKnowledge {
        mean: known.mean,
        covariance: [[known.covariance[0][0], 0.0], [0.0, ANY_MAGNET * ANY_MAGNET]],
    });
    let mut start = optimum.at;
    for phase in &mut start[SHORTS] {
        *phase -= common;
    }
    start[MOTOR_COORDINATES[1]] -= common;
    let found = descend(&open, start, derivatives, how, budget);
    let before = open.cost(&optimum.at);
    let allowed = undecided_difference(problem.comparison(), found.cost.min(before));
    let spent = found.spent + 1;
    let different = differ(&coordinates(&found.at), &coordinates(&optimum.at), |_| true);
    if different && found.cost < before - allowed {
        (WeakMagnet::Yes(found.at), spent)
    } else if different && found.cost < before + allowed {
        (WeakMagnet::Perhaps(found.at), spent)
    } else {
        (WeakMagnet::No, spent)
    }
}

fn point(at: &Coordinates) -> Point {
    core::array::from_fn(|p| at.0.get(p).copied().unwrap_or(0.0))
}

/// Where a descent ended.
struct Descent {
    at: Point,
    cost: f64,
    /// Monitor runs spent.
    spent: u64,
    /// Whether the budget of monitor runs cut it short.
    cut: bool,
}

/// A descent of at most `budget` monitor runs, with the derivatives `known` from earlier ones, which those of this one join; with a budget too
/// small for one step, or with none that lowers the cost, the start itself.
fn descend<'a>(problem: &Problem<'a>, start: Point, known: &mut Known<'a>, how: How, budget: u64) -> Descent {
    let side = |own: [f64; UNKNOWN_COUNT], nuisance: f64| -> Point {
        core::array::from_fn(|p| own.get(p).copied().unwrap_or(nuisance))
    };
    let bounds = constant_box(
        side(Coordinates::LOWER, -NUISANCE_MAX),
        side(Coordinates::UPPER, NUISANCE_MAX),
    );
    let trials = u64::from(TRIALS_PER_STEP);
    let first = if known.is_whole() {
        RUNS_PER_FURTHER
    } else {
        RUNS_PER_LINEARISATION
    };
    let further = |left: u64| 1 + left / (RUNS_PER_FURTHER + trials);
    let affordable = budget.checked_sub(first + trials).map_or(0, further);
    let iterations = affordable.min(u64::from(how.iterations)) as u32;
    let at_start = Descent {
        at: start,
        cost: problem.cost(&start),
        spent: 1,
        cut: iterations == 0,
    };
    if iterations == 0 {
        return at_start;
    }
    let config = LmConfig {
        max_iterations: iterations,
        max_evaluations: (1 + TRIALS_PER_STEP) * iterations,
        initial_damping: how.damping,
        step_tolerance: 1e-6,
        cost_tolerance: how.cost_tolerance,
        expected_tolerance: how.expected_tolerance,
        ..LmConfig::default()
    };
    let corrected = problem.corrected();
    let on_descent = OnDescent::new(&corrected, known);
    let found = levenberg_marquardt(&on_descent, &bounds, start, &config);
    let end = Descent {
        at: found.genes,
        cost: problem.cost(&found.genes),
        spent: at_start.spent + 1 + on_descent.ended(),
        cut: iterations < how.iterations && matches!(found.stop, LmStop::MaxIterations | LmStop::MaxEvaluations),
    };
    if end.cost <= at_start.cost {
        end
    } else {
        Descent {
            spent: end.spent,
            cut: end.cut,
            ..at_start
        }
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
fn assess(
    problem: &Problem<'_>,
    mismatch: &Mismatch,
    at: &Point,
    competing: Option<Point>,
    misfit: f64,
    evaluations: u64,
) -> Estimate {
    let window = problem.comparison();
    // Whole, at the end itself: derivatives of another point along the nuisances make the valleys look narrower, sigmas 5 % smaller.
    let linearised = Linearised::new(problem, Rc::new(Derivatives::at(problem, at, None)), at);
    let unknowns = problem.unknowns(at);
    let fault = unknowns.fault;
    let (squares, count) = problem.squared_residuals(at);
    let n = (count as f64).max(1.0);
    let excess = (2.0 * linearised.cost / (n * window.weighted_signals())).max(1.0);
    let [by_data, with_nuisances] = sigmas(&linearised, excess).map(|sigma| sigma.map(|sigma| misfit * sigma));
    let with_model = |sigma: [f64; FAULT_COUNT]| -> [f64; FAULT_COUNT] {
        core::array::from_fn(|p| sigma[p].hypot(mismatch.model_sigma[p]))
    };
    let (alone, tolerated) = (with_model(by_data), with_model(with_nuisances));
    let competing =
        competing.filter(|other| differ(&coordinates(other), &coordinates(at), |p| alone[p] <= OBSERVABLE_SIGMA));
    // No winding fails in three phases alike: what all share may stand for friction, magnets or inertia.
    let in_common = |p: usize| if SHORTS.contains(&p) { common_short(at) } else { 0.0 };
    let total: [f64; FAULT_COUNT] = core::array::from_fn(|p| {
        let other = competing.map_or(0.0, |other| other[p] - at[p]);
        tolerated[p].hypot(other).hypot(in_common(p))
    });
    let (sigma, observable) = reported(fault.eccentricity, &alone, &total);
    Estimate {
        fault,
        unknowns,
        sigma,
        observable,
        cost: linearised.cost / n,
        residual_rms_a: libm::sqrt(squares[1] / n),
        evaluations: evaluations + RUNS_PER_LINEARISATION,
        cut: false,
        competing_optimum: competing.map(|other| problem.unknowns(&other).fault),
        share: [0.0; FAULT_COUNT],
        back_emf_off: unknowns.motor.back_emf - window.prior.motor.mean.back_emf,
        other_motor: false,
        locked: is_locked(window),
        deviations: at[UNKNOWN_COUNT..].to_vec(),
        inferred: inferred(problem, &linearised, at, libm::sqrt(excess) * misfit),
    }
}

/// Standard deviations of the fault coordinates: with the nuisances known, and with their tolerances.
///
/// The latter is the larger of two: that of the curvature, and that of how differently blocks of samples contribute to the
/// estimate, which also shows what no nuisance explains.
fn sigmas(linearised: &Linearised<'_>, excess: f64) -> [[f64; FAULT_COUNT]; 2] {
    let information = regular_information(linearised);
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

/// `JᵀJ` with the prior; a coordinate without influence gets a vanishing information, so that the others can be inverted.
fn regular_information(linearised: &Linearised<'_>) -> SMatrix<f64, DIMENSION, DIMENSION> {
    let mut information = linearised.information;
    for p in 0..DIMENSION {
        information[(p, p)] += 1e-9;
    }
    information
}

/// Sum over the blocks of their squared contributions to each fault coordinate.
fn block_contributions(linearised: &Linearised<'_>, covariance: impl Fn(usize, usize) -> f64) -> [f64; FAULT_COUNT] {
    let samples = linearised.samples();
    let per_block = samples.div_ceil(BLOCKS).max(1);
    let mut sums = [0.0; FAULT_COUNT];
    for begin in (0..samples).step_by(per_block) {
        let score = linearised.score(begin..(begin + per_block).min(samples));
        for (p, sum) in sums.iter_mut().enumerate() {
            let contribution: f64 = (0..DIMENSION).map(|q| covariance(p, q) * score[q]).sum();
            *sum += contribution * contribution;
        }
    }
    sums
}
