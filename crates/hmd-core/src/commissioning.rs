//! Commissioning of one unit: healthy windows of it -> what it is like, and with what its later windows are assessed.
//!
//! In: windows of one unit that are fit for an assessment and healthy on the operator's word, and the calibrations of their type.
//! Out: the [`UnitCalibration`], or why the windows do not suffice. Both estimators learn the unit where they can: the relations
//! between measured signals (`by_relations`), and the monitor with the unit's parameters (`by_monitor`). What they say of windows
//! from which they did not learn decides which one assesses the unit (`evidence`). CPU-bound.

mod by_monitor;
mod by_relations;
mod by_type;
mod evidence;
mod findings;
mod words;

use ema_identify::relations::{CommissionError, CommissionedRelations, is_coarsely_sampled};
use ema_identify::unit_calibration::{RATE_MARGIN, Seen, UNIT_VERSION, UnitError};
use ema_identify::unit_fit::WINDOWS_MIN;
use ema_identify::{is_unmodelled, output_zero};
use ema_models::{ActuatorParams, DriveKind, FaultId};

use crate::assess::{AssessError, Assessor, conditions, gain_sigma, hash_of_type};
use crate::health::Levels;
use crate::motion::{friction_sigma_by_temperature, motion_of};
use crate::outbox::WindowJob;
use crate::sensor_health::commissioned_sensors;
use by_monitor::{CURRENT_TIME_CONSTANTS_S, MonitorLearnt, learn_monitor};
use by_relations::{RelationsLearnt, learn_relations};
use evidence::Evidence;

pub use by_type::{SeenByType, health_by_type};
pub use ema_identify::relations::{Curve, CurvePoint, Relation};
pub use ema_identify::unit_calibration::{UnitCalibration, UnitEstimator};
pub use findings::{Findings, FoundParameter, HealthyWindow};
pub use words::in_words;

/// Why a unit was not commissioned.
#[derive(Debug, thiserror::Error)]
pub enum CommissioningError {
    /// Not enough windows.
    #[error("expected at least {WINDOWS_MIN} windows that can be assessed, found {0}")]
    TooFew(usize),
    /// Windows of several sampling rates.
    #[error("expected windows of one sampling rate, found {first:.1} and {other:.1} samples/s")]
    Rates {
        /// Of the first window, Hz.
        first: f64,
        /// Of a later one, Hz.
        other: f64,
    },
    /// A measurement is beyond what an actuator can have been working with.
    #[error("window {window}: {sentence}")]
    Conditions {
        /// Number of the window.
        window: u64,
        /// What is beyond.
        sentence: String,
    },
    /// Most windows show a fault that calls for a repair.
    #[error("expected windows in health, found {0}: repair the unit, correct the type, or widen its tolerances")]
    Worn(String),
    /// A parameter of the unit is far from that of its type.
    #[error("{0}")]
    Parameter(FarParameter),
    /// The relations cannot be learnt, nor does the monitor explain the windows.
    #[error("{relations}; and no motor of type {type_name} explains the windows: cost {cost:.0}")]
    Unmodelled {
        /// Why the relations cannot be learnt.
        relations: CommissionError,
        /// Name of the type.
        type_name: String,
        /// Mean cost of the windows.
        cost: f64,
    },
    /// Neither the relations nor the monitor can be learnt.
    #[error("{0}; and the windows do not determine the motor")]
    Undetermined(CommissionError),
    /// What was learnt is no calibration that a later run would take.
    #[error("the windows do not determine the unit: {0}")]
    Unusable(UnitError),
    /// The configuration cannot be used.
    #[error(transparent)]
    Assess(#[from] AssessError),
}

impl CommissioningError {
    /// Whether the windows are the reason, and not the settings.
    #[must_use]
    pub fn is_by_windows(&self) -> bool {
        !matches!(self, Self::Assess(_))
    }
}

/// A parameter that is more than five of its tolerances away from its type.
#[derive(Clone, Debug, PartialEq)]
pub struct FarParameter {
    /// Name of the type.
    pub type_name: String,
    /// Key in the type's section.
    pub key: &'static str,
    /// Value of the type.
    pub of_type: f64,
    /// What the windows show.
    pub found: f64,
    /// Tolerance, one standard deviation, in the unit of the value.
    pub tolerance: f64,
}

/// Key of the play.
const PLAY: &str = "transmission.backlash_rad";

/// Tolerances from its type within which a parameter must be.
const TOLERANCES_MAX: f64 = 5.0;

impl FarParameter {
    /// Which number, and how far it is from the type.
    fn distance(&self) -> String {
        let Self {
            type_name,
            key,
            of_type,
            found,
            tolerance,
        } = self;
        format!(
            "type.{type_name}.{key}: expected {of_type} within {TOLERANCES_MAX} tolerances of {tolerance:.2e}, found {} ({:.0} tolerances \
             away)",
            significant(*found),
            (found - of_type).abs() / tolerance
        )
    }
}

impl std::fmt::Display for FarParameter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{}; a wrong number elsewhere looks the same: check gear ratio, counts, zero of the resolver and sample rate first",
            self.distance()
        )?;
        if self.found > 0.0 {
            write!(
                f,
                ", then set {} to what the unit has, or widen its tolerance",
                self.key
            )?;
        }
        Ok(())
    }
}

