//! Estimates of one window of a commissioned unit: damage is what has changed since commissioning.
//!
//! In: the calibration of the unit and a window. Out: an [`Estimate`] like that of any other window, with what the window would have
//! needed where it does not show an element.

mod by_both;
mod by_monitor;
mod by_relations;
mod common_change;
mod sensor_gain;

use std::vec::Vec;

use ema_models::{FAULT_COUNT, FaultId};

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
