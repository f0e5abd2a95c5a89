//! Estimates of one window of a commissioned unit: damage is what has changed since commissioning.
//!
//! In: the calibration of the unit and a window. Out: an [`Estimate`] like that of any other window, with what the window would have
//! needed where it does not show an element.

mod by_both;
mod by_monitor;
mod by_relations;

use std::vec::Vec;

use ema_models::{FAULT_COUNT, FaultId};

use crate::estimate::Estimate;
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
    /// The same with every sigma multiplied but what comes from a bridge, for conditions that commissioning has not seen: see
    /// [`Estimate::widened`].
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
        let shorts = [FaultId::ShortA, FaultId::ShortB, FaultId::ShortC].map(FaultId::parameter);
        let factors = core::array::from_fn(|n| match self.estimate.sigma[n] {
            Some(sigma) if shorts.contains(&n) && sigma > 0.0 => sigma.hypot(torque_sigma) / sigma,
            _ => 1.0,
        });
        Self {
            estimate: self.estimate.widened(&factors),
            ..self
        }
    }

    /// The same with a factor for each sigma.
    fn widened_by(self, factors: &[f64; FAULT_COUNT]) -> Self {
        let factors = core::array::from_fn(|n| match self.estimate.sigma[n] {
            Some(sigma) if self.bridge_spread[n] > 0.0 => {
                let own = (sigma * sigma - self.bridge_spread[n] * self.bridge_spread[n])
                    .max(0.0)
                    .sqrt();
                self.bridge_spread[n].hypot(factors[n] * own) / sigma
            }
            _ => factors[n],
        });
        Self {
            estimate: self.estimate.widened(&factors),
            ..self
        }
    }
}