/// A number to four significant digits.
fn significant(number: f64) -> f64 {
    format!("{number:.3e}").parse().unwrap_or(number)
}

/// A commissioned unit, and what an operator should read of it.
#[derive(Clone, Debug)]
pub struct Commissioned {
    /// What was learnt.
    pub calibration: UnitCalibration,
    /// Sentences about it.
    pub notes: Vec<String>,
    /// What was found, for a report.
    pub findings: Findings,
}

/// Commissions one unit by its healthy windows. `levels` are those of the configuration; `progress` gets a number of windows whenever
/// so many more are done, [`windows_of_work`] of them in all.
///
/// # Errors
/// [`CommissioningError`].
pub fn calibrate_unit(
    assessor: &Assessor,
    levels: &[Levels; FaultId::COUNT],
    jobs: &mut [WindowJob],
    seed: u64,
    progress: &dyn Fn(u64),
) -> Result<Commissioned, CommissioningError> {
    if jobs.len() < WINDOWS_MIN {
        return Err(CommissioningError::TooFew(jobs.len()));
    }
    for job in &*jobs {
        let window = job.window.number;
        conditions(job).map_err(|sentence| CommissioningError::Conditions { window, sentence })?;
    }
    let first = jobs[0].params.sensors.sample_rate;
    let mut rates = jobs.iter().map(|job| job.params.sensors.sample_rate);
    if let Some(other) = rates.find(|rate| (rate / first - 1.0).abs() > RATE_MARGIN) {
        return Err(CommissioningError::Rates { first, other });
    }
    // By the windows as they came: what follows repairs them.
    let sensors = commissioned_sensors(jobs);
    let windows = jobs.iter().map(|job| job.window.samples.as_slice());
    let output_zero_rad = output_zero(&jobs[0].params, windows);
    for job in &mut *jobs {
        job.window.output_zero_rad = output_zero_rad;
    }
    let motions: Vec<_> = jobs.iter().map(motion_of).collect();
    let seen = Seen::of(&motions);
    let mut by_relations = learn_relations(jobs, &seen);
    progress(jobs.len() as u64);
    let is_vector = jobs[0].actuator.drive.kind == DriveKind::Vector;
    // Relations that show all well assess the unit, whatever the monitor says: it is learnt for what it says of the motor, by the drive of
    // the type, and not at all where that has no comparators.
    let suffice = by_relations
        .as_ref()
        .is_ok_and(|learnt| learnt.evidence.shows_all_well() && learnt.far_parameter(&jobs[0]).is_none());
    let mut by_monitor = match (suffice, is_vector) {
        // The monitor follows the set point.
        _ if !jobs[0].actuator.has_set_point() => None,
        (true, true) => None,
        (true, false) => learn_monitor(assessor, jobs, &CURRENT_TIME_CONSTANTS_S[..1], seed, progress)?,
        (false, _) => learn_monitor(assessor, jobs, &CURRENT_TIME_CONSTANTS_S, seed, progress)?,
    };
    let actuator = &jobs[0].actuator;
    if let Some(log) = &actuator.log {
        let of_relations = by_relations.as_mut().ok().map(|learnt| &mut learnt.evidence);
        let of_monitor = by_monitor.as_mut().map(|learnt| &mut learnt.evidence);
        for evidence in of_relations.into_iter().chain(of_monitor) {
            evidence.hide(log.gaps().flat_map(|gap| gap.hides()));
        }
    }
    let Choice {
        estimator,
        reason,
        mut evidence,
    } = choose(&jobs[0], is_vector, by_relations.as_ref(), by_monitor.as_ref())?;
    evidence.widen(FaultId::Gain, gain_sigma(&jobs[0].params, seen.setpoint_held_s));
    if seen.winding_temp_deg_c.is_none() {
        let unknown = friction_sigma_by_temperature(&jobs[0], None);
        evidence.widen(FaultId::Friction, unknown);
    }
    let mut notes = Vec::new();
    if let (UnitEstimator::Relations, Some(monitor)) = (estimator, &by_monitor)
        && let Some(far) = monitor.far_parameter(&jobs[0])
    {
        // Where the relations explain the unit, this says more of the monitor than of the unit.
        notes.push(format!(
            "the monitor is not used: it follows these windows only with {}",
            far.distance()
        ));
    }
    if let (UnitEstimator::Monitor | UnitEstimator::Both, Some(monitor)) = (estimator, &by_monitor) {
        // They may stand for what the monitor's controller lacks.
        let far = monitor.far_of_controller(&jobs[0]);
        notes.extend(
            far.iter()
                .map(|far| format!("the monitor's controller stands for the unit's: {}", far.distance())),
        );
    }
    let findings = findings(
        jobs,
        &seen,
        estimator,
        &evidence,
        by_relations.as_ref().ok(),
        by_monitor.as_ref(),
    );
    let is_compliant = |learnt: &RelationsLearnt| !learnt.unit.commissioned.balance.shape.compliance.is_rigid();
    let by_angle = by_relations.as_ref().is_ok_and(is_compliant) || is_coarsely_sampled(&jobs[0].params);
    let seen = if by_angle { seen.with_sectors(&motions) } else { seen };
    if seen.rotor_sectors.is_some() {
        notes.push(
            "windows that begin at other rotor angles will have larger sigmas: record from several positions, in both directions"
                .to_owned(),
        );
    }
    if let Ok(learnt) = &by_relations {
        notes.extend(of_gear(&learnt.unit.commissioned, &jobs[0].params));
    }
    let calibration = UnitCalibration {
        version: UNIT_VERSION,
        made_by: concat!("hmd ", env!("CARGO_PKG_VERSION")).to_owned(),
        actuator_type: actuator.type_name.clone(),
        parameters_hash: hash_of_type(actuator),
        part_number: actuator.part_number.clone(),
        serial_number: actuator.serial_number.clone(),
        windows: jobs.len() as u32,
        estimator,
        estimator_reason: reason,
        output_zero_rad,
        seen,
        smallest_damage: evidence.smallest_damage(levels),
        // A parameter far from its type is not written.
        monitor: by_monitor
            .filter(|learnt| learnt.far_parameter(&jobs[0]).is_none())
            .map(|learnt| learnt.unit),
        relations: by_relations
            .ok()
            .filter(|learnt| learnt.far_parameter(&jobs[0]).is_none())
            .map(|learnt| learnt.unit),
        sensors: Some(sensors),
    };
    // What a later run would refuse is not written.
    let calibration = UnitCalibration::parse(&calibration.emit(), &actuator.name, &actuator.type_name)
        .map_err(CommissioningError::Unusable)?;
    Ok(Commissioned {
        calibration,
        notes,
        findings,
    })
}

