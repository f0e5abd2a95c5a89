//! What the torque for each ampere of all three phases has in common is told from shorts by nothing that is measured.
//!
//! The torque balance has `c (1 − k_j) k s_j i_j` for each phase: a common gain 1/c of the current sensors, magnets weaker by c, an inertia
//! larger by 1/c, and shorts of 1 − c in all three phases give the same torque. So does every other relation: the drive controls the currents
//! that its sensors read, and voltages, which shorts lower with the flux and a gain does not, are not measured. No winding fails in three
//! phases alike: c is that of the phase with the most turns, and shorts are what the others lack of it. Derived here.

use ema_models::{FAULT_COUNT, FaultId, FaultVector};

use super::UnitEstimate;
use crate::estimate::Estimate;
use crate::inferred::Inferred;

/// Factors of the torque for each ampere that gains of sensors explain.
const FACTOR_MIN: f64 = 0.5;
const FACTOR_MAX: f64 = 2.0;

/// Standard deviations from which on a short is certain by any explanation of what the phases have in common, and least one, which no gains of
/// single sensors explain: four of their tolerances.
const CERTAIN: f64 = 3.2;
const CERTAIN_LEAST: f64 = 0.04;

/// Parameters of the shorts.
pub(super) const SHORTS: [usize; 3] = [
    FaultId::ShortA.parameter(),
    FaultId::ShortB.parameter(),
    FaultId::ShortC.parameter(),
];

/// Phases in the order of their turns, that with the most first; one alone that has more than all of them comes behind the second.
fn by_turns(turns: &[f64; 3]) -> [usize; 3] {
    let mut order = [0, 1, 2];
    order.sort_by(|&one, &other| turns[other].total_cmp(&turns[one]));
    if turns[order[0]] > 1.0 {
        order.swap(0, 1);
    }
    order
}

/// What the turns of all phases have in common.
pub(super) fn common_factor(turns: &[f64; 3]) -> f64 {
    let [reference, other, _] = by_turns(turns);
    // One phase alone above 1 is no common change.
    if turns[other] > 1.0 {
        turns[reference].clamp(1.0, FACTOR_MAX)
    } else {
        turns[reference].max(FACTOR_MIN)
    }
}

impl UnitEstimate {
    /// The same with shorts beside what all phases have in common, and that: the torque for each ampere relative to that of commissioning, 1.
    ///
    /// A phase that reads more than all its turns is none with more turns: above 1 the factor is that of the second phase, which has to agree.
    /// Where the window tells nothing of a phase, what the others have in common, or `change_max` by the magnets where that is more, is a part
    /// of their sigmas.
    #[must_use]
    pub fn without_common_change(mut self, change_max: f64) -> (Self, Option<Inferred>) {
        let turns = self.turns();
        let [Some(a), Some(b), Some(c)] = turns else {
            let shown = turns.iter().flatten().map(|turns| 1.0 - turns.value);
            let common = shown.fold(f64::INFINITY, f64::min).clamp(change_max, 1.0);
            return (self.with_torque_sigma(common), None);
        };
        let turns = [a, b, c];
        let values = turns.map(|turns| turns.value);
        let value = common_factor(&values);
        let [reference, ..] = by_turns(&values);
        let common = Inferred {
            value,
            sigma: turns[reference].sigma,
        };
        let spread = common.sigma.min((1.0 - value).abs());
        let mut k = self.estimate.fault.to_array();
        for (place, turns) in SHORTS.into_iter().zip(turns) {
            k[place] = (1.0 - turns.value / value).clamp(0.0, 1.0);
        }
        self.estimate.fault = FaultVector::from_array(k);
        self.estimate.unknowns.fault = self.estimate.fault;
        let is_other = |n: usize| SHORTS.contains(&n) && n != SHORTS[reference];
        let found = self.with_sigmas(|n, sigma| if is_other(n) { sigma.hypot(spread) } else { sigma });
        (found, Some(common))
    }

    /// The same with sigmas that hold what the phases have in common: see [`Estimate::with_common_ambiguity`].
    #[must_use]
    pub fn with_common_ambiguity(mut self, factor: f64, explained: f64) -> Self {
        self.estimate = self.estimate.with_common_spread(factor, explained, &self.bridge_spread);
        self
    }

    /// Turns of each phase as the window shows them, 1: where it finds no short, what the torque balance infers, if that is more than all.
    pub(super) fn turns(&self) -> [Option<Inferred>; 3] {
        let k = self.estimate.fault.to_array();
        core::array::from_fn(|phase| {
            let place = SHORTS[phase];
            let sigma = self.estimate.sigma[place]?;
            let inferred = self.estimate.inferred.turns[phase].filter(|_| k[place] <= 0.0);
            let value = inferred.map_or(1.0 - k[place], |inferred| inferred.value.max(1.0));
            Some(Inferred { value, sigma })
        })
    }
}

impl Estimate {
    /// The same with sigmas of the shorts that hold what the phases have in common: the torque for each ampere is `factor` times that of
    /// commissioning, of which magnets explain a change of up to `explained`.
    ///
    /// Of a change u beyond that, any share may be shorts of all three phases (below 1), or none of a common gain (above 1): uniform from
    /// none to all, its root mean square about none is `u/√3`. Shorts of all three add to that of one phase: it is no less certain for them.
    #[must_use]
    pub fn with_common_ambiguity(self, factor: f64, explained: f64) -> Self {
        self.with_common_spread(factor, explained, &[0.0; FAULT_COUNT])
    }

