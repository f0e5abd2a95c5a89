//! A window of a commissioned unit by the monitor, corrected by what the unit's healthy windows show.

use std::vec::Vec;

use ema_models::{FAULT_COUNT, FaultVector};

use super::UnitEstimate;
use crate::estimate::{Estimate, OBSERVABLE_SIGMA};
use crate::relations::{ELEMENT_COUNT, Element, Needed};
use crate::unit_calibration::{
    ElementStatistics, UnitMonitor, UnitParameter, change_since, elements_of, fault_of, nominal_elements,
};

/// Cost up to which the monitor explains a healthy window as well as those of its type.
pub const USUAL_COST: f64 = 3.0;

/// Error of a change that the scatter of healthy windows does not show, as a share of it and at least: the monitor's mismatch on
/// units of the suite `robust`, mixed motion at 2 kHz. At 400 Hz the share is 0.09, mean square of shorts on three types, which the root of the
/// sample period meets.
const ERROR_SHARE: f64 = 0.04;
const ERROR_FLOOR: f64 = 0.003;
const ERROR_RATE_HZ: f64 = 2000.0;

/// The estimate as change since commissioning.
///
/// Each element loses the mean of the healthy windows and gains their scatter in its sigma ([`ElementStatistics::sigma_of_change`]).
/// The cost counts relative to that of healthy windows, where that is above the usual one.
///
/// [`ElementStatistics::sigma_of_change`]: crate::unit_calibration::ElementStatistics::sigma_of_change
#[must_use]
pub fn corrected(unit: &UnitMonitor, estimate: Estimate, sample_rate_hz: f64) -> UnitEstimate {
    let error_share = ERROR_SHARE * (ERROR_RATE_HZ / sample_rate_hz).max(1.0).sqrt();
    let changed = |fault: &FaultVector| {
        let apparent = elements_of(fault);
        let elements: [f64; ELEMENT_COUNT] =
            core::array::from_fn(|n| change_since(Element::ALL[n], apparent[n], unit.baseline[n].mean).0);
        fault_of(&elements)
    };
    let apparent = elements_of(&estimate.fault);
    let mut needed = [None; FAULT_COUNT];
    let mut sigma = [None; FAULT_COUNT];
    for (element, baseline) in Element::ALL.into_iter().zip(&unit.baseline) {
        let parameter = element.fault().parameter();
        let Some(own) = estimate.sigma[parameter].filter(|_| estimate.observable[parameter]) else {
            continue;
        };
        let factor = change_since(element, 0.0, baseline.mean).1;
        match baseline.sigma_of_change(own) {
            Some(found) if needed[parameter].is_none() => {
                let distance = change_since(element, apparent[element as usize], baseline.mean).0
                    - nominal_elements()[element as usize];
                let learnt = learnt_sigma(unit, element, baseline);
                let error = ERROR_FLOOR.hypot(error_share * distance).hypot(learnt);
                let found = (factor * found).hypot(error);
                sigma[parameter] = Some(sigma[parameter].map_or(found, |other: f64| other.max(found)));
            }
            _ => {
                sigma[parameter] = None;
                needed[parameter] = Some(Needed::CommissioningThatShowsIt);
            }
        }
    }
    let phase = FaultVector::ECCENTRICITY_PHASE_INDEX;
    sigma[phase] = estimate.sigma[phase].filter(|_| sigma[phase - 1].is_some());
    let fault = changed(&estimate.fault);
    let estimate = Estimate {
        fault,
        sigma,
        observable: sigma.map(|sigma| sigma.is_some_and(|sigma| sigma <= OBSERVABLE_SIGMA)),
        cost: estimate.cost * (USUAL_COST / unit.cost).min(1.0),
        competing_optimum: estimate.competing_optimum.map(|other| changed(&other)),
        ..estimate
    };
    UnitEstimate {
        estimate,
        needed,
        unexplained: Vec::new(),
        bridge_spread: [0.0; FAULT_COUNT],
    }
}

/// One standard deviation of a change by what the learnt parameters leave open of the element itself: `½ σ/(1 + d)` of k1 with the deviation
/// d of the dry friction. Healthy windows that read less than no wear, of which the limit leaves no wear, do not show it in their mean.
fn learnt_sigma(unit: &UnitMonitor, element: Element, baseline: &ElementStatistics) -> f64 {
    let is_at_limit = baseline.mean <= baseline.scatter;
    if element != Element::Friction || !is_at_limit {
        return 0.0;
    }
    let learnt = unit.parameters.of(UnitParameter::DryFriction);
    0.5 * learnt.sigma / (1.0 + learnt.share)
}
