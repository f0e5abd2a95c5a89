//! Estimates of one window of a commissioned unit: damage is what has changed since commissioning.
//!
//! In: the calibration of the unit and a window. Out: an [`Estimate`] like that of any other window, with what the window would have
//! needed where it does not show an element.

mod by_both;
mod by_monitor;
mod by_relations;

use std::vec::Vec;

use ema_models::{FAULT_COUNT, FaultId, FaultVector};

use crate::estimate::{Estimate, beside};
use crate::relations::{Needed, Relation};

pub use by_both::of_both;
pub use by_monitor::{USUAL_COST, corrected};
pub use by_relations::{AlignedWindow, estimate_by_relations};

/// Estimate of one window of a commissioned unit.
#[derive(Clone, Debug, PartialEq)]
pub struct UnitEstimate {
    /// The estimate.
    pub estimate: Estimate,
    /// What the window would have needed to show a parameter, where it is known.
    pub needed: [Option<Needed>; FAULT_COUNT],
    /// Relations that do not explain the window; none where the monitor estimated it.
    pub unexplained: Vec<Relation>,
    /// The part of each sigma that comes from the unknown bridge of a shorted loop, which no conditions widen.
    pub bridge_spread: [f64; FAULT_COUNT],
}

impl UnitEstimate {
    /// The same with every sigma multiplied but what comes from a bridge, for conditions that commissioning has not seen. A damage whose
    /// sigma is then above 0.1, without what grows with the damage itself, is not observable.
    #[must_use]
    pub fn widened(self, factor: f64) -> Self {
        self.widened_by(&[factor; FAULT_COUNT])
    }

    /// The same with the sigmas of these faults multiplied.
    #[must_use]
    pub fn widened_in(self, faults: &[FaultId], factor: f64) -> Self {
        let of_fault = |n: usize| faults.iter().any(|fault| fault.parameter() == n);
        self.widened_by(&core::array::from_fn(|n| if of_fault(n) { factor } else { 1.0 }))
    }

    /// The same where the torque for each ampere is known within this standard deviation, 1: shorts may stand in its place.
    #[must_use]
    pub fn with_torque_sigma(self, torque_sigma: f64) -> Self {
        self.with_sigma_in(&[FaultId::ShortA, FaultId::ShortB, FaultId::ShortC], torque_sigma)
    }

    /// The same with another standard deviation in the parameters of these faults.
    #[must_use]
    pub fn with_sigma_in(self, faults: &[FaultId], other: f64) -> Self {
        let is_meant = |n: usize| faults.iter().any(|fault| fault.parameter() == n);
        self.with_sigmas(|n, sigma| if is_meant(n) { sigma.hypot(other) } else { sigma })
    }

    /// The same where the torque for each ampere may have changed by up to this share for another reason, as by a temperature that nobody
    /// reads. It weakens all phases alike, and at most two of them are shorted: what the least shorted one lacks is not a short. Where the
    /// window tells nothing of a phase, the change is a part of the sigmas of the others.
    #[must_use]
    pub fn without_common_short(mut self, change_max: f64) -> Self {
        let shorts = [FaultId::ShortA, FaultId::ShortB, FaultId::ShortC].map(FaultId::parameter);
        if shorts.iter().any(|&n| self.estimate.sigma[n].is_none()) {
            return self.with_torque_sigma(change_max);
        }
        let mut k = self.estimate.fault.to_array();
        let Some(least) = shorts.into_iter().min_by(|a, b| k[*a].total_cmp(&k[*b])) else {
            return self;
        };
        let common = k[least].min(change_max);
        let (true, Some(of_common)) = (common > 0.0, self.estimate.sigma[least]) else {
            return self;
        };
        let spread = of_common.min(common);
        for n in shorts {
            k[n] -= common;
        }
        self.estimate.fault = FaultVector::from_array(k);
        self.estimate.unknowns.fault = self.estimate.fault;
        let is_widened = |n: usize| shorts.contains(&n) && n != least;
        self.with_sigmas(|n, sigma| if is_widened(n) { sigma.hypot(spread) } else { sigma })
    }

