//! Levenberg–Marquardt on the residuals of all signals, from several starts.

use ema_ga::{Bounds, LmConfig, LmStop, Residuals, levenberg_marquardt};
use ema_models::{
    COST_LANES, Comparison, Coordinates, FAULT_COUNT, FaultVector, LOAD_COORDINATE, NormalEquations, Scale,
    UNKNOWN_COUNT, Unknowns,
};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

use super::{RUNS_PER_LINEARISATION, box_of};

/// Loads from which a refinement starts where the load is not measured, in the same shares: the gear's losses bend at
/// zero, so both sides are tried.
const LOAD_STARTS: [f64; 2] = [-0.01, 0.01];

/// Where refinements start: each fault vector, with the load as measured or else on both sides of none.
pub(super) fn starts(comparison: &Comparison<'_>, scale: &Scale, faults: &[FaultVector]) -> Vec<Coordinates> {
    let mut starts = Vec::new();
    for &fault in faults {
        let unknowns = comparison.unknowns_with_fault(fault);
        match comparison.conditions.load_torque {
            Some(_) => starts.push(scale.coordinates(&unknowns)),
            None => starts.extend(LOAD_STARTS.map(|share| {
                scale.coordinates(&Unknowns {
                    load_torque: share * scale.load_unit(),
                    ..unknowns
                })
            })),
        }
    }
    starts
}

/// Steps of the finite differences: far from the solution, and near it.
const COARSE_STEP: f64 = 2e-2;

pub(super) const FINE_STEP: f64 = 1e-7;

/// Where a refinement ended: cost, place, the monitor runs spent, and whether a budget cut it short.
#[derive(Clone, Copy, Debug)]
pub(super) struct End {
    pub(super) cost: f64,
    pub(super) at: Coordinates,
    pub(super) spent: u64,
    pub(super) cut: bool,
}

/// Monitor runs that no descent reaches.
pub(super) const UNLIMITED: u64 = u64::MAX;

/// Refines from several starts, side by side, each with `budget` monitor runs at most; the ends, the best first.
///
/// Each start is refined with coarse differences and then with fine ones: what a fine slope takes for a valley's floor, a
/// coarse one often walks out of.
pub(super) fn refine(comparison: &Comparison<'_>, starts: &[Coordinates], budget: u64) -> Vec<End> {
    let mut ends: Vec<End> = starts
        .par_iter()
        .map(|&start| descend(comparison, start, budget))
        .collect();
    // Of equal ends the first, whichever thread was quicker.
    ends.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    ends
}

/// Loads next to none, in their coordinate: in the bend of the gear's losses, and clear of it.
const NO_LOAD: [f64; 2] = [1e-6, 1e-12];

/// One descent, coarse and then fine; the better of both ends. With a budget too small for one step, the start itself.
pub(super) fn descend(comparison: &Comparison<'_>, start: Coordinates, budget: u64) -> End {
    let mut end = End {
        cost: f64::INFINITY,
        at: start,
        spent: 0,
        cut: false,
    };
    for step in [COARSE_STEP, FINE_STEP] {
        let whole = box_of(Coordinates::LOWER, Coordinates::UPPER);
        go_on(comparison, &mut end, step, &whole, budget);
    }
    if end.cost.is_infinite() {
        end.cost = comparison.cost(&end.at);
        end.spent += 1;
    }
    end
}

/// A descent, and from an end at zero load a fine one that stays on the side of opposing loads.
///
/// The gear's losses bend there, and a descent across the bend gets stuck in it, short of the valley that leads along it. On
/// one side the problem is smooth.
pub(super) fn polish(comparison: &Comparison<'_>, start: Coordinates, budget: u64) -> End {
    let mut end = descend(comparison, start, budget);
    let [in_the_bend, clear_of_it] = NO_LOAD;
    if end.at.0[LOAD_COORDINATE].abs() <= in_the_bend {
        let mut lower = Coordinates::LOWER;
        lower[LOAD_COORDINATE] = clear_of_it;
        let opposing = box_of(lower, Coordinates::UPPER);
        go_on(comparison, &mut end, FINE_STEP, &opposing, budget);
    }
    end
}

/// A coarse descent with one coordinate held at a value.
pub(super) fn pinned(
    comparison: &Comparison<'_>,
    start: &Coordinates,
    coordinate: usize,
    value: f64,
    budget: u64,
) -> End {
    let (mut lower, mut upper) = (Coordinates::LOWER, Coordinates::UPPER);
    // A box must have an inside.
    (lower[coordinate], upper[coordinate]) = (value - PIN, value + PIN);
    let mut end = End {
        cost: f64::INFINITY,
        at: *start,
        spent: 0,
        cut: false,
    };
    end.at.0[coordinate] = value;
    go_on(comparison, &mut end, COARSE_STEP, &box_of(lower, upper), budget);
    end
}

/// Half the width of the box around a coordinate that is held.
const PIN: f64 = 1e-9;

