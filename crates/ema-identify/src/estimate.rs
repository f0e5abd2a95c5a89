//! What identification says of one window: the fault vector, how far it can be trusted, and whether it is worth anything.

use core::fmt;

use ema_models::{FAULT_COUNT, FaultId, FaultVector, Unknowns};

/// Fault vector of one window, and how far it can be trusted.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Best fault vector.
    pub fault: FaultVector,
    /// The same with its companions.
    pub unknowns: Unknowns,
    /// One standard deviation of each component, with the errors of the model and what is not known of the unit; `None` where it
    /// means nothing (k7 without eccentricity) or the window tells nothing of the component.
    pub sigma: [Option<f64>; FAULT_COUNT],
    /// The part of each standard deviation that is a share of the damage itself: it hides no large damage.
    pub share: [f64; FAULT_COUNT],
    /// Whether the standard deviation of the damage is at most 0.1, without what grows with the damage.
    pub observable: [bool; FAULT_COUNT],
    /// Mean over the samples of half the squared weighted residuals.
    pub cost: f64,
    /// Root-mean-square residual of the quadrature current, A.
    pub residual_rms_a: f64,
    /// Monitor evaluations spent.
    pub evaluations: u64,
    /// Whether the budget of evaluations was spent before the search had ended: the best so far.
    pub cut: bool,
    /// Another fault vector, far from this one, that explains the window as well; the sigmas reach as far as it.
    pub competing_optimum: Option<FaultVector>,
    /// Back-EMF coefficient of the motor beyond what was expected of it, as a share of the type's.
    pub back_emf_off: f64,
    /// Whether another motor than the one expected explains the window clearly better.
    pub other_motor: bool,
    /// Whether the motor stood while it was commanded to move.
    pub locked: bool,
    /// Deviations of the unit from its type that the fit found beside the unknowns, in tolerances; empty where every number is
    /// known.
    #[cfg(feature = "std")]
    pub deviations: std::vec::Vec<f64>,
    /// What the window says of its readings.
    #[cfg(feature = "std")]
    pub inferred: crate::inferred::InferredReadings,
}

impl Estimate {
    /// Whether the data, though good, are of something the monitor does not know.
    #[must_use]
    pub fn is_unmodelled(&self) -> bool {
        self.unmodelled().is_some()
    }

    /// Why the data, though good, are of something the monitor does not know; `None` where it knows.
    #[must_use]
    pub fn unmodelled(&self) -> Option<Unmodelled> {
        if self.locked {
            Some(Unmodelled::Locked)
        } else if is_unmodelled(self.cost) {
            Some(Unmodelled::Cost(self.cost))
        } else if self.back_emf_off.abs() > BACK_EMF_OFF || self.other_motor {
            Some(Unmodelled::Magnets(self.back_emf_off))
        } else {
            None
        }
    }

    /// One standard deviation of each damage (see [`FaultVector::damage`]); infinite where the window tells nothing of it.
    #[must_use]
    pub fn damage_sigma(&self) -> [f64; FAULT_COUNT] {
        let sigma = self.sigma.map(|s| s.unwrap_or(f64::INFINITY));
        core::array::from_fn(|p| damage_per_change(p) * sigma[p])
    }

    /// The same with sigmas that reach as far as another point, given its distance in fault coordinates: what a search that was cut
    /// short moved by in its last part, it may still be off by.
    #[must_use]
    pub fn reaching(mut self, distance: &[f64; FAULT_COUNT]) -> Self {
        let phase = FaultVector::ECCENTRICITY_PHASE_INDEX;
        let eccentricity = phase - 1;
        let across = libm::hypot(distance[eccentricity], distance[phase]);
        if self.sigma[eccentricity].is_none_or(|sigma| across > sigma) {
            (self.sigma[phase], self.observable[phase]) = (None, false);
        }
        for (p, sigma) in self.sigma.iter_mut().enumerate().filter(|(p, _)| *p != phase) {
            let off = if p == eccentricity { across } else { distance[p] };
            *sigma = sigma.map(|sigma| libm::hypot(sigma, off));
        }
        self.widened(&[1.0; FAULT_COUNT])
    }

    /// The same with the sigma of each component multiplied by a factor; a component whose damage then has a sigma above 0.1, without
    /// what grows with the damage, is not observable.
    #[must_use]
    pub fn widened(mut self, factors: &[f64; FAULT_COUNT]) -> Self {
        for (sigma, factor) in self.sigma.iter_mut().zip(factors) {
            *sigma = sigma.map(|sigma| factor * sigma);
        }
        for (share, factor) in self.share.iter_mut().zip(factors) {
            *share *= factor;
        }
        self.check_observable(&[0.0; FAULT_COUNT]);
        self
    }