    /// The same of a window whose currents were divided by a common gain. One above 1 may be shorts of all three phases instead.
    #[must_use]
    pub fn beside_common_gain(self, gain: f64) -> Self {
        self.with_common_ambiguity((1.0 / gain).min(1.0), 0.0)
    }

    /// The same; `other_part` of the sigmas hides no large damage.
    fn with_common_spread(mut self, factor: f64, explained: f64, other_part: &[f64; FAULT_COUNT]) -> Self {
        let beyond = ((1.0 - factor).abs() - explained).max(0.0);
        let k = self.fault.to_array();
        for n in SHORTS {
            let spread = beyond * (1.0 - k[n]) / 3_f64.sqrt();
            self.sigma[n] = self.sigma[n].map(|sigma| {
                let wider = sigma.hypot(spread);
                let is_certain = factor < 1.0 && k[n] > CERTAIN_LEAST && k[n] > CERTAIN * sigma;
                if is_certain { wider.min(k[n] / CERTAIN) } else { wider }
            });
        }
        self.check_observable(other_part);
        self
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::by_both::tests::estimate;
    use super::*;

    /// A window whose phases have these turns by the torque balance, all with one sigma.
    pub(in super::super) fn of_turns(turns: [f64; 3], sigma: f64) -> UnitEstimate {
        let mut k = [0.0; FAULT_COUNT];
        for (place, turns) in SHORTS.into_iter().zip(turns) {
            k[place] = (1.0 - turns).max(0.0);
        }
        let mut found = estimate(k, [Some(sigma); FAULT_COUNT]);
        found.estimate.inferred.turns = turns.map(|value| Some(Inferred { value, sigma }));
        found
    }

    /// Shorts of phases A, B, C, each with its sigma, and the common factor.
    fn shorts(turns: [f64; 3], explained: f64) -> ([(f64, f64); 3], f64) {
        let (found, common) = of_turns(turns, 0.005).without_common_change(explained);
        let factor = common.unwrap().value;
        let estimate = found.with_common_ambiguity(factor, explained).estimate;
        let k = estimate.fault.to_array();
        (SHORTS.map(|n| (k[n], estimate.sigma[n].unwrap())), factor)
    }

    #[test]
    fn what_all_phases_lack_accuses_none_and_is_held_by_the_sigmas() {
        for common in [0.98, 0.96, 0.9, 0.8] {
            let (found, factor) = shorts([common, common - 0.004, common - 0.002], 0.0);
            assert!((factor - common).abs() < 1e-12);
            for (k, sigma) in found {
                assert!(k < 2.0 * sigma && 1.0 - common < 2.0 * sigma, "{common}: {found:?}");
            }
        }
    }

    #[test]
    fn a_short_beside_what_all_phases_lack_is_as_certain_as_before_and_holds_both_explanations() {
        for common in [1.0, 0.97, 0.95, 0.9, 0.8] {
            for short in [0.08, 0.15, 0.3] {
                let ([(k, sigma), (other, _), _], _) = shorts([common * (1.0 - short), common, common], 0.0);
                assert!((k - short).abs() < 1e-12 && k > 3.0 * sigma && other <= 0.0);
            }
        }
        // Shorts of 0.3, 0.1 and 0.1: a common gain of 1.11, or three shorts.
        let ([(k, sigma), ..], _) = shorts([0.7, 0.9, 0.9], 0.0);
        assert!(k > 3.0 * sigma && (0.3 - k) < 2.0 * sigma);
    }

    #[test]
    fn currents_that_read_too_little_hide_no_short() {
        let ([(k, sigma), (b, _), (c, _)], factor) = shorts([1.05 * 0.85, 1.05, 1.052], 0.0);
        assert!((factor - 1.05).abs() < 1e-12 && (k - 0.15).abs() < 1e-12 && b <= 0.0 && c <= 0.0);
        // It may be a short of 0.11, and gains of the other two.
        assert!(k > 3.0 * sigma && k - 0.11 < 2.0 * sigma);
        // A phase that alone reads too little makes no shorts of the others.
        let (found, factor) = shorts([1.05, 1.0, 0.998], 0.0);
        assert!((factor - 1.0).abs() < 1e-12 && found.iter().all(|(k, _)| *k < 0.003));
    }

    #[test]
    fn warm_magnets_widen_nothing_and_healthy_phases_stay_as_they_are() {
        let ([(k, sigma), ..], _) = shorts([0.96, 0.955, 0.72], 0.09);
        assert!(k <= 0.0 && (sigma - 0.005).abs() < 1e-12);
        let (found, _) = shorts([1.0, 1.0, 0.76], 0.0);
        assert!((found[2].0 - 0.24).abs() < 1e-12 && (found[2].1 - 0.005).abs() < 1e-12);
    }

    #[test]
    fn a_phase_that_a_window_does_not_show_leaves_what_the_others_lack_to_their_sigmas() {
        let hidden = |turns: [f64; 3], explained: f64| {
            let mut found = of_turns(turns, 0.01);
            found.estimate.sigma[SHORTS[0]] = None;
            found.without_common_change(explained)
        };
        let (found, common) = hidden([1.0, 0.91, 0.91], 0.09);
        assert!(common.is_none() && found.estimate.sigma[3].is_some_and(|sigma| sigma > 0.09));
        assert!(found.estimate.sigma[2].is_none());
        let (found, _) = hidden([1.0, 0.95, 0.91], 0.0);
        assert!(found.estimate.sigma[3].is_some_and(|sigma| sigma > 0.05 && sigma < 0.06));
    }
}
