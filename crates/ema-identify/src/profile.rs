//! How sure friction is where the slopes at the end of a search do not tell.
//!
//! Where nothing but the instant of breaking away tells friction from a load that nobody measures, the cost along k1 is flat, with
//! dips much narrower than what the noise leaves open. A search ends in one of them, and its curvature says nothing of the whole.
//! What a value well off costs, everything else adjusted to it, does.

use ema_models::{Comparison, Coordinates};

use super::OBSERVABLE_SIGMA;
use super::refine::pinned;

/// Place of the friction among the coordinates.
const FRICTION: usize = 0;

/// Up to this the slopes are believed: only a shaft that turns both ways shows friction so well, and there the cost has no dips.
const BELIEVED: f64 = 0.005;

/// How far off the other value is: twice what a window that shows friction may leave open.
const REACH: f64 = 2.0 * OBSERVABLE_SIGMA;

/// What came of it: the standard deviation, the monitor runs that it took, and whether there were too few of them.
pub(super) struct Sure {
    pub(super) sigma: f64,
    pub(super) spent: u64,
    pub(super) cut: bool,
}

/// Standard deviation of the friction at a point of a cost's valley: the one by its slopes, or the one by which the costs `REACH` to
/// either side rise (`σ = Δk / √(2 Δcost / excess)`), whichever is larger. At least: a coarse descent ends a little above the
/// valley's floor. Infinite where it comes to no end within `budget` monitor runs.
pub(super) fn friction(
    comparison: &Comparison<'_>,
    at: &Coordinates,
    cost: f64,
    by_slopes: f64,
    excess: f64,
    budget: u64,
) -> Sure {
    let mut sure = Sure {
        sigma: by_slopes,
        spent: 0,
        cut: false,
    };
    // What is no number is not asked, either.
    let open = by_slopes > BELIEVED && by_slopes <= OBSERVABLE_SIGMA;
    if !open {
        return sure;
    }
    // First to where there is more room.
    let middle = 0.5 * (Coordinates::LOWER[FRICTION] + Coordinates::UPPER[FRICTION]);
    let inwards = REACH.copysign(middle - at.0[FRICTION]);
    for reach in [inwards, -inwards] {
        let there = (at.0[FRICTION] + reach).clamp(Coordinates::LOWER[FRICTION], Coordinates::UPPER[FRICTION]);
        let off = (there - at.0[FRICTION]).abs();
        // Beside a limit there is nothing to ask on its side; nor on the second one if the first shows too little already.
        if off < 0.5 * REACH || sure.sigma > OBSERVABLE_SIGMA {
            continue;
        }
        let end = pinned(comparison, at, FRICTION, there, budget.saturating_sub(sure.spent));
        sure.spent += end.spent;
        sure.cut |= end.cut;
        let known = !end.cut && end.cost.is_finite();
        let rise = if known { (end.cost - cost).max(0.0) } else { 0.0 };
        sure.sigma = sure.sigma.max(off / (2.0 * rise / excess).sqrt());
    }
    sure
}
