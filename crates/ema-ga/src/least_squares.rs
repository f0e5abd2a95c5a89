//! Bounded Levenberg-Marquardt: refines a point near the solution of a nonlinear least-squares problem.

use nalgebra::{Cholesky, SMatrix, SVector};

use crate::problem::Bounds;

/// A sum of squares `0.5 sum r^2`, given by its normal equations.
///
/// The implementation accumulates `J^T J` over its samples, so no residual vector is stored.
pub trait Residuals<const D: usize> {
    /// Writes `J^T J` and `J^T r`, with `J = dr/dgenes`, and returns the cost `0.5 sum r^2`.
    ///
    /// Both are zero on entry. Derivatives may be finite differences, which must point into the box at a bound.
    fn normal_equations(&self, genes: &[f64; D], jtj: &mut SMatrix<f64, D, D>, jtr: &mut SVector<f64, D>) -> f64;

    /// The cost alone. It equals that of [`Residuals::normal_equations`] up to far less than [`LmConfig::cost_tolerance`].
    fn cost(&self, genes: &[f64; D]) -> f64;

    /// Projects a point of the box into the domain of the problem, where that is smaller than the box.
    ///
    /// The cost of both points must be the same. By default the domain is the box.
    fn project(&self, _genes: &mut [f64; D]) {}

    /// Number of points whose costs [`Residuals::costs`] computes in about the time of one; 1 without such an evaluation.
    const SIDE_BY_SIDE: usize = 1;

    /// Costs of at most [`Residuals::SIDE_BY_SIDE`] points, the same bits as from [`Residuals::cost`].
    fn costs(&self, points: &[[f64; D]], costs: &mut [f64]) {
        for (point, cost) in points.iter().zip(costs) {
            *cost = self.cost(point);
        }
    }
}

/// Settings of [`levenberg_marquardt`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LmConfig {
    /// Largest number of linearisations.
    pub max_iterations: u32,
    /// Largest number of calls of [`Residuals::normal_equations`] and [`Residuals::cost`] together; at least 1.
    pub max_evaluations: u32,
    /// Damping of the first step. Along a valley, steps are short until it has fallen below the share of the curvature that
    /// the valley's floor has; near the solution of a problem that is nearly linear it can begin there.
    pub initial_damping: f64,
    /// Converged when, for every free gene, the cosine between its column of `J` and `r` is at most this.
    pub gradient_tolerance: f64,
    /// Converged when a step changes no gene by more than this, relative to the width of the box.
    pub step_tolerance: f64,
    /// Converged when an accepted step lowers the cost by at most this share of the cost.
    pub cost_tolerance: f64,
    /// Converged when the model expects of the next step less than this share of the cost; its cost is then not computed. Where costs are
    /// dear it spares a row of rejected steps at the resolution of the derivatives. 0: never.
    pub expected_tolerance: f64,
    /// Converged when a step is rejected of which the model expected at most this share of the cost: it is at the resolution of the
    /// derivatives, or of the costs. 0: never.
    pub rejected_tolerance: f64,
}

impl Default for LmConfig {
    /// 50 iterations, 200 evaluations, damping from 1e-3, tolerances of 1e-10, of the expected decrease, and of that of a rejected step, 0.
    fn default() -> Self {
        Self {
            max_iterations: 50,
            max_evaluations: 200,
            initial_damping: 1e-3,
            gradient_tolerance: 1e-10,
            step_tolerance: 1e-10,
            cost_tolerance: 1e-10,
            expected_tolerance: 0.0,
            rejected_tolerance: 0.0,
        }
    }
}

/// Why Levenberg-Marquardt ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LmStop {
    /// The gradient vanishes in every gene that is not held at its bound; this includes a perfect fit.
    Gradient,
    /// The step became negligible: no lower cost is found at this resolution.
    Step,
    /// The last step lowered the cost by no more than the tolerance, and the derivatives at the returned point are not computed; or the
    /// model expected less of the next one, or little more of one that was rejected.
    Cost,
    /// The search reached the largest number of linearisations.
    MaxIterations,
    /// The evaluation budget is used up.
    MaxEvaluations,
    /// The cost, or a derivative that was computed, is not finite at the returned point.
    NotFinite,
}