/// What an operator should know of the gear and of what it moves.
fn of_gear(learnt: &CommissionedRelations, params: &ActuatorParams) -> Vec<String> {
    let mut notes = Vec::new();
    if learnt.may_bend {
        notes.push(
            "the gear may bend: a spring explains some of what a rigid gear leaves, the play hides the rest; shorts and eccentricity have three \
             times the sigma, and a play is read by its reach"
                .to_owned(),
        );
    }
    let gear = &params.transmission;
    let error = learnt.load_error.unwrap_or(0.0);
    if error > gear.friction_dynamic * gear.gear_ratio {
        notes.push(format!(
            "the load that is measured and the one that the motion needs differ by {error:.1} N m more than chance explains: later windows doubt the \
             load sensor only beyond that"
        ));
    }
    notes
}

/// What was found, by the estimator that assesses the unit.
fn findings(
    jobs: &[WindowJob],
    seen: &Seen,
    estimator: UnitEstimator,
    evidence: &Evidence,
    relations: Option<&RelationsLearnt>,
    monitor: Option<&MonitorLearnt>,
) -> Findings {
    let (curves_window, curves) =
        relations.map_or((0, Vec::new()), |learnt| findings::curves(jobs, &learnt.unit, seen));
    let of_monitor = monitor.map(|learnt| findings::windows_by_monitor(jobs, &learnt.unit, &learnt.estimates));
    let of_relations = relations.map(|learnt| findings::windows_by_relations(jobs, &learnt.unit, &learnt.left_out));
    let windows = match (estimator, of_relations, of_monitor) {
        (UnitEstimator::Both, Some(relations), Some(monitor)) => findings::windows_by_both(relations, &monitor),
        (UnitEstimator::Monitor, _, Some(windows)) | (_, Some(windows), _) => windows,
        _ => Vec::new(),
    };
    let needed: Vec<_> = relations
        .filter(|_| estimator != UnitEstimator::Monitor)
        .map(|learnt| learnt.left_out.iter().map(|found| found.needed).collect())
        .unwrap_or_default();
    let mut needed = findings::needed(&needed);
    for fault in FaultId::ALL {
        if evidence.shows(fault) {
            needed[fault.index()] = None;
        }
    }
    Findings {
        parameters: findings::parameters(
            &jobs[0],
            relations.map(|learnt| &learnt.unit),
            monitor
                .filter(|learnt| learnt.far_parameter(&jobs[0]).is_none())
                .map(|learnt| &learnt.unit),
        ),
        curves_window,
        curves,
        windows,
        needed,
    }
}

