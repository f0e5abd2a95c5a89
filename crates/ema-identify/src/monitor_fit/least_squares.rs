//! Levenberg–Marquardt descents on the residuals of all signals: from a start to a local optimum of the cost.

use ema_ga::{Bounds, LmConfig, LmStop, Residuals, levenberg_marquardt};
use ema_models::{Coordinates, FAULT_COUNT, FaultVector, LOAD_COORDINATE, Scale, UNKNOWN_COUNT, Unknowns};
use nalgebra::{SMatrix, SVector};

use super::variance::variance;
use super::window::MonitoredWindow;
use crate::relations::ByTypeBalance;

/// Loads from which descents start where the load is not measured, in shares of the largest: the gear's losses bend at
/// zero, so both sides are tried.
const LOAD_STARTS: [f64; 2] = [-0.01, 0.01];

/// Fault vectors that descents start from at most: the best of a population, and health.
const MAX_START_FAULTS: usize = 2;

/// Starts at most.
pub(crate) const MAX_STARTS: usize = MAX_START_FAULTS * LOAD_STARTS.len();

/// Starts of descents.
pub(crate) type Starts = heapless::Vec<Coordinates, MAX_STARTS>;

/// Where descents start: each fault vector, with the load as measured or else on both sides of none.
pub(crate) fn starts(window: &impl MonitoredWindow, faults: &[FaultVector]) -> Starts {
    let scale = Scale::new(window.params());
    let mut starts = Starts::new();
    for &fault in faults.iter().take(MAX_START_FAULTS) {
        let unknowns = window.unknowns_with(fault);
        match window.conditions().load_torque {
            Some(_) => starts.extend([scale.coordinates(&unknowns)]),
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

/// Step of the finite differences far from the solution.
const COARSE_STEP: f64 = 2e-2;

/// Step of the finite differences near the solution.
pub(super) const FINE_STEP: f64 = 1e-7;

/// How a descent goes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Descent {
    /// Steps of the finite differences, one after another.
    steps: &'static [f64],
    /// Damping of the first step.
    damping: f64,
    /// Decrease of the cost, as a share of it, by which no further step follows.
    cost_tolerance: f64,
    /// The same of a decrease that is expected.
    expected_tolerance: f64,
    /// The same of a decrease that was expected of a step which raised the cost.
    rejected_tolerance: f64,
}

/// Damping of a first step; near the end, where the problem is nearly linear, less.
const DAMPING: f64 = 1e-3;
const DAMPING_NEARBY: f64 = 1e-6;

impl Descent {
    /// To the floor of a valley: what a fine slope takes for it, a coarse one often walks out of.
    pub(crate) const TO_THE_FLOOR: Self = Self {
        steps: &[COARSE_STEP, FINE_STEP],
        damping: DAMPING,
        cost_tolerance: 1e-6,
        expected_tolerance: 1e-6,
        rejected_tolerance: 0.0,
    };

    /// Into the next valley, to where another descent starts: most of the cost that is left is of what coarse time or nuisances explain.
    pub(crate) const INTO_A_VALLEY: Self = Self {
        steps: &[COARSE_STEP],
        damping: DAMPING,
        cost_tolerance: 1e-3,
        expected_tolerance: 1e-3,
        rejected_tolerance: 0.0,
    };

    /// To where another explanation has nearly its cost: what is asked is whether it differs by a few.
    pub(crate) const TO_COMPARE: Self = Self {
        cost_tolerance: 1e-4,
        expected_tolerance: 1e-4,
        ..Self::TO_THE_FLOOR
    };

    /// To a floor nearby. Costs are halves of squares in standard deviations, a few thousand in all: one sigma is half a unit.
    pub(crate) const NEARBY: Self = Self {
        steps: &[FINE_STEP],
        damping: DAMPING_NEARBY,
        cost_tolerance: 1e-4,
        expected_tolerance: 1e-4,
        rejected_tolerance: ROUGHNESS,
    };

    /// Close to a floor: to where another descent starts, with other weights or with nuisances, or to whether there is one at all.
    pub(crate) const CLOSE_TO_A_FLOOR: Self = Self {
        steps: &[FINE_STEP],
        damping: DAMPING,
        cost_tolerance: 0.03,
        expected_tolerance: 1e-3,
        rejected_tolerance: ROUGHNESS,
    };
}

/// Share of the cost that derivatives of coarse time promise in vain: what they promise less than this may be nothing.
const ROUGHNESS: f64 = 3e-3;

#[cfg(feature = "std")]
impl Descent {
    /// As far as without nuisances, which lower the cost further and start from there.
    pub(crate) const WITHOUT_NUISANCES: Self = Self {
        cost_tolerance: 1e-6,
        expected_tolerance: 0.0,
        ..Self::INTO_A_VALLEY
    };

    /// Monitor runs at most.
    pub(crate) fn most_runs(&self) -> u64 {
        self.steps.len() as u64 * RUNS_OF_DESCENT
    }
}

/// Where a descent ended.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LocalOptimum {
    pub(crate) cost: f64,
    pub(crate) at: Coordinates,
    /// Monitor runs spent.
    pub(crate) spent: u64,
    /// Whether a budget of monitor runs cut the descent short.
    pub(crate) cut: bool,
    /// [Variance](super::variance::variance) of each coordinate by the last linearisation, at most one small step away.
    pub(crate) variance: Option<[f64; UNKNOWN_COUNT]>,
}

/// Local optima, the best first; of equal ones the one of the earlier start.
pub(crate) type LocalOptima = heapless::Vec<LocalOptimum, MAX_STARTS>;

/// Puts local optima, given in the order of their starts, in the order of their costs.
pub(crate) fn best_first(optima: impl IntoIterator<Item = LocalOptimum>) -> LocalOptima {
    let mut sorted = LocalOptima::new();
    for optimum in optima {
        let is_better = |other: &LocalOptimum| optimum.cost.total_cmp(&other.cost).is_lt();
        let place = sorted.iter().position(is_better).unwrap_or(sorted.len());
        let inserted = sorted.insert(place, optimum);
        debug_assert!(inserted.is_ok(), "as many optima as starts");
    }
    sorted
}

/// Monitor runs that no descent reaches.
pub(crate) const UNLIMITED: u64 = u64::MAX;

/// Monitor runs of one set of normal equations: the point and one step along each coordinate.
pub(super) const RUNS_PER_LINEARISATION: u64 = UNKNOWN_COUNT as u64 + 1;

/// Where a descent starts by the torque balance of the type.
pub(crate) fn start_by_balance(window: &impl MonitoredWindow, found: &ByTypeBalance) -> Coordinates {
    let measured = window.unknowns_with(found.fault);
    let is_measured = window.conditions().load_torque.is_some();
    let unknowns = Unknowns {
        load_torque: if is_measured {
            measured.load_torque
        } else {
            found.load_torque
        },
        ..measured
    };
    Scale::new(window.params()).coordinates(&unknowns)
}

/// One descent from each start, one after another, each with `budget` monitor runs at most.
pub(crate) fn descend_from_each(
    window: &impl MonitoredWindow,
    starts: &Starts,
    how: Descent,
    budget: u64,
) -> LocalOptima {
    best_first(starts.iter().map(|&start| how.descend(window, start, budget)))
}

/// Descents from each start on several threads, the same result on any number of them.
#[cfg(feature = "std")]
pub(crate) fn descend_side_by_side(
    window: &(impl MonitoredWindow + Sync),
    starts: &Starts,
    how: Descent,
    budget: u64,
) -> LocalOptima {
    use rayon::prelude::*;
    let descend = |&start| how.descend(window, start, budget);
    best_first(starts.par_iter().map(descend).collect::<std::vec::Vec<_>>())
}

/// One descent to the floor of a valley.
pub(super) fn descend(window: &impl MonitoredWindow, start: Coordinates, budget: u64) -> LocalOptimum {
    Descent::TO_THE_FLOOR.descend(window, start, budget)
}

impl Descent {
    /// One descent by each step of the finite differences in turn; the best of the ends. With a budget too small for one step, the
    /// start itself.
    #[inline(never)]
    pub(super) fn descend(&self, window: &impl MonitoredWindow, start: Coordinates, budget: u64) -> LocalOptimum {
        let mut optimum = LocalOptimum {
            cost: f64::INFINITY,
            at: start,
            spent: 0,
            cut: false,
            variance: None,
        };
        let whole = constant_box(Coordinates::LOWER, Coordinates::UPPER);
        for &step in self.steps {
            self.resume(window, &mut optimum, step, &whole, budget);
        }
        if optimum.cost.is_infinite() {
            optimum.cost = window.cost(&optimum.at);
            optimum.spent += 1;
        }
        optimum
    }
}

/// Loads next to none, in their coordinate: in the bend of the gear's losses, and clear of it.
const NO_LOAD: [f64; 2] = [1e-6, 1e-12];

/// A descent, and from an optimum at zero load a fine one that stays on the side of opposing loads.
///
/// The gear's losses bend there, and a descent across the bend gets stuck in it, short of the valley that leads along it. On
/// one side the problem is smooth.
pub(super) fn refine_one_sided(
    window: &impl MonitoredWindow,
    start: Coordinates,
    how: Descent,
    budget: u64,
) -> LocalOptimum {
    let mut optimum = how.descend(window, start, budget);
    let [in_the_bend, clear_of_it] = NO_LOAD;
    if optimum.at.0[LOAD_COORDINATE].abs() <= in_the_bend {
        let mut lower = Coordinates::LOWER;
        lower[LOAD_COORDINATE] = clear_of_it;
        let opposing = constant_box(lower, Coordinates::UPPER);
        Descent::TO_THE_FLOOR.resume(window, &mut optimum, FINE_STEP, &opposing, budget);
    }
    optimum
}

/// A coarse descent with one coordinate held at a value.
pub(super) fn refine_with_fixed_parameter(
    window: &impl MonitoredWindow,
    start: &Coordinates,
    coordinate: usize,
    value: f64,
    budget: u64,
) -> LocalOptimum {
    let (mut lower, mut upper) = (Coordinates::LOWER, Coordinates::UPPER);
    // A box must have an inside.
    (lower[coordinate], upper[coordinate]) = (value - FIXED_WITHIN, value + FIXED_WITHIN);
    let mut optimum = LocalOptimum {
        cost: f64::INFINITY,
        at: *start,
        spent: 0,
        cut: false,
        variance: None,
    };
    optimum.at.0[coordinate] = value;
    let within = constant_box(lower, upper);
    Descent::TO_COMPARE.resume(window, &mut optimum, COARSE_STEP, &within, budget);
    optimum
}

/// Half the width of the box around a coordinate that is held.
const FIXED_WITHIN: f64 = 1e-9;

impl Descent {
    /// Resumes a descent where it ended, inside a box, with one step of the differences.
    #[inline(never)]
    fn resume<W: MonitoredWindow>(
        &self,
        window: &W,
        optimum: &mut LocalOptimum,
        step: f64,
        bounds: &Bounds<UNKNOWN_COUNT>,
        budget: u64,
    ) {
        let left = budget.saturating_sub(optimum.spent);
        let iterations = (left / (RUNS_PER_LINEARISATION + TRIALS_PER_STEP)).min(u64::from(MAX_ITERATIONS)) as u32;
        let trials = left.saturating_sub(u64::from(iterations) * (RUNS_PER_LINEARISATION - 1));
        let limited = iterations < MAX_ITERATIONS || trials < u64::from(MAX_EVALUATIONS);
        if iterations == 0 {
            optimum.cut = true;
            return;
        }
        let config = LmConfig {
            max_iterations: iterations,
            max_evaluations: trials.min(u64::from(MAX_EVALUATIONS)) as u32,
            initial_damping: self.damping,
            step_tolerance: 1e-9,
            cost_tolerance: self.cost_tolerance,
            expected_tolerance: self.expected_tolerance,
            rejected_tolerance: self.rejected_tolerance,
            ..LmConfig::default()
        };
        let found = levenberg_marquardt(&SquaredResiduals { window, step }, bounds, optimum.at.0, &config);
        optimum.spent +=
            u64::from(found.iterations) * RUNS_PER_LINEARISATION + u64::from(found.evaluations - found.iterations);
        optimum.cut |= limited && matches!(found.stop, LmStop::MaxIterations | LmStop::MaxEvaluations);
        if found.cost < optimum.cost {
            (optimum.cost, optimum.at) = (found.cost, Coordinates(found.genes));
            optimum.variance = Some(variance(&found.information));
        }
    }
}

/// Linearisations at most of one descent with one step.
const MAX_ITERATIONS: u32 = 25;

/// Linearisations and trials together at most of one descent with one step.
const MAX_EVALUATIONS: u32 = 60;

/// Monitor runs at most of one descent with one step.
#[cfg(feature = "std")]
pub(crate) const RUNS_OF_DESCENT: u64 =
    MAX_ITERATIONS as u64 * RUNS_PER_LINEARISATION + (MAX_EVALUATIONS - MAX_ITERATIONS) as u64;

/// Monitor runs of one linearisation and its trials.
#[cfg(feature = "std")]
pub(crate) const RUNS_OF_STEP: u64 = RUNS_PER_LINEARISATION + TRIALS_PER_STEP;

/// Trials that a step takes as a rule.
const TRIALS_PER_STEP: u64 = 2;

/// The local optimum that a descent from a point leads to.
#[must_use]
pub fn refined_from(window: &impl MonitoredWindow, start: Coordinates) -> Coordinates {
    refine_one_sided(window, start, Descent::TO_THE_FLOOR, UNLIMITED).at
}

/// Estimator bias of one window: distance, in fault coordinates, from the truth to where a descent that starts there ends.
/// The monitor's own mismatch causes it.
#[must_use]
pub fn estimator_bias(window: &impl MonitoredWindow, truth: &FaultVector) -> [f64; FAULT_COUNT] {
    let start = Scale::new(window.params()).coordinates(&window.unknowns_with(*truth));
    let end = descend(window, start, UNLIMITED).at;
    core::array::from_fn(|p| end.0[p] - start.0[p])
}

/// A box whose corners are constants of the program.
pub(super) fn constant_box<const D: usize>(lower: [f64; D], upper: [f64; D]) -> Bounds<D> {
    #[expect(clippy::expect_used, reason = "the bounds are constants of the program")]
    Bounds::new(lower, upper).expect("constant bounds ascend")
}

/// The window's residuals as the minimiser asks for them, with one step of the finite differences.
struct SquaredResiduals<'a, W> {
    window: &'a W,
    step: f64,
}

