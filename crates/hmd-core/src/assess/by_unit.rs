//! A window of a commissioned unit -> estimate: by its relations, or by the monitor corrected by its baseline.

use ema_identify::relations::Needed;
use ema_identify::unit_calibration::{Motion, UnitCalibration, UnitEstimator};
use ema_identify::unit_estimate::{AlignedWindow, UnitEstimate, corrected, estimate_by_relations};
use ema_identify::{Estimate, Fit, Identifier, Prepared};
use ema_models::{Conditions, FaultId};

use super::AssessError;
use crate::outbox::WindowJob;
use crate::outliers::{estimate_without_outliers, identify_without_outliers};
use crate::window::Window;

/// Factor on every sigma for each respect in which commissioning has not seen a window's conditions.
const UNSEEN_FACTOR: f64 = 2.0;

/// What an identification finds in a window.
pub(super) struct Assessed {
    pub(super) estimate: Estimate,
    pub(super) fit: Fit,
    /// Handicaps of the estimate.
    pub(super) reasons: Vec<String>,
}

/// Estimates a window by what was learnt of its unit; damage is the change since then.
///
/// # Errors
/// Those of the identification.
pub(super) fn estimate(
    unit: &UnitCalibration,
    identifier: &Identifier,
    job: &mut WindowJob,
    conditions: Conditions,
    seed: u64,
) -> Result<Assessed, AssessError> {
    let (fit, mut found) = match (unit.estimator, &unit.relations, &unit.monitor) {
        (UnitEstimator::Relations, Some(relations), _) => {
            let params = job.params;
            let estimate = |window: &Window, prepared: &Prepared| {
                let aligned = AlignedWindow::new(&params, &window.samples, &window.filled);
                let is_locked = identifier.is_locked(prepared, conditions);
                Ok::<_, AssessError>(estimate_by_relations(relations, &aligned, is_locked))
            };
            let (prepared, found) =
                estimate_without_outliers(identifier, &mut job.window, conditions, estimate, |found| {
                    &found.estimate
                })?;
            (identifier.fit(&prepared, conditions, &found.estimate), found)
        }
        (_, _, Some(monitor)) => {
            let (prepared, estimate) = identify_without_outliers(identifier, &mut job.window, conditions, seed)?;
            // The curve is that of the monitor's own estimate.
            let fit = identifier.fit(&prepared, conditions, &estimate);
            (fit, corrected(monitor, estimate))
        }
        _ => return Err(AssessError::NoEstimator(job.actuator.name.clone())),
    };
    let mut reasons = Vec::new();
    reasons.extend(not_observable(&found));
    let motion = motion_of(job);
    for unseen in unit.seen.unseen(&motion, &job.params) {
        reasons.push(unseen.to_string());
        found = found.widened(UNSEEN_FACTOR);
    }
    Ok(Assessed {
        estimate: found.estimate,
        fit,
        reasons,
    })
}

/// Conditions and motion of a window.
#[must_use]
pub(crate) fn motion_of(job: &WindowJob) -> Motion {
    Motion {
        winding_temp_deg_c: job.conditions.winding_temp_deg_c,
        load_torque: job.conditions.load_torque_nm,
        ..Motion::of(&job.params, &job.window.samples)
    }
}

/// The reason that names the faults which are not observable, each with what it needed where that is known.
fn not_observable(found: &UnitEstimate) -> Option<String> {
    let names: Vec<String> = FaultId::ALL
        .into_iter()
        .filter(|fault| !found.estimate.observable[fault.parameter()])
        .map(|fault| match found.needed[fault.parameter()] {
            Some(needed) => format!("{} (needs {})", fault.name(), needed_in_words(needed)),
            None => fault.name().to_owned(),
        })
        .collect();
    (!names.is_empty()).then(|| format!("not excited: {}", names.join(", ")))
}

/// What a window would have needed, in words.
pub(crate) fn needed_in_words(needed: Needed) -> &'static str {
    match needed {
        Needed::LongerMotion => "longer motion",
        Needed::BothDirections => "motion in both directions",
        Needed::MoreCurrent => "more current",
        Needed::Reversal => "a reversal of the output",
        Needed::PositionMode => "position mode",
        Needed::UnsaturatedControl => "control off its limits",
        Needed::CommissioningThatShowsIt => "commissioning windows that show it",
    }
}
