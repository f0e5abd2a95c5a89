//! A window of a commissioned unit by the relations and by the monitor: each fault by the one that shows it better.

use super::UnitEstimate;
use crate::estimate::Estimate;
use ema_models::{FAULT_COUNT, FaultId, FaultVector, Unknowns};

/// Each fault by the estimate with the smaller sigma, cost and residual by the relations; where one of the two does not explain the
/// window, the other one alone. The monitor knows no shorted loop: with one the relations alone. Nor does it know a load that closes the
/// play: a backlash that needs a reversal without such a load stays unseen.
#[must_use]
pub fn of_both(relations: UnitEstimate, monitor: UnitEstimate) -> UnitEstimate {
    if monitor.estimate.is_unmodelled() || relations.bridge_spread.iter().any(|&spread| spread > 0.0) {
        return relations;
    }
    if relations.estimate.is_unmodelled() {
        return monitor.in_place_of(&relations);
    }
    let is_closed = relations.is_play_closed();
    let mut k = relations.estimate.fault.to_array();
    let UnitEstimate {
        estimate,
        mut needed,
        unexplained,
        bridge_spread,
    } = relations;
    let (mut sigma, mut share, mut observable) = (estimate.sigma, estimate.share, estimate.observable);
    let of_monitor = monitor.estimate.fault.to_array();
    let backlash = FaultId::Backlash.parameter();
    for (from, to) in elements().filter(|&(from, _)| !(is_closed && from == backlash)) {
        if shown(&monitor.estimate, from) < shown(&estimate, from) {
            let range = from..=to;
            k[range.clone()].copy_from_slice(&of_monitor[range.clone()]);
            sigma[range.clone()].copy_from_slice(&monitor.estimate.sigma[range.clone()]);
            observable[range.clone()].copy_from_slice(&monitor.estimate.observable[range.clone()]);
            needed[range.clone()].copy_from_slice(&monitor.needed[range.clone()]);
            share[range.clone()].copy_from_slice(&monitor.estimate.share[range]);
        }
    }
    let fault = FaultVector::from_array(k);
    UnitEstimate {
        estimate: Estimate {
            fault,
            unknowns: Unknowns {
                fault,
                ..estimate.unknowns
            },
            sigma,
            share,
            observable,
            evaluations: monitor.estimate.evaluations,
            cut: monitor.estimate.cut,
            ..estimate
        },
        needed,
        unexplained,
        bridge_spread,
    }
}

/// Ranges of parameters that belong together: the direction of the eccentricity with its amplitude.
fn elements() -> impl Iterator<Item = (usize, usize)> {
    let direction = FaultVector::ECCENTRICITY_PHASE_INDEX;
    (0..FAULT_COUNT)
        .filter(move |&parameter| parameter != direction)
        .map(move |parameter| {
            let last = if parameter + 1 == direction {
                direction
            } else {
                parameter
            };
            (parameter, last)
        })
}