impl<W: MonitoredWindow> Residuals<UNKNOWN_COUNT> for SquaredResiduals<'_, W> {
    fn normal_equations(
        &self,
        genes: &[f64; UNKNOWN_COUNT],
        jtj: &mut SMatrix<f64, UNKNOWN_COUNT, UNKNOWN_COUNT>,
        jtr: &mut SVector<f64, UNKNOWN_COUNT>,
    ) -> f64 {
        let mut normal = self.window.normal_equations(&Coordinates(*genes), self.step);
        normal.fix_known_motor(&self.window.prior().motor);
        for p in 0..UNKNOWN_COUNT {
            jtr[p] = normal.jtr[p];
            for q in 0..UNKNOWN_COUNT {
                jtj[(p, q)] = normal.jtj[p][q];
            }
        }
        normal.cost
    }

    fn cost(&self, genes: &[f64; UNKNOWN_COUNT]) -> f64 {
        self.window.cost(&Coordinates(*genes))
    }

    fn project(&self, genes: &mut [f64; UNKNOWN_COUNT]) {
        *genes = Coordinates(*genes).projected_to_unit_disc().0;
    }

    const SIDE_BY_SIDE: usize = W::SIDE_BY_SIDE;

    fn costs(&self, points: &[[f64; UNKNOWN_COUNT]], costs: &mut [f64]) {
        self.window.costs(points, costs);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn optima_are_sorted_by_cost_and_equal_ones_by_their_starts() {
        let optimum = |cost, spent| LocalOptimum {
            cost,
            at: Coordinates([0.0; UNKNOWN_COUNT]),
            spent,
            cut: false,
            variance: None,
        };
        let given = [optimum(2.0, 0), optimum(f64::NAN, 1), optimum(1.0, 2), optimum(2.0, 3)];
        let order = best_first(given)
            .iter()
            .map(|found| found.spent)
            .collect::<heapless::Vec<_, 4>>();
        assert_eq!(order, [2, 0, 3, 1]);
    }
}