    /// Whether a load closes the play, by the relations.
    fn is_play_closed(&self) -> bool {
        self.needed[FaultId::Backlash.parameter()] == Some(Needed::OpenReversal)
    }

    /// This estimate of the monitor where the relations do not explain the window. The monitor knows no load that closes the play, and its
    /// gear is rigid: without a backlash where a load closes the play, or the output does not follow the motor through any.
    #[must_use]
    pub fn in_place_of(mut self, relations: &Self) -> Self {
        if relations.is_play_closed() || relations.unexplained.contains(&Relation::Transmission) {
            let backlash = FaultId::Backlash.parameter();
            self.estimate = self.estimate.without(&[FaultId::Backlash]);
            self.needed[backlash] = relations.needed[backlash];
        }
        self
    }

    /// The same with a factor for each sigma but what comes from a bridge.
    fn widened_by(mut self, factors: &[f64; FAULT_COUNT]) -> Self {
        for (share, factor) in self.estimate.share.iter_mut().zip(factors) {
            *share *= factor;
        }
        let bridge = self.bridge_spread;
        self.with_sigmas(|n, sigma| bridge[n].hypot(factors[n] * beside(sigma, bridge[n])))
    }

    /// The same with other sigmas, by parameter and the sigma before.
    fn with_sigmas(mut self, other: impl Fn(usize, f64) -> f64) -> Self {
        let estimate = &mut self.estimate;
        for (n, sigma) in estimate.sigma.iter_mut().enumerate() {
            *sigma = sigma.map(|sigma| other(n, sigma));
        }
        estimate.check_observable(&self.bridge_spread);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::by_both::tests::estimate;
    use super::*;

    /// Shorts of phases A, B, C, each with its sigma, after what all three have in common is taken out.
    fn shorts(damage: [f64; 3], sigma: f64, change_max: f64) -> [(f64, f64); 3] {
        let mut k = [0.0; FAULT_COUNT];
        k[2..5].copy_from_slice(&damage);
        let found = estimate(k, [Some(sigma); FAULT_COUNT])
            .without_common_short(change_max)
            .estimate;
        let k = found.fault.to_array();
        [2, 3, 4].map(|n| (k[n], found.sigma[n].unwrap_or(f64::NAN)))
    }

    #[test]
    fn a_phase_that_a_window_does_not_show_leaves_the_change_of_the_magnets_to_the_others() {
        let mut k = [0.0; FAULT_COUNT];
        k[3..5].copy_from_slice(&[0.09, 0.09]);
        let mut sigma = [Some(0.01); FAULT_COUNT];
        sigma[2] = None;
        let found = estimate(k, sigma).without_common_short(0.09).estimate;
        assert!(found.sigma[3].is_some_and(|sigma| sigma > 0.09) && found.sigma[2].is_none());
    }

    #[test]
    fn warm_magnets_are_no_shorts_and_a_short_of_one_phase_stays() {
        let near = |found: [(f64, f64); 3], expected: [(f64, f64); 3]| {
            for ((k, sigma), (k_expected, sigma_expected)) in found.into_iter().zip(expected) {
                assert!(
                    (k - k_expected).abs() < 1e-12 && (sigma - sigma_expected).abs() < 1e-12,
                    "{found:?}"
                );
            }
        };
        let wider = 0.01_f64.hypot(0.01);
        near(
            shorts([0.04, 0.045, 0.24], 0.01, 0.09),
            [(0.0, 0.01), (0.005, wider), (0.2, wider)],
        );
        // What is known stays as it is, and so does what no temperature explains.
        near(
            shorts([0.04, 0.045, 0.24], 0.01, 0.0),
            [(0.04, 0.01), (0.045, 0.01), (0.24, 0.01)],
        );
        near(
            shorts([0.5; 3], 0.01, 0.09),
            [(0.41, 0.01), (0.41, wider), (0.41, wider)],
        );
        near(
            shorts([0.0, 0.1, 0.1], 0.01, 0.09),
            [(0.0, 0.01), (0.1, 0.01), (0.1, 0.01)],
        );
    }
}