/// Sigma of a parameter; infinite where the window does not show it.
fn shown(estimate: &Estimate, parameter: usize) -> f64 {
    estimate.sigma[parameter]
        .filter(|_| estimate.observable[parameter])
        .unwrap_or(f64::INFINITY)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::estimate::UNMODELLED_COST;
    use crate::relations::{Needed, Relation};
    use ema_models::MotorDeviation;
    use std::vec::Vec;

    pub(in super::super) fn estimate(k: [f64; FAULT_COUNT], sigma: [Option<f64>; FAULT_COUNT]) -> UnitEstimate {
        let fault = FaultVector::from_array(k);
        UnitEstimate {
            estimate: Estimate {
                fault,
                unknowns: Unknowns {
                    fault,
                    load_torque: 0.0,
                    integral: 0.0,
                    motor: MotorDeviation::default(),
                },
                sigma,
                observable: sigma.map(|sigma| sigma.is_some()),
                cost: 1.0,
                residual_rms_a: 0.0,
                evaluations: 0,
                cut: false,
                competing_optimum: None,
                share: [0.0; FAULT_COUNT],
                back_emf_off: 0.0,
                other_motor: false,
                locked: false,
                deviations: Vec::new(),
                inferred: crate::inferred::InferredReadings::default(),
            },
            needed: sigma.map(|sigma| sigma.is_none().then_some(Needed::LongerMotion)),
            unexplained: Vec::new(),
            bridge_spread: [0.0; FAULT_COUNT],
        }
    }

    #[test]
    fn each_fault_is_that_of_the_smaller_sigma() {
        let (small, large) = (Some(0.01), Some(0.05));
        let relations = estimate(
            [0.2, 0.0, 0.0, 0.1, 0.0, 0.0, 0.5, 0.5],
            [small, small, None, large, small, None, None, large],
        );
        let monitor = estimate(
            [0.4, 0.1, 0.3, 0.2, 0.0, 0.1, 0.8, 0.6],
            [large, None, large, small, large, small, large, small],
        );
        let both = of_both(relations.clone(), monitor.clone());
        let expected = [0.2, 0.0, 0.3, 0.2, 0.0, 0.1, 0.8, 0.6];
        assert_eq!(
            both.estimate.fault.to_array().map(f64::to_bits),
            expected.map(f64::to_bits)
        );
        assert_eq!(
            both.estimate.sigma,
            [small, small, large, small, small, small, large, small]
        );
        assert_eq!(both.needed, [None; FAULT_COUNT]);

        let mut unmodelled = monitor.clone();
        unmodelled.estimate.cost = 2.0 * UNMODELLED_COST;
        assert_eq!(of_both(relations.clone(), unmodelled), relations);
        let mut unmodelled = relations;
        unmodelled.estimate.cost = 2.0 * UNMODELLED_COST;
        assert_eq!(of_both(unmodelled, monitor.clone()), monitor);
    }

    /// Relations that do not show the backlash, for want of this.
    fn without_backlash(needed: Needed) -> UnitEstimate {
        let mut relations = estimate([0.0; FAULT_COUNT], [Some(0.01); FAULT_COUNT]);
        relations.estimate = relations.estimate.without(&[FaultId::Backlash]);
        relations.needed[FaultId::Backlash.parameter()] = Some(needed);
        relations
    }

    #[test]
    fn a_play_that_a_load_closes_is_none_of_the_monitors_and_an_uncertain_one_is() {
        let monitor = estimate([0.0; FAULT_COUNT], [Some(0.02); FAULT_COUNT]);
        let backlash = FaultId::Backlash.parameter();
        let closed = of_both(without_backlash(Needed::OpenReversal), monitor.clone());
        assert!(closed.estimate.sigma[backlash].is_none() && closed.needed[backlash] == Some(Needed::OpenReversal));
        let uncertain = of_both(without_backlash(Needed::Reversal), monitor);
        assert!(uncertain.estimate.sigma[backlash].is_some() && uncertain.needed[backlash].is_none());
    }

    #[test]
    fn a_monitor_in_place_of_relations_shows_no_play_that_a_load_closes() {
        let monitor = estimate([0.0; FAULT_COUNT], [Some(0.02); FAULT_COUNT]);
        let backlash = FaultId::Backlash.parameter();
        let is_shown = |found: &UnitEstimate| found.estimate.observable[backlash];
        for (needed, shown) in [(Needed::OpenReversal, false), (Needed::Reversal, true)] {
            let mut relations = without_backlash(needed);
            relations.estimate.cost = 2.0 * UNMODELLED_COST;
            let of_both = of_both(relations.clone(), monitor.clone());
            let alone = monitor.clone().in_place_of(&relations);
            assert!(is_shown(&of_both) == shown && is_shown(&alone) == shown, "{needed:?}");
            assert_eq!(alone.needed[backlash], (!shown).then_some(needed));
        }
        // An output that does not follow the motor through any play.
        let mut relations = estimate([0.0; FAULT_COUNT], [Some(0.01); FAULT_COUNT]);
        relations.unexplained = std::vec![Relation::TorqueBalance, Relation::Transmission];
        assert!(!is_shown(&monitor.in_place_of(&relations)));
    }
}