/// Goes on from an end, with one step of the differences and inside a box.
fn go_on(comparison: &Comparison<'_>, end: &mut End, step: f64, bounds: &Bounds<UNKNOWN_COUNT>, budget: u64) {
    let left = budget.saturating_sub(end.spent);
    let iterations = (left / (RUNS_PER_LINEARISATION + TRIALS_PER_STEP)).min(u64::from(MAX_ITERATIONS)) as u32;
    let trials = left.saturating_sub(u64::from(iterations) * (RUNS_PER_LINEARISATION - 1));
    let limited = iterations < MAX_ITERATIONS || trials < u64::from(MAX_EVALUATIONS);
    if iterations == 0 {
        end.cut = true;
        return;
    }
    let config = LmConfig {
        max_iterations: iterations,
        max_evaluations: trials.min(u64::from(MAX_EVALUATIONS)) as u32,
        step_tolerance: 1e-9,
        cost_tolerance: 1e-6,
        ..LmConfig::default()
    };
    let found = levenberg_marquardt(&Refinement { comparison, step }, bounds, end.at.0, &config);
    end.spent += u64::from(found.iterations) * RUNS_PER_LINEARISATION + u64::from(found.evaluations - found.iterations);
    end.cut |= limited && matches!(found.stop, LmStop::MaxIterations | LmStop::MaxEvaluations);
    if found.cost < end.cost {
        (end.cost, end.at) = (found.cost, Coordinates(found.genes));
    }
}

/// Linearisations, and those and trials together, of one descent with one step at most.
const MAX_ITERATIONS: u32 = 25;
const MAX_EVALUATIONS: u32 = 60;

/// Trials that a step takes as a rule.
const TRIALS_PER_STEP: u64 = 2;

/// Where a refinement that starts at a point ends.
#[must_use]
pub fn refine_from(comparison: &Comparison<'_>, start: Coordinates) -> Coordinates {
    polish(comparison, start, UNLIMITED).at
}

/// Distance from the truth, in fault coordinates, to where a refinement started there ends: the pull of whatever the
/// monitor gets wrong.
#[must_use]
pub fn pull_from(comparison: &Comparison<'_>, truth: &FaultVector) -> [f64; FAULT_COUNT] {
    let start = Scale::new(comparison.params).coordinates(&comparison.unknowns_with_fault(*truth));
    let end = descend(comparison, start, UNLIMITED).at;
    std::array::from_fn(|p| end.0[p] - start.0[p])
}

/// Cramér–Rao bound of each coordinate at a point, as a standard deviation: what the weights alone allow, with no model
/// error.
#[must_use]
pub fn bound(comparison: &Comparison<'_>, at: &Coordinates) -> [f64; UNKNOWN_COUNT] {
    let normal = comparison
        .normal_equations(at, FINE_STEP)
        .with_known_motor_fixed(&comparison.prior.motor);
    data_variance(&normal, 1.0).map(f64::sqrt)
}

/// Diagonal of `(JᵀJ)⁻¹`, times `scale`; infinite where the data say nothing.
pub(super) fn data_variance(normal: &NormalEquations, scale: f64) -> [f64; UNKNOWN_COUNT] {
    let mut matrix = SMatrix::<f64, UNKNOWN_COUNT, UNKNOWN_COUNT>::from_fn(|r, c| normal.jtj[r][c]);
    for p in 0..UNKNOWN_COUNT {
        // A coordinate without influence gets a vanishing information, so that the others can be inverted.
        matrix[(p, p)] += 1e-9;
    }
    match matrix.cholesky() {
        Some(factor) => {
            let inverse = factor.inverse();
            std::array::from_fn(|p| scale * inverse[(p, p)])
        }
        None => [f64::INFINITY; UNKNOWN_COUNT],
    }
}

struct Refinement<'a, 'b> {
    comparison: &'a Comparison<'b>,
    step: f64,
}

impl Residuals<UNKNOWN_COUNT> for Refinement<'_, '_> {
    fn normal_equations(
        &self,
        genes: &[f64; UNKNOWN_COUNT],
        jtj: &mut SMatrix<f64, UNKNOWN_COUNT, UNKNOWN_COUNT>,
        jtr: &mut SVector<f64, UNKNOWN_COUNT>,
    ) -> f64 {
        let normal = self
            .comparison
            .normal_equations(&Coordinates(*genes), self.step)
            .with_known_motor_fixed(&self.comparison.prior.motor);
        for p in 0..UNKNOWN_COUNT {
            jtr[p] = normal.jtr[p];
            for q in 0..UNKNOWN_COUNT {
                jtj[(p, q)] = normal.jtj[p][q];
            }
        }
        normal.cost
    }

    fn cost(&self, genes: &[f64; UNKNOWN_COUNT]) -> f64 {
        self.comparison.cost(&Coordinates(*genes))
    }

    fn project(&self, genes: &mut [f64; UNKNOWN_COUNT]) {
        *genes = Coordinates(*genes).projected_to_unit_disc().0;
    }

    const SIDE_BY_SIDE: usize = COST_LANES;

    fn costs(&self, points: &[[f64; UNKNOWN_COUNT]], costs: &mut [f64]) {
        // Lanes that few points leave over run the first again.
        let of = |lane: usize| {
            points
                .get(lane)
                .or(points.first())
                .copied()
                .unwrap_or([0.0; UNKNOWN_COUNT])
        };
        let all = self
            .comparison
            .costs(&std::array::from_fn(|lane| Coordinates(of(lane))));
        for (slot, cost) in costs.iter_mut().zip(all) {
            *slot = cost;
        }
    }
}