    /// The same without these faults, which the window does not show then.
    #[must_use]
    pub fn without(mut self, faults: &[FaultId]) -> Self {
        for fault in faults {
            (self.observable[fault.parameter()], self.sigma[fault.parameter()]) = (false, None);
        }
        self
    }

    /// Takes components as not observable whose damage has a sigma above 0.1, without its share of the damage and another part of it.
    pub(crate) fn check_observable(&mut self, other_part: &[f64; FAULT_COUNT]) {
        for p in 0..FAULT_COUNT {
            let part = libm::hypot(self.share[p], other_part[p]);
            let own = self.sigma[p].map_or(f64::INFINITY, |sigma| beside(sigma, part));
            self.observable[p] &= damage_per_change(p) * own <= OBSERVABLE_SIGMA;
        }
    }
}

/// What a standard deviation has beside a part of it.
pub(crate) fn beside(sigma: f64, part: f64) -> f64 {
    libm::sqrt((sigma * sigma - part * part).max(0.0))
}

/// Damage by a change of a component.
pub(crate) fn damage_per_change(parameter: usize) -> f64 {
    let mut faults = FaultId::ALL.into_iter().filter(|fault| fault.parameter() == parameter);
    faults.next().map_or(1.0, FaultId::damage_per_change)
}

/// What a window says whose motor does not turn as commanded.
pub const LOCKED: &str = "the motor does not turn as commanded";

/// What makes an estimate worthless though the data are good.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unmodelled {
    /// The motor does not turn as commanded.
    Locked,
    /// No fault vector explains the data: the cost.
    Cost(f64),
    /// The motor is none of its type: its back-EMF coefficient beyond what was expected, as a share. An acceleration shows its ratio to the
    /// inertia alone.
    Magnets(f64),
}

impl fmt::Display for Unmodelled {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Locked => f.write_str(LOCKED),
            Self::Cost(cost) => write!(f, "no fault vector explains the data: cost {cost:.0}"),
            Self::Magnets(off) => write!(
                f,
                "no motor of this type: back-EMF {:+.0} % off what is expected, or inertia {:+.0} %",
                100.0 * off,
                100.0 * (1.0 / (1.0 + off) - 1.0)
            ),
        }
    }
}

/// Whether a cost alone says that the data are of something the monitor does not know.
#[must_use]
pub fn is_unmodelled(cost: f64) -> bool {
    cost.is_nan() || cost > UNMODELLED_COST
}

/// A cost above this says that no fault vector explains the window: weighted residuals of four times their expected
/// size. Good windows of every profile cost 1.0 to 1.5 without sensor noise, 2.0 to 2.7 with 50 mA rms on the currents and
/// 5.5 to 6.3 with 100 mA.
pub(crate) const UNMODELLED_COST: f64 = 15.0;

/// A back-EMF coefficient this far from what was expected, as a share, is no motor of the type: it is twice what
/// manufacturers guarantee, and what the temperature explains is part of what is expected.
const BACK_EMF_OFF: f64 = 0.15;

/// A parameter with a larger standard deviation is not observable.
pub const OBSERVABLE_SIGMA: f64 = 0.1;

#[cfg(all(test, feature = "std"))]
mod tests {
    use super::*;
    use ema_models::MotorDeviation;

    #[test]
    fn a_component_that_a_wider_sigma_hides_is_not_observable() {
        let fault = FaultVector::NOMINAL;
        let estimate = Estimate {
            fault,
            unknowns: Unknowns {
                fault,
                load_torque: 0.0,
                integral: 0.0,
                motor: MotorDeviation::default(),
            },
            sigma: [Some(0.04), Some(0.06), None, Some(0.01), None, None, None, Some(0.03)],
            observable: [true, true, false, true, false, false, false, true],
            cost: 1.0,
            residual_rms_a: 0.0,
            evaluations: 0,
            cut: false,
            competing_optimum: None,
            share: [0.0; FAULT_COUNT],
            back_emf_off: 0.0,
            other_motor: false,
            locked: false,
            deviations: std::vec::Vec::new(),
            inferred: crate::inferred::InferredReadings::default(),
        };
        let wide = estimate.widened(&[2.0; FAULT_COUNT]);
        // A gain of ±0.06 is a damage of ±0.12.
        assert_eq!(wide.observable, [true, false, false, true, false, false, false, false]);
        assert_eq!(wide.sigma[1], Some(0.12));
    }
}
