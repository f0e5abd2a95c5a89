//! A window of a commissioned unit -> estimate: by its relations, or by the monitor corrected by its baseline.

use ema_identify::relations::{Needed, Relation};
use ema_identify::unit_calibration::{
    Motion, UNSEEN_FACTOR, UnitCalibration, UnitEstimator, UnitMonitor, UnitRelations,
};
use ema_identify::unit_estimate::{AlignedWindow, USUAL_COST, UnitEstimate, corrected, estimate_by_relations, of_both};
use ema_identify::{Estimate, Fit, Identifier, Prepared};
use ema_models::{Conditions, FAULT_COUNT, FaultId};

use super::AssessError;
use crate::outbox::WindowJob;
use crate::outliers::{estimate_without_outliers, identify_without_outliers};
use crate::window::Window;

/// What an identification finds in a window.
pub(super) struct Assessed {
    pub(super) estimate: Estimate,
    pub(super) fit: Fit,
    /// Handicaps of the estimate.
    pub(super) reasons: Vec<String>,
}

impl Assessed {
    /// The same with every sigma multiplied: see [`Estimate::widened`].
    pub(super) fn widened(self, factor: f64) -> Self {
        Self {
            estimate: self.estimate.widened(&[factor; FAULT_COUNT]),
            ..self
        }
    }
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
    let mut reasons = Vec::new();
    let (fit, mut found) = match (unit.estimator, &unit.relations, &unit.monitor) {
        (UnitEstimator::Relations, Some(relations), _) => {
            let (fit, found) = by_relations(relations, identifier, job, conditions)?;
            reasons.extend(not_explained(&found.unexplained));
            match &unit.monitor {
                Some(monitor) if may_fall_back(&found, monitor) => {
                    let (fit_of_monitor, of_monitor) = by_monitor(monitor, identifier, job, conditions, seed)?;
                    if of_monitor.estimate.is_unmodelled() {
                        (fit, found)
                    } else {
                        reasons.push("assessed by the monitor".to_owned());
                        (fit_of_monitor, of_monitor)
                    }
                }
                _ => (fit, found),
            }
        }
        (UnitEstimator::Both, Some(relations), Some(monitor)) => {
            let (fit, found) = by_relations(relations, identifier, job, conditions)?;
            let (fit_of_monitor, of_monitor) = by_monitor(monitor, identifier, job, conditions, seed)?;
            reasons.extend(not_explained(&found.unexplained));
            let only_monitor = found.estimate.is_unmodelled() && !of_monitor.estimate.is_unmodelled();
            reasons.extend(only_monitor.then(|| "assessed by the monitor".to_owned()));
            (
                if only_monitor { fit_of_monitor } else { fit },
                of_both(found, of_monitor),
            )
        }
        (_, _, Some(monitor)) => by_monitor(monitor, identifier, job, conditions, seed)?,
        _ => return Err(AssessError::NoEstimator(job.actuator.name.clone())),
    };
    if let (Some(relations), None) = (&unit.relations, found.estimate.inferred.turns) {
        // The monitor infers nothing of a commissioned unit.
        let aligned = AlignedWindow::new(&job.params, &job.window.samples, &job.window.filled);
        let by_relations = estimate_by_relations(relations, &aligned, false);
        if by_relations.unexplained.is_empty() {
            found.estimate.inferred = by_relations.estimate.inferred;
        }
    }
    let motion = motion_of(job);
    let unseen = unit.seen.unseen(&motion, &job.params);
    for _ in &unseen {
        found = found.widened(UNSEEN_FACTOR);
    }
    reasons.extend(not_observable(&found));
    reasons.extend(unseen.iter().map(ToString::to_string));
    Ok(Assessed {
        estimate: found.estimate,
        fit,
        reasons,
    })
}

fn by_relations(
    relations: &UnitRelations,
    identifier: &Identifier,
    job: &mut WindowJob,
    conditions: Conditions,
) -> Result<(Fit, UnitEstimate), AssessError> {
    let params = job.params;
    let estimate = |window: &Window, prepared: &Prepared| {
        let aligned = AlignedWindow::new(&params, &window.samples, &window.filled);
        let is_locked = identifier.is_locked(prepared, conditions);
        Ok::<_, AssessError>(estimate_by_relations(relations, &aligned, is_locked))
    };
    let (prepared, found) = estimate_without_outliers(identifier, &mut job.window, conditions, estimate, |found| {
        &found.estimate
    })?;
    Ok((identifier.fit(&prepared, conditions, &found.estimate), found))
}

fn by_monitor(
    monitor: &UnitMonitor,
    identifier: &Identifier,
    job: &mut WindowJob,
    conditions: Conditions,
    seed: u64,
) -> Result<(Fit, UnitEstimate), AssessError> {
    let (prepared, estimate) = identify_without_outliers(identifier, &mut job.window, conditions, seed)?;
    // The curve is that of the monitor's own estimate.
    let fit = identifier.fit(&prepared, conditions, &estimate);
    Ok((fit, corrected(monitor, estimate, job.params.sensors.sample_rate)))
}

/// Whether the monitor may explain a window that the torque balance does not: it explains the unit's healthy windows as well as those of
/// its type, and the motor turns.
fn may_fall_back(found: &UnitEstimate, monitor: &UnitMonitor) -> bool {
    found.unexplained.contains(&Relation::TorqueBalance) && !found.estimate.locked && monitor.cost <= USUAL_COST
}

/// The reason that names the relations which do not explain a window. One alone points at what only it reads.
fn not_explained(relations: &[Relation]) -> Option<String> {
    match relations {
        [] => None,
        [alone] => Some(format!(
            "{} alone not explained: check {}",
            name_of(*alone),
            suspects(*alone)
        )),
        several => {
            let names: Vec<&str> = several.iter().copied().map(name_of).collect();
            Some(format!("not explained: {}", names.join(", ")))
        }
    }
}

fn name_of(relation: Relation) -> &'static str {
    match relation {
        Relation::TorqueBalance => "torque balance",
        Relation::Controller => "controller",
        Relation::Transmission => "transmission",
    }
}

/// What a relation reads that no other one depends on as much.
fn suspects(relation: Relation) -> &'static str {
    match relation {
        Relation::TorqueBalance => "phase currents and motor",
        Relation::Controller => "set point and controller",
        Relation::Transmission => "output encoder and gear",
    }
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
        Needed::NarrowPlay => "a narrower play",
        Needed::CommissioningThatShowsIt => "commissioning windows that show it",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_relation_alone_points_at_what_it_reads() {
        assert_eq!(not_explained(&[]), None);
        let alone = not_explained(&[Relation::Transmission]);
        assert_eq!(
            alone.as_deref(),
            Some("transmission alone not explained: check output encoder and gear")
        );
        let both = not_explained(&[Relation::TorqueBalance, Relation::Controller]);
        assert_eq!(both.as_deref(), Some("not explained: torque balance, controller"));
    }
}