/// Windows of work of [`calibrate_unit`] for so many windows.
#[must_use]
pub fn windows_of_work(windows: usize) -> u64 {
    2 * windows as u64
}

/// What assesses the unit.
struct Choice {
    estimator: UnitEstimator,
    reason: String,
    evidence: Evidence,
}

impl Choice {
    fn new(estimator: UnitEstimator, reason: impl Into<String>, evidence: &Evidence) -> Self {
        Self {
            estimator,
            reason: reason.into(),
            evidence: evidence.clone(),
        }
    }
}

/// What assesses the unit: the relations, where they show every fault as well as the monitor; the monitor, where it shows some clearly
/// better and none worse; else both.
///
/// # Errors
/// None serves, or a parameter of the unit that the estimator uses is far from its type.
fn choose(
    job: &WindowJob,
    is_vector: bool,
    relations: Result<&RelationsLearnt, &CommissionError>,
    monitor: Option<&MonitorLearnt>,
) -> Result<Choice, CommissioningError> {
    let monitor_far = monitor.and_then(|learnt| learnt.far_parameter(job));
    if let (Some(far), Some(learnt), false) = (&monitor_far, monitor, is_vector)
        && learnt.is_certain(&job.actuator.tolerances)
    {
        return Err(CommissioningError::Parameter(far.clone()));
    }
    let usable = monitor.filter(|_| monitor_far.is_none());
    // Windows like the healthy ones would be unmodelled.
    let sound = usable.filter(|learnt| learnt.evidence.is_sound() && !is_unmodelled(learnt.unit.cost));
    let error = match relations {
        Ok(relations) => match (relations.far_parameter(job), sound) {
            // The two angles show it, whatever else the relations lack.
            (Some(far), _) if far.key == PLAY => return Err(CommissioningError::Parameter(far)),
            (Some(far), Some(monitor)) => {
                let reason = format!("the relations are not used: {far}");
                return Ok(Choice::new(UnitEstimator::Monitor, reason, &monitor.evidence));
            }
            (Some(far), None) => return Err(CommissioningError::Parameter(far)),
            (None, _) => return Ok(of_relations(is_vector, relations, usable, sound)),
        },
        Err(error) => *error,
    };
    match (sound, usable) {
        (Some(monitor), _) => Ok(Choice::new(
            UnitEstimator::Monitor,
            error.to_string(),
            &monitor.evidence,
        )),
        (None, Some(monitor)) => Err(CommissioningError::Unmodelled {
            relations: error,
            type_name: job.actuator.type_name.clone(),
            cost: monitor.unit.cost,
        }),
        (None, None) => Err(match monitor_far {
            Some(far) => CommissioningError::Parameter(far),
            None => CommissioningError::Undetermined(error),
        }),
    }
}

