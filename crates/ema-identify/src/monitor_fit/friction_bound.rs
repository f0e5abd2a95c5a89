//! Profile-likelihood bound on friction, where local curvature is unreliable.
//!
//! Where nothing but the instant of breaking away distinguishes friction from a load that nobody measures, the cost along k1
//! is flat, with dips much narrower than what the noise leaves open. A search ends in one of them, and its curvature says
//! nothing of the whole. The cost of a value well off, with all other unknowns adjusted to it, does.

use ema_models::Coordinates;

use super::least_squares::refine_with_fixed_parameter;
use super::window::MonitoredWindow;
use crate::estimate::OBSERVABLE_SIGMA;

/// Place of the friction among the coordinates.
const FRICTION: usize = 0;

/// Up to this the curvature is used: only a shaft that turns both ways shows friction so well, and there the cost has no
/// dips.
const CURVATURE_SUFFICIENT: f64 = 0.005;

/// How far off the other value is: twice what a window that shows friction may leave open.
const PROBE_DISTANCE: f64 = 2.0 * OBSERVABLE_SIGMA;

/// Standard deviation of the friction with its cost in monitor runs.
pub(super) struct FrictionBound {
    pub(super) sigma: f64,
    /// Monitor runs spent.
    pub(super) spent: u64,
    /// Whether the budget of monitor runs ended the computation.
    pub(super) cut: bool,
}

/// Standard deviation of the friction at an optimum: the one by curvature, or the one by which the costs `PROBE_DISTANCE` to
/// either side rise (`σ = Δk / √(2 Δcost / excess)`), whichever is larger. At least: a coarse descent ends a little above the
/// valley's floor. Infinite where it comes to no end within `budget` monitor runs.
pub(super) fn friction_bound(
    window: &impl MonitoredWindow,
    at: &Coordinates,
    cost: f64,
    by_curvature: f64,
    excess: f64,
    budget: u64,
) -> FrictionBound {
    let mut bound = FrictionBound {
        sigma: by_curvature,
        spent: 0,
        cut: false,
    };
    // A sigma that is no number is left as it is, too.
    let open = by_curvature > CURVATURE_SUFFICIENT && by_curvature <= OBSERVABLE_SIGMA;
    if !open {
        return bound;
    }
    // First to where there is more room.
    let middle = 0.5 * (Coordinates::LOWER[FRICTION] + Coordinates::UPPER[FRICTION]);
    let inwards = PROBE_DISTANCE.copysign(middle - at.0[FRICTION]);
    for reach in [inwards, -inwards] {
        let there = (at.0[FRICTION] + reach).clamp(Coordinates::LOWER[FRICTION], Coordinates::UPPER[FRICTION]);
        let off = (there - at.0[FRICTION]).abs();
        // Beside a limit there is no other side; and the second side adds nothing if the first shows too little already.
        if off < 0.5 * PROBE_DISTANCE || bound.sigma > OBSERVABLE_SIGMA {
            continue;
        }
        let left = budget.saturating_sub(bound.spent);
        let optimum = refine_with_fixed_parameter(window, at, FRICTION, there, left);
        bound.spent += optimum.spent;
        bound.cut |= optimum.cut;
        let known = !optimum.cut && optimum.cost.is_finite();
        let rise = if known { (optimum.cost - cost).max(0.0) } else { 0.0 };
        bound.sigma = bound.sigma.max(off / libm::sqrt(2.0 * rise / excess));
    }
    bound
}
