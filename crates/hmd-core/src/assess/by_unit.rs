//! A window of a commissioned unit -> estimate: by its relations, or by the monitor corrected by its baseline.

use ema_identify::effort::{Effort, Request, Stage};
use ema_identify::relations::{Needed, Relation, SinceCommissioning, is_coarsely_sampled};
use ema_identify::unit_calibration::{Seen, UnitCalibration, UnitEstimator, UnitMonitor, UnitRelations, Unseen};
use ema_identify::unit_estimate::{USUAL_COST, UnitEstimate, corrected, estimate_by_relations, of_both};
use ema_identify::{Estimate, Fit, Identifier, Inferred, Prepared};
use ema_models::{ActuatorParams, Conditions, FAULT_COUNT, FaultId};

use super::AssessError;
use super::friction_sigma::{friction_sigma, gear_loss_sigma};
use crate::log_map::Resampling;
use crate::motion::{
    ONE_WAY_FACTOR, UNKNOWN_TEMPERATURE_SIGMA_K, friction_sigma_by_temperature, motion_of, moves_one_way,
};
use crate::outbox::WindowJob;
use crate::outliers::{estimate_without_outliers, identify_without_outliers};
use crate::sample::MeasuredConditions;
use crate::sensor_checks::{Suspect, Suspicion, has_no_sum};
use crate::window::Window;

/// What an identification finds in a window.
#[derive(Debug)]
pub(super) struct Assessed {
    pub(super) estimate: Estimate,
    pub(super) fit: Fit,
    /// Handicaps of the estimate.
    pub(super) reasons: Vec<String>,
    /// A sensor that is suspected and whose error the estimate does without.
    pub(super) suspicion: Option<Suspicion>,
}

impl Assessed {
    /// The same with every sigma multiplied: see [`Estimate::widened`].
    pub(super) fn widened(self, factor: f64) -> Self {
        Self {
            estimate: self.estimate.widened(&[factor; FAULT_COUNT]),
            ..self
        }
    }