/// The choice where the relations were learnt, and no parameter of theirs is far from the type.
fn of_relations(
    is_vector: bool,
    relations: &RelationsLearnt,
    usable: Option<&MonitorLearnt>,
    sound: Option<&MonitorLearnt>,
) -> Choice {
    if let Some(monitor) = sound {
        let mut of_monitor = monitor.evidence.clone();
        if relations.is_play_closed() {
            of_monitor.hide([FaultId::Backlash].iter());
        }
        let is_better = of_monitor.is_clearly_better_somewhere(&relations.evidence);
        let is_worse = of_monitor.is_worse_somewhere(&relations.evidence);
        let reason = format!(
            "the monitor shows {} of {} faults, the relations {}",
            monitor.evidence.shown(),
            FaultId::COUNT,
            relations.evidence.shown()
        );
        if !relations.evidence.is_sound() || is_better && !is_worse {
            return Choice::new(UnitEstimator::Monitor, reason, &monitor.evidence);
        }
        if is_better {
            let evidence = relations.evidence.of_both(&of_monitor);
            return Choice::new(UnitEstimator::Both, reason, &evidence);
        }
    }
    let reason = match (is_vector, usable) {
        (true, _) => "vector drive".to_owned(),
        (false, Some(learnt)) => format!("the monitor explains the unit with cost {:.1}", learnt.unit.cost),
        (false, None) => "the monitor does not explain the unit".to_owned(),
    };
    Choice::new(UnitEstimator::Relations, reason, &relations.evidence)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_that_no_unit_has_is_not_advised() {
        let far = |found: f64| {
            let far = FarParameter {
                type_name: "bench".to_owned(),
                key: PLAY,
                of_type: 1e-3,
                found,
                tolerance: 1e-4,
            };
            far.to_string()
        };
        let (wide, negative) = (far(3e-3), far(-3e-3));
        assert!(
            wide.contains("; a wrong number elsewhere looks the same: check gear ratio, counts,"),
            "{wide}"
        );
        let advice = ", then set transmission.backlash_rad to what the unit has, or widen its tolerance";
        assert!(wide.ends_with(advice), "{wide}");
        assert!(negative.ends_with("sample rate first"), "{negative}");
    }
}