/// Result of Levenberg-Marquardt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LmOutcome<const D: usize> {
    /// Best point, inside the box.
    pub genes: [f64; D],
    /// Its cost `0.5 sum r^2`, never above the cost of the start.
    pub cost: f64,
    /// `J^T J` of the last linearisation: at the best point, or one step before it.
    pub information: SMatrix<f64, D, D>,
    /// Number of linearisations.
    pub iterations: u32,
    /// Calls of [`Residuals::normal_equations`] and [`Residuals::cost`] together.
    pub evaluations: u32,
    /// Why it ended.
    pub stop: LmStop,
}

/// Minimises a sum of squares over a box, from `start`, which is clamped into the box.
///
/// 1. Linearise: `J^T J`, `g = J^T r` and the cost.
/// 2. Freeze the genes at a bound along which the cost falls only towards the outside; test the gradient of the others.
/// 3. Solve `(J^T J + lambda diag(J^T J)) d = -g` for the free genes. A gene whose step leaves the box is set to its bound,
///    and the others are solved again, so that `d` stays in the box.
/// 4. The gain ratio is (cost decrease) / (decrease of the quadratic model, `-(g^T d + 0.5 d^T J^T J d)`).
///    A step of which the model expects less than `expected_tolerance` of the cost ends the search.
/// 5. If the gain ratio is above zero, the step is accepted and `lambda` is multiplied by `max(1/3, 1 - (2 gain - 1)^3)`. The
///    search ends if the cost fell by no more than `cost_tolerance`, and else continues with 1. If the gain ratio is not
///    above zero, or the cost is not finite, `lambda` is multiplied by 2, 4, 8, ..., and 3 is repeated, unless the model expected
///    at most `rejected_tolerance` of the cost.
///
/// If [`Residuals::SIDE_BY_SIDE`] is above 1, the first rejection computes the costs of the following trials at once. This
/// changes neither the result nor the count of evaluations, which omits the costs that are not used.
///
/// Source of the damping rule: H. B. Nielsen, "Damping parameter in Marquardt's method", IMM-REP-1999-05, DTU.
///
/// ```
/// use ema_ga::{Bounds, LmConfig, LmStop, Residuals, levenberg_marquardt};
/// use nalgebra::{SMatrix, SVector};
///
/// /// One residual, `r = x - 3`.
/// struct Distance;
/// impl Residuals<1> for Distance {
///     fn normal_equations(&self, x: &[f64; 1], jtj: &mut SMatrix<f64, 1, 1>, jtr: &mut SVector<f64, 1>) -> f64 {
///         jtj[(0, 0)] = 1.0;
///         jtr[0] = x[0] - 3.0;
///         self.cost(x)
///     }
///     fn cost(&self, x: &[f64; 1]) -> f64 {
///         0.5 * (x[0] - 3.0) * (x[0] - 3.0)
///     }
/// }
///
/// let found = levenberg_marquardt(&Distance, &Bounds::new([0.0], [2.0])?, [0.5], &LmConfig::default());
/// assert_eq!((found.genes, found.cost, found.stop), ([2.0], 0.5, LmStop::Gradient)); // ends at the bound
/// # Ok::<(), ema_ga::BoundsError>(())
/// ```
pub fn levenberg_marquardt<const D: usize>(
    residuals: &impl Residuals<D>,
    bounds: &Bounds<D>,
    start: [f64; D],
    config: &LmConfig,
) -> LmOutcome<D> {
    let mut at = LmOutcome {
        genes: bounds.clamp(start),
        cost: f64::INFINITY,
        information: SMatrix::zeros(),
        iterations: 0,
        evaluations: 0,
        stop: LmStop::MaxEvaluations,
    };
    let (mut damping, mut growth) = (config.initial_damping, 2.0);
    loop {
        if at.evaluations >= config.max_evaluations {
            return at.ended(LmStop::MaxEvaluations);
        }
        let mut gradient = SVector::zeros();
        at.information.fill(0.0);
        let cost = residuals.normal_equations(&at.genes, &mut at.information, &mut gradient);
        let model = Model {
            jtj: &at.information,
            gradient,
        };
        at.iterations += 1;
        at.evaluations += 1;
        if !(cost.is_finite() && model.is_finite()) {
            return at.ended(LmStop::NotFinite);
        }
        at.cost = cost;
        let frozen = model.pushed_outwards(&at.genes, bounds);
        if model.is_stationary(&frozen, cost, config.gradient_tolerance) {
            return at.ended(LmStop::Gradient);
        }
        if at.iterations >= config.max_iterations {
            return at.ended(LmStop::MaxIterations);
        }

        let mut ahead = Ahead::default();
        loop {
            if at.evaluations >= config.max_evaluations {
                return at.ended(LmStop::MaxEvaluations);
            }
            if damping > MAX_DAMPING {
                return at.ended(LmStop::Step);
            }
            let next = |damping| {
                let mut trial = model.trial(&at.genes, bounds, frozen, damping)?;
                residuals.project(&mut trial);
                Some(trial)
            };
            if let Some(trial) = next(damping) {
                if (0..D).all(|i| (trial[i] - at.genes[i]).abs() <= config.step_tolerance * bounds.width(i)) {
                    return at.ended(LmStop::Step);
                }
                let expected = model.decrease(&at.genes, &trial);
                // A projection can make a step that is expected to gain nothing: that one is damped, not the end.
                let expects_less = |share: f64| share > 0.0 && (0.0..share * cost).contains(&expected);
                if expects_less(config.expected_tolerance) {
                    return at.ended(LmStop::Cost);
                }
                let trial_cost = ahead.next_cost().unwrap_or_else(|| residuals.cost(&trial));
                at.evaluations += 1;
                let gain = (cost - trial_cost) / expected;
                if trial_cost < cost && gain > 0.0 {
                    let lead = 2.0 * gain - 1.0;
                    damping *= (1.0 - lead * lead * lead).max(1.0 / 3.0);
                    growth = 2.0;
                    at.genes = trial;
                    at.cost = trial_cost;
                    if cost - trial_cost <= config.cost_tolerance * trial_cost {
                        return at.ended(LmStop::Cost);
                    }
                    break;
                }
                if expects_less(config.rejected_tolerance) {
                    return at.ended(LmStop::Cost);
                }
            }
            damping *= growth;
            growth *= 2.0;
            if ahead.is_used_up() {
                ahead.fill(residuals, |place| {
                    let (mut damping, mut growth) = (damping, growth);
                    for _ in 0..place {
                        damping *= growth;
                        growth *= 2.0;
                    }
                    (damping <= MAX_DAMPING).then(|| next(damping))?
                });
            }
        }
    }
}

