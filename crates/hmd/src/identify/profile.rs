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

#[cfg(test)]
mod tests {
    use ema_models::reference::{Actuations, CurrentSensing, Scenario};
    use ema_models::{ActuatorParams, FaultVector, MotorKnowledge, Profile};

    use crate::calibration::{MonitorForm, TypeCalibration};
    use crate::identify::{Estimate, Identifier, Method, Population, RUNS_PER_LINEARISATION};
    use crate::simulated::SimulatedWindow;

    /// Estimate of a window with noise, under a load that nobody measures.
    fn estimate(profile: Profile, seed: u64, method: Method) -> Estimate {
        let params = ActuatorParams::servo28();
        let identifier = Identifier {
            params,
            calibration: TypeCalibration::built_in("servo28", MonitorForm::ThreePhase).unwrap(),
            method,
            motor: MotorKnowledge::default(),
        };
        let worn = FaultVector {
            friction: 0.3,
            ..FaultVector::NOMINAL
        };
        let mut scenario = Scenario {
            actuations: Actuations::single(profile),
            ..Scenario::new(params, worn, seed)
        };
        scenario.load_torque = 0.2;
        scenario.sensing = CurrentSensing {
            quantised: true,
            noise_rms: 0.05,
        };
        let mut window = SimulatedWindow::of(&scenario);
        window.conditions.load_torque = None;
        let found = identifier.identify(&window.prepared, window.conditions, seed);
        found.unwrap()
    }

    #[test]
    fn a_dip_of_the_cost_is_no_knowledge_of_friction() {
        for seed in 0..8 {
            let found = estimate(Profile::Ramp, seed, Method::hybrid());
            assert_eq!(found.sigma[0], None, "ramp {seed}");
            assert!(!found.cut);
        }
        let found = estimate(Profile::Mixed, 0, Method::hybrid());
        assert!(found.sigma[0].is_some_and(|sigma| sigma < 0.02), "{:?}", found.sigma);
    }

    /// A population may end anywhere on a slope, where descents to either side would say nothing of its end.
    #[test]
    fn a_population_alone_goes_by_slopes() {
        let Method::Hybrid(population) = Method::hybrid() else {
            panic!("the default is a hybrid")
        };
        let found = estimate(Profile::Mixed, 0, Method::Population(population));
        // The first generation and five more that keep two, one linearisation, and the run of the residual.
        assert_eq!(found.evaluations, 32 + 5 * 30 + RUNS_PER_LINEARISATION + 1);
        assert!(found.sigma[0].is_some_and(|sigma| sigma < 0.1) && !found.cut);
    }

    #[test]
    fn a_budget_that_does_not_reach_says_so() {
        let Method::Hybrid(Population::Genetic(mut config)) = Method::hybrid() else {
            panic!("the default's population is genetic")
        };
        let enough = estimate(Profile::Ramp, 0, Method::hybrid()).evaluations;
        config.stop.max_evaluations = Some(enough - 20);
        let found = estimate(Profile::Ramp, 0, Method::Hybrid(Population::Genetic(config)));
        assert!(found.evaluations <= enough - 20, "{} of {enough}", found.evaluations);
        assert!(found.cut && found.sigma[0].is_none());
    }
}