    /// The same without these faults: see [`Estimate::without`].
    pub(super) fn without(self, faults: &[FaultId]) -> Self {
        Self {
            estimate: self.estimate.without(faults),
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
    effort: &Effort<'_>,
) -> Result<Option<Assessed>, AssessError> {
    job.window.output_zero_rad = unit.output_zero_rad;
    let mut reasons = Vec::new();
    let measured = job.conditions;
    let motion = motion_of(job);
    let since = SinceCommissioning {
        winding_temp: unit.seen.winding_temp(conditions.winding_temp_deg_c),
        is_other_motion: !unit.seen.is_same_motion(&motion),
        is_other_rate: unit.seen.is_other_rate(&motion),
        measured_load: job.conditions.load_torque_nm,
        gear_loss_sigma: gear_loss_sigma(job),
    };
    let not_explained = |relations: &[Relation]| not_explained(relations, &measured);
    let is_coarser = since.is_other_rate && is_coarsely_sampled(&job.params);
    let of_relations = |job: &mut WindowJob| match &unit.relations {
        Some(relations) => by_relations(relations, identifier, job, conditions, since, effort),
        None => Ok(None),
    };
    let of_monitor = |job: &mut WindowJob, monitor: &UnitMonitor| {
        let found = by_monitor(monitor, identifier, job, conditions, seed, effort)?;
        let factor = if since.is_other_motion {
            factor_in_other_motion(monitor)
        } else {
            1.0
        };
        Ok::<_, AssessError>(found.map(|(fit, found)| (fit, widened_one_way(job, found.widened(factor)))))
    };
    let found = match (unit.estimator, &unit.relations, &unit.monitor) {
        (UnitEstimator::Relations, Some(_), monitor) => match of_relations(job)? {
            Some((fit, found)) => {
                reasons.extend(not_explained(&found.unexplained));
                let fallback = match monitor
                    .as_ref()
                    .filter(|monitor| may_fall_back(&found, monitor, is_coarser))
                {
                    Some(monitor) => of_monitor(job, monitor)?.map(|(fit, by_monitor)| {
                        let factor = factor_beyond_healthy(monitor, &by_monitor);
                        (fit, by_monitor.widened(factor))
                    }),
                    None => None,
                };
                match fallback {
                    Some((fit, by_monitor)) if !by_monitor.estimate.is_unmodelled() => {
                        reasons.push("assessed by the monitor".to_owned());
                        Some((fit, by_monitor.in_place_of(&found)))
                    }
                    _ => Some((fit, found)),
                }
            }
            None => None,
        },
        (UnitEstimator::Both, Some(_), Some(monitor)) => match (of_relations(job)?, of_monitor(job, monitor)?) {
            (Some((fit, found)), Some((fit_of_monitor, of_monitor))) => {
                reasons.extend(not_explained(&found.unexplained));
                let only_monitor = found.estimate.is_unmodelled() && !of_monitor.estimate.is_unmodelled();
                reasons.extend(only_monitor.then(|| "assessed by the monitor".to_owned()));
                let fit = if only_monitor { fit_of_monitor } else { fit };
                Some((fit, of_both(found, of_monitor)))
            }
            (Some((fit, found)), None) => {
                reasons.extend(not_explained(&found.unexplained));
                reasons.push("assessed by the relations".to_owned());
                Some((fit, found))
            }
            (None, of_monitor) => of_monitor,
        },
        (_, relations, Some(monitor)) => match of_monitor(job, monitor)? {
            None if relations.is_some() => {
                let found = of_relations(job)?;
                reasons.extend(found.iter().flat_map(|(_, found)| not_explained(&found.unexplained)));
                reasons.extend(found.is_some().then(|| "assessed by the relations".to_owned()));
                found
            }
            found => found,
        },
        _ => return Err(AssessError::NoEstimator(job.actuator.name.clone())),
    };
    let Some((fit, mut found)) = found else { return Ok(None) };
    let mut suspicion = None;
    if found.estimate.inferred.turns != [None; 3] && has_no_sum(job) {
        let (beside_gain, has_gain) = found.beside_gain_of_one_sensor();
        found = beside_gain;
        suspicion = has_gain.then(gain_of_one_sensor);
    }
    // The monitor infers nothing of a commissioned unit.
    if found.estimate.inferred.turns == [None; 3]
        && let (Some(relations), false) = (&unit.relations, effort.is_short())
    {
        let aligned = job.window.aligned(&job.params, since);
        let by_relations = estimate_by_relations(relations, &aligned, false);
        if by_relations.unexplained.is_empty() {
            found.estimate.inferred = by_relations.estimate.inferred;
        }
    }
    let change_max = unit.seen.torque_change_max(conditions.winding_temp_deg_c);
    let magnet_sigma = unit.seen.magnet_sigma(conditions.winding_temp_deg_c);
    let (without_common, common) = found.without_common_change(change_max);
    found = without_common.with_torque_sigma(magnet_sigma);
    let unseen = unit.seen.unseen(&motion, &job.params);
    let is_rigid = |relations: &UnitRelations| relations.commissioned.balance.shape.compliance.is_rigid();
    for respect in &unseen {
        found = match respect {
            // Errors in amperes, as of offsets, are a larger share of a smaller current.
            Unseen::Current([least, _], current) if current < least => {
                let share = (least / current.max(f64::MIN_POSITIVE)).clamp(respect.factor(), SMALL_CURRENT_FACTOR_MAX);
                found
                    .widened(respect.factor())
                    .widened_in(&OF_THE_ROTOR, share / respect.factor())
            }
            // What is left between coarse samples goes with the phases' shapes.
            Unseen::RotorAngle(_) if unit.relations.as_ref().is_some_and(is_rigid) => {
                found.widened_in(&OF_THE_ROTOR, respect.factor())
            }
            _ => found.widened(respect.factor()),
        };
    }
    // After the factors, which know neither efficiency nor lubricant.
    found = found.with_sigma_in(&[FaultId::Friction], friction_sigma(job, unit));
    if is_interpolated(job) {
        found = found.with_sigma_in(&OF_THE_ROTOR, interpolation_sigma(&job.params));
    }
    // Last: what a common gain leaves open of one short is no doubt of another.
    if let Some(common) = common {
        found = found.with_common_ambiguity(common.value, change_max);
        reasons.extend(common_change(&common, change_max, magnet_sigma));
    }
    reasons.extend(not_observable(&found));
    reasons.extend(unseen.iter().map(ToString::to_string));
    reasons.extend(without_temperature(job, &unit.seen));
    Ok(Some(Assessed {
        estimate: found.estimate,
        fit,
        reasons,
        suspicion,
    }))
}

/// Sigma of friction, from which on it is said that it is that large for want of a temperature.
const TOLD_SIGMA: f64 = 0.01;

/// What is said where the winding temperature of a window or of commissioning is not known.
fn without_temperature(job: &WindowJob, seen: &Seen) -> Option<String> {
    let is_known = seen.winding_temp_deg_c.is_some() && job.conditions.winding_temp_deg_c.is_some();
    let sigma = friction_sigma_by_temperature(job, seen.winding_temp_deg_c);
    (!is_known && sigma >= TOLD_SIGMA).then(|| {
        format!("no winding temperature, here or at commissioning: friction ± {sigma:.2} for {UNKNOWN_TEMPERATURE_SIGMA_K:.0} K")
    })
}

/// What is said of a gain of one current sensor that shorts alone do not explain.
fn gain_of_one_sensor() -> Suspicion {
    let suspect = Suspect::PhaseGain;
    Suspicion {
        suspect,
        sentence: format!(
            "{suspect}: no shorts alone explain the torque, the gain of one current sensor does; no sum of the phases tells which one, nor how \
             much of it is a short"
        ),
    }
}

/// Change of the torque for each ampere of all phases that a window states: twice the usual tolerance of the gain of a sensor.
const COMMON_CHANGE: f64 = 0.02;

/// Standard deviations by which it is clear.
const COMMON_SIGMAS: f64 = 4.0;

/// The reason that names what a change of all phases may be, beyond what the temperature explains.
fn common_change(common: &Inferred, change_max: f64, magnet_sigma: f64) -> Option<String> {
    let change = common.value - 1.0;
    let clear = COMMON_SIGMAS * common.sigma.hypot(magnet_sigma);
    (change.abs() > change_max + COMMON_CHANGE.max(clear)).then(|| {
        let or_shorts = if change < 0.0 {
            format!(", weaker magnets, or shorts of {:.2} in all phases", -change)
        } else {
            ", or stronger magnets".to_owned()
        };
        format!(
            "ambiguous: torque of all phases {:.3} ± {:.3} times that of the commissioned unit: a gain of all current sensors, another inertia{or_shorts}",
            common.value, common.sigma
        )
    })
}

/// Whether the angles of a window were interpolated at the times of its currents.
fn is_interpolated(job: &WindowJob) -> bool {
    let log = job.actuator.log.as_ref();
    log.is_some_and(|log| log.resampling() == Some(Resampling::AtCurrents))
}

/// One standard deviation of a damage of the rotor by angles that were interpolated, at 2 kHz, and the power of the time between samples
/// with which it grows: of `bench`, mixed motion, angles at half the rate, shorts are off by up to 0.006 at 2 kHz, 0.027 at 1 kHz and 0.09 at
/// 500 Hz.
const INTERPOLATION_SIGMA: f64 = 0.003;

fn interpolation_sigma(params: &ActuatorParams) -> f64 {
    let slower = 2000.0 / params.sensors.sample_rate;
    INTERPOLATION_SIGMA * slower * slower
}

/// Largest factor on the sigmas of the rotor's faults for a small current.
const SMALL_CURRENT_FACTOR_MAX: f64 = 10.0;

/// Faults whose torque goes with the rotor's electrical angle.
pub(super) const OF_THE_ROTOR: [FaultId; 4] =
    [FaultId::ShortA, FaultId::ShortB, FaultId::ShortC, FaultId::Eccentricity];

/// None where no time is granted for it, as for the monitor.
fn by_relations(
    relations: &UnitRelations,
    identifier: &Identifier,
    job: &mut WindowJob,
    conditions: Conditions,
    since: SinceCommissioning,
    effort: &Effort<'_>,
) -> Result<Option<(Fit, UnitEstimate)>, AssessError> {
    let params = job.params;
    let (stage, window_s, runs) = (Stage::Relations, job.length_s(), 1);
    let request = Request {
        stage,
        window_s,
        runs,
        reserved: 0,
    };
    if effort.grant(&request) < runs {
        return Ok(None);
    }
    let estimate = |window: &Window, prepared: &Prepared| {
        let aligned = window.aligned(&params, since);
        let is_locked = identifier.is_locked(prepared, conditions);
        Ok::<_, AssessError>(estimate_by_relations(relations, &aligned, is_locked))
    };
    let (fit, found) = estimate_without_outliers(identifier, &mut job.window, conditions, estimate, |found| {
        Some(&found.estimate)
    })?;
    effort.ran(stage, window_s, runs);
    Ok(Some((fit, found)))
}

fn by_monitor(
    monitor: &UnitMonitor,
    identifier: &Identifier,
    job: &mut WindowJob,
    conditions: Conditions,
    seed: u64,
    effort: &Effort<'_>,
) -> Result<Option<(Fit, UnitEstimate)>, AssessError> {
    let found = identify_without_outliers(identifier, &mut job.window, conditions, seed, effort)?;
    Ok(found.map(|(fit, estimate)| {
        // The curve is that of the monitor's own estimate.
        (fit, corrected(monitor, estimate, job.params.sensors.sample_rate))
    }))
}

/// An estimate of the monitor with the sigma of its friction in the motion of its window.
fn widened_one_way(job: &WindowJob, found: UnitEstimate) -> UnitEstimate {
    if moves_one_way(job) {
        found.widened_in(&[FaultId::Friction], ONE_WAY_FACTOR)
    } else {
        found
    }
}

/// Factor on the sigmas of the monitor in a motion that commissioning has not seen. What the monitor does not explain of the healthy windows
/// repeats with their motion and stands in no scatter; how much that is, its cost says.
fn factor_in_other_motion(monitor: &UnitMonitor) -> f64 {
    (monitor.cost / USUAL_COST).max(1.0)
}

/// Factor on the sigmas of the monitor in a window that the relations do not explain: by how much it misses this window more than the healthy ones.
/// An error of a current sensor, which the torque balance shows, is no fault of the monitor's either.
fn factor_beyond_healthy(monitor: &UnitMonitor, found: &UnitEstimate) -> f64 {
    (found.estimate.cost / monitor.cost).max(1.0)
}

/// Whether the monitor may explain a window that the torque balance does not, or hardly does, where samples are coarser than at
/// commissioning: it explains the unit's healthy windows as well as those of its type, and the motor turns.
fn may_fall_back(found: &UnitEstimate, monitor: &UnitMonitor, is_coarser: bool) -> bool {
    let is_open = is_coarser || found.unexplained.contains(&Relation::TorqueBalance);
    is_open && !found.estimate.locked && monitor.cost <= USUAL_COST
}

/// The reason that names the relations which do not explain a window. One alone points at what only it reads.
fn not_explained(relations: &[Relation], measured: &MeasuredConditions) -> Option<String> {
    match relations {
        [] => None,
        [alone] => Some(format!(
            "{} alone not explained: check {}{}",
            name_of(*alone),
            suspects(*alone),
            if *alone == Relation::TorqueBalance {
                not_measured(measured)
            } else {
                ""
            }
        )),
        several => {
            let names: Vec<&str> = several.iter().copied().map(name_of).collect();
            Some(format!("not explained: {}", names.join(", ")))
        }
    }
}

/// What else the torque may depend on, as far as nobody measures it.
fn not_measured(measured: &MeasuredConditions) -> &'static str {
    match (measured.winding_temp_deg_c, measured.load_torque_nm) {
        (None, None) => ", and temperature and load, which are not measured",
        (None, Some(_)) => ", and the temperature, which is not measured",
        (Some(_), None) => ", and the load, which is not measured",
        (Some(_), Some(_)) => "",
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

/// The reason that names the faults of which the window tells nothing, each with what it needed where that is known: a window that a relation
/// does not explain would not show them with longer motion or more current.
fn not_observable(found: &UnitEstimate) -> Option<String> {
    let names: Vec<String> = FaultId::ALL
        .into_iter()
        .filter(|fault| found.estimate.sigma[fault.parameter()].is_none())
        .map(
            |fault| match found.needed[fault.parameter()].filter(|_| found.unexplained.is_empty()) {
                Some(needed) => format!("{} (needs {})", fault.name(), needed_in_words(needed)),
                None => fault.name().to_owned(),
            },
        )
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
        Needed::OpenReversal => "a reversal without a load that closes the play",
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
    fn a_change_of_all_phases_names_what_it_may_be() {
        let of = |value: f64, change_max: f64| common_change(&Inferred { value, sigma: 0.004 }, change_max, 0.0);
        assert_eq!(of(0.985, 0.0), None);
        assert_eq!(of(0.96, 0.09), None);
        assert_eq!(
            of(0.96, 0.0).as_deref(),
            Some(
                "ambiguous: torque of all phases 0.960 ± 0.004 times that of the commissioned unit: a gain of all current sensors, another \
                 inertia, weaker magnets, or shorts of 0.04 in all phases"
            )
        );
        let more = of(1.05, 0.0).unwrap();
        assert!(more.ends_with("another inertia, or stronger magnets"), "{more}");
    }

    #[test]
    fn one_relation_alone_points_at_what_it_reads() {
        let measured = MeasuredConditions::default();
        let not_explained = |relations: &[Relation]| not_explained(relations, &measured);
        assert_eq!(not_explained(&[]), None);
        let torque = not_explained(&[Relation::TorqueBalance]);
        assert_eq!(
            torque.as_deref(),
            Some(
                "torque balance alone not explained: check phase currents and motor, and temperature and load, which are not measured"
            )
        );
        let alone = not_explained(&[Relation::Transmission]);
        assert_eq!(
            alone.as_deref(),
            Some("transmission alone not explained: check output encoder and gear")
        );
        let both = not_explained(&[Relation::TorqueBalance, Relation::Controller]);
        assert_eq!(both.as_deref(), Some("not explained: torque balance, controller"));
    }
}