impl<const D: usize> LmOutcome<D> {
    fn ended(self, stop: LmStop) -> Self {
        Self { stop, ..self }
    }
}

/// Costs of the following trials, computed at once, under the assumption that each trial before is rejected.
#[derive(Default)]
struct Ahead {
    costs: [f64; MAX_AHEAD],
    next: usize,
    len: usize,
}

/// Largest number of costs computed ahead: damping rises by 2^120 over as many rejections.
const MAX_AHEAD: usize = 16;

impl Ahead {
    fn next_cost(&mut self) -> Option<f64> {
        let cost = *self.costs[..self.len].get(self.next)?;
        self.next += 1;
        Some(cost)
    }

    fn is_used_up(&self) -> bool {
        self.next == self.len
    }

    /// Computes the costs of `trial(0)`, `trial(1)`, ... up to the first that is `None`.
    #[inline(never)]
    fn fill<const D: usize, L: Residuals<D>>(&mut self, residuals: &L, trial: impl Fn(i32) -> Option<[f64; D]>) {
        let most = L::SIDE_BY_SIDE.min(MAX_AHEAD);
        if most < 2 {
            return;
        }
        let mut points = [[0.0; D]; MAX_AHEAD];
        (self.next, self.len) = (0, 0);
        while let Some(point) = (self.len < most).then(|| trial(self.len as i32)).flatten() {
            points[self.len] = point;
            self.len += 1;
        }
        if self.len > 0 {
            residuals.costs(&points[..self.len], &mut self.costs[..self.len]);
        }
    }
}

/// The cost near a point, `cost + g^T d + 0.5 d^T J^T J d`.
struct Model<'a, const D: usize> {
    jtj: &'a SMatrix<f64, D, D>,
    gradient: SVector<f64, D>,
}

impl<const D: usize> Model<'_, D> {
    fn is_finite(&self) -> bool {
        self.jtj
            .iter()
            .chain(self.gradient.iter())
            .all(|value| value.is_finite())
    }

    /// Genes at a bound along which the cost falls only towards the outside of the box.
    fn pushed_outwards(&self, genes: &[f64; D], bounds: &Bounds<D>) -> [bool; D] {
        core::array::from_fn(|i| {
            let slope = self.gradient[i];
            (genes[i] <= bounds.lower()[i] && slope > 0.0) || (genes[i] >= bounds.upper()[i] && slope < 0.0)
        })
    }

    /// Whether `|g_i| <= tolerance |J_i| |r|` for every gene that is not frozen.
    fn is_stationary(&self, frozen: &[bool; D], cost: f64, tolerance: f64) -> bool {
        let flat = |i: usize| self.gradient[i].abs() <= tolerance * libm::sqrt(self.jtj[(i, i)] * 2.0 * cost);
        (0..D).all(|i| frozen[i] || flat(i))
    }

    /// The point of the box that the damped model proposes; `None` when its matrix is not positive definite.
    ///
    /// Not inlined: a controller has no room for its matrices while the residuals are linearised.
    #[inline(never)]
    fn trial(&self, genes: &[f64; D], bounds: &Bounds<D>, mut fixed: [bool; D], damping: f64) -> Option<[f64; D]> {
        // A gene without influence has a zero on the diagonal; the floor keeps the matrix regular.
        let floor = self.jtj.diagonal().max() * f64::EPSILON;
        let mut trial = *genes;
        loop {
            let mut matrix = *self.jtj;
            let mut rhs = -self.gradient;
            for i in 0..D {
                matrix[(i, i)] += damping * self.jtj[(i, i)].max(floor);
            }
            for i in (0..D).filter(|&i| fixed[i]) {
                rhs -= self.jtj.column(i) * (trial[i] - genes[i]);
                matrix.row_mut(i).fill(0.0);
                matrix.column_mut(i).fill(0.0);
                matrix[(i, i)] = 1.0;
            }
            let step = Cholesky::new(matrix)?.solve(&rhs);
            if !step.iter().all(|component| component.is_finite()) {
                return None;
            }
            let mut left_box = false;
            for i in 0..D {
                if fixed[i] {
                    continue;
                }
                let target = genes[i] + step[i];
                trial[i] = target.clamp(bounds.lower()[i], bounds.upper()[i]);
                fixed[i] = target < bounds.lower()[i] || target > bounds.upper()[i];
                left_box |= fixed[i];
            }
            if !left_box {
                return Some(trial);
            }
        }
    }

    /// Decrease of the model's cost from `genes` to `trial`.
    fn decrease(&self, genes: &[f64; D], trial: &[f64; D]) -> f64 {
        let step = SVector::<f64, D>::from_fn(|i, _| trial[i] - genes[i]);
        -(self.gradient.dot(&step) + 0.5 * step.dot(&(self.jtj * step)))
    }
}

/// Steps damped more than this are below the resolution of `f64`.
const MAX_DAMPING: f64 = 1e16;

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's valley, `r = (1 - x, 10 (y - x^2))`; its curvature causes many rejected steps.
    struct Valley<const SIDE_BY_SIDE: usize>;

    impl<const N: usize> Residuals<2> for Valley<N> {
        const SIDE_BY_SIDE: usize = N;

        fn normal_equations(&self, x: &[f64; 2], jtj: &mut SMatrix<f64, 2, 2>, jtr: &mut SVector<f64, 2>) -> f64 {
            let r = SVector::<f64, 2>::new(1.0 - x[0], 10.0 * (x[1] - x[0] * x[0]));
            let j = SMatrix::<f64, 2, 2>::new(-1.0, 0.0, -20.0 * x[0], 10.0);
            (*jtj, *jtr) = (j.transpose() * j, j.transpose() * r);
            self.cost(x)
        }

        fn cost(&self, x: &[f64; 2]) -> f64 {
            let (a, b) = (1.0 - x[0], 10.0 * (x[1] - x[0] * x[0]));
            0.5 * (a * a + b * b)
        }
    }

    #[test]
    fn costs_computed_ahead_do_not_change_the_result() {
        let bounds = Bounds::new([-3.0; 2], [3.0; 2]).unwrap();
        let config = LmConfig::default();
        let one = levenberg_marquardt(&Valley::<1>, &bounds, [-1.9, 2.0], &config);
        assert!(one.evaluations > 2 * one.iterations, "steps are rejected: {one:?}");
        assert_eq!(levenberg_marquardt(&Valley::<3>, &bounds, [-1.9, 2.0], &config), one);
        assert_eq!(levenberg_marquardt(&Valley::<16>, &bounds, [-1.9, 2.0], &config), one);
    }
}
