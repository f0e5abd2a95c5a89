//! Windows -> records: identification, then the health decision and the forecast. CPU-bound; runs on the identification thread.
//!
//! Goes in: the windows of all actuators ([`WindowJob`]), in their order, and the calibrations ([`Models`]). Comes out: the
//! records of each window ([`AssessedWindow`]).

mod begun;
mod by_signals;
mod by_unit;
mod coarse_setpoint;
mod coarse_steps;
mod conditions;
mod estimator;
mod explained;
mod friction_sigma;
mod method;
mod models;
mod reasons;
mod records;

use std::collections::BTreeSet;
use std::sync::Arc;

use ema_models::{Conditions, FaultId, FaultVector, MotorKnowledge, SensedSample, Setpoint, Tolerances};

use crate::config::{ActuatorConfig, Config};
use crate::deadline::TimeLimit;
use crate::functional_check::{CHECK_LANES, unmet_requirements};
use crate::health::{DamageEvidence, HealthState};
use crate::history::{HistoryStore, WindowEvidence};
use crate::outbox::WindowJob;
use crate::record::{self, WindowStatus};
use crate::sensor_checks::{Suspect, sensor_readings};
use crate::window::WindowQuality;
use crate::windows_in_a_row::{News, WindowsInARow};
use coarse_steps::with_steps;
use ema_identify::effort::Effort;
use ema_identify::unit_calibration::{CommissionedSensors, RATE_MARGIN, UnitCalibration};
use ema_identify::{Estimate, Fit, Identifier, Method, Prepared};
use explained::Explained;
use reasons::{ambiguous, cut_by_deadline, too_uncertain};
use records::{health_record, rul_record, sensors_record, shortened_record, window_record};

pub use begun::{BegunWindow, ExplainedWindow};
pub(crate) use by_unit::needed_in_words;
pub(crate) use coarse_setpoint::gain_sigma;
pub use ema_identify::LOCKED;

pub use conditions::{conditions, motor_knowledge_at, motor_within};
pub use estimator::{Estimator, Identification};
pub use method::method;
pub use models::{
    AssessError, Models, ReadText, TypeModel, check_serial, hash_of_parameters, hash_of_type, model_hash,
};

/// Assesses the windows of all actuators, in the order in which they come.
#[derive(Debug)]
pub struct Assessor {
    config: Arc<Config>,
    method: Method,
    seed: u64,
    models: Models,
    estimator: Arc<dyn Estimator>,
    histories: HistoryStore,
    counts: WindowCounts,
    /// Actuators whose calibration was learnt before a recorded replacement, and taken away.
    outdated: BTreeSet<String>,
}

/// What is done about a unit that is to be learnt.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LearningProgress {
    /// Nothing: it is known, or is not to be learnt.
    NotToLearn,
    /// It is being learnt: for this reason health is unknown, and no damage counts.
    Learns(String),
    /// For this reason it is not learnt yet: it is assessed as a unit that is not commissioned.
    Waits(String),
}

/// Windows by status.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WindowCounts {
    /// Identified without handicap.
    pub ok: u64,
    /// Identified with one.
    pub degraded: u64,
    /// Not fit for an assessment.
    pub invalid: u64,
    /// Good data that no fault vector explains.
    pub unmodelled: u64,
}

/// The records of one window.
#[derive(Clone, Debug)]
pub struct AssessedWindow {
    /// The samples, and the fit.
    pub window: record::Window,
    /// Health of the actuator by this window.
    pub health: record::Health,
    /// Remaining useful life; without numbers until there is a trend.
    pub rul: record::Rul,
    /// Health of the sensors.
    pub sensors: record::Sensors,
    /// Sensors, wires and configured numbers that may be wrong; the reasons of the records hold their sentences.
    pub suspects: Vec<Suspect>,
    /// Whether its type is calibrated, or its unit commissioned.
    pub is_calibrated: bool,
    /// Damage that the window shows, whether or not it counts: while a unit is learnt it does not.
    pub damage_evidence: Option<DamageEvidence>,
    /// What a deadline left of the identification, where it left less than all.
    pub shortened: Option<record::Shortened>,
    /// What the newest windows of the actuator have in common, up to this one.
    pub in_a_row: WindowsInARow,
    /// What became news by that.
    pub news: Vec<News>,
    /// By what it was assessed, where the daemon learns the unit.
    pub unit: record::UnitMark,
    /// Times of the maintenance events that were followed with it, UTC ns.
    pub events_ns: Vec<u64>,
}

impl Assessor {
    /// For a configuration, what its windows are assessed with, and the seed of every search.
    #[must_use]
    pub fn new(config: Arc<Config>, models: Models, seed: u64) -> Self {
        let method = method(config.identification());
        Self {
            histories: HistoryStore::new(config.clone()),
            config,
            method,
            seed,
            models,
            estimator: Arc::new(Identification),
            counts: WindowCounts::default(),
            outdated: BTreeSet::new(),
        }
    }

    /// The same with another estimator than [`Identification`] for units that are not commissioned.
    #[must_use]
    pub fn with_estimator(self, estimator: Arc<dyn Estimator>) -> Self {
        Self { estimator, ..self }
    }

    /// Histories of all actuators.
    pub fn histories(&mut self) -> &mut HistoryStore {
        &mut self.histories
    }

    /// Windows so far.
    #[must_use]
    pub fn counts(&self) -> WindowCounts {
        self.counts
    }

    /// Whether a unit was commissioned.
    #[must_use]
    pub fn knows_unit(&self, actuator: &ActuatorConfig) -> bool {
        self.models.unit(actuator).is_some()
    }

    /// Assesses the later windows of an actuator by what was learnt of its unit.
    pub fn set_unit(&mut self, actuator: &str, unit: UnitCalibration) {
        self.outdated.remove(actuator);
        self.models.set_unit(actuator, unit);
    }

    /// Assesses the later windows of an actuator as those of a unit of which nothing was learnt.
    pub fn remove_unit(&mut self, actuator: &str) {
        self.models.remove_unit(actuator);
    }

    /// Whether an actuator was commissioned before its unit or a part of it was replaced, by the maintenance events up to the time of a window:
    /// what was learnt is of another unit then. Calibrations of before that say no time are taken as they are.
    #[must_use]
    pub fn is_outdated(&self, actuator: &ActuatorConfig, t_ns: u64) -> bool {
        let sensors = self.models.unit(actuator).and_then(|unit| unit.sensors.as_ref());
        let until_ns = sensors.map(|sensors| u64::try_from(sensors.until_ns).unwrap_or(0));
        until_ns.is_some_and(|until_ns| self.histories.is_replaced_between(actuator, until_ns, t_ns))
    }

    /// Identifies a window and decides on health. The same job, seed and history give the same records on any number of
    /// threads.
    ///
    /// # Errors
    /// [`AssessError`] when the configuration cannot be used at all; a bad window is a record, not an error.
    pub fn assess(&mut self, job: WindowJob) -> Result<AssessedWindow, AssessError> {
        self.assess_within(job, &TimeLimit::none(), &LearningProgress::NotToLearn)
    }

    /// The same with the work that a limit grants, and for a unit that is to be learnt. The same job, seed, history and grants give the same
    /// records.
    ///
    /// # Errors
    /// As [`Assessor::assess`].
    pub fn assess_within(
        &mut self,
        job: WindowJob,
        limit: &TimeLimit<'_>,
        progress: &LearningProgress,
    ) -> Result<AssessedWindow, AssessError> {
        let begun = self.begin(job, progress.clone());
        let explained = self.explain_begun(begun, limit)?;
        self.conclude(explained, limit)
    }

    /// Begins the assessment of a window, whose unit is to be learnt or not.
    pub fn begin(&mut self, job: WindowJob, progress: LearningProgress) -> BegunWindow {
        if self.is_outdated(&job.actuator, job.window.t_start_ns) {
            let name = &job.actuator.name;
            self.models.remove_unit(name);
            self.outdated.insert(name.clone());
            self.histories.notice(format!(
                "{name}: its calibration is older than a replacement that was recorded, and not used: calibrate it again"
            ));
        }
        BegunWindow { job, progress }
    }

    /// Explains a window: what takes nearly all the time of its assessment. Windows of different actuators may be explained side by side.
    ///
    /// # Errors
    /// As [`Assessor::assess`].
    pub fn explain_begun(&self, begun: BegunWindow, limit: &TimeLimit<'_>) -> Result<ExplainedWindow, AssessError> {
        let is_learning = begun.is_learning();
        let BegunWindow { mut job, progress } = begun;
        let readings = sensor_readings(&job);
        let explained = self.explain(&mut job, is_learning, &limit.effort)?;
        Ok(ExplainedWindow {
            begun: BegunWindow { job, progress },
            readings,
            explained,
        })
    }

    /// Decides on health by what explains a window, with the limit that it was explained with.
    ///
    /// # Errors
    /// As [`Assessor::assess`].
    pub fn conclude(&mut self, window: ExplainedWindow, limit: &TimeLimit<'_>) -> Result<AssessedWindow, AssessError> {
        let is_learning = window.begun.is_learning();
        let ExplainedWindow {
            begun: BegunWindow { job, progress },
            readings,
            explained,
        } = window;
        let Explained {
            assessed,
            suspects,
            mut reasons,
            unchecked,
        } = explained;
        let is_short = limit.effort.is_short();
        let is_for_relations = !job.actuator.has_set_point() && job.window.quality.is_fit();
        if assessed.is_none() && is_short {
            reasons.push(format!("deadline of {} ms: not identified", limit.deadline_ms));
        }
        let of_type = self.models.of_type(&job.actuator.type_name)?;
        let is_calibrated = of_type.calibrated || self.knows_unit(&job.actuator);
        let mut fit = Fit::default();
        let mut found = None;
        if let Some(assessed) = assessed {
            let estimate = assessed.estimate;
            fit = assessed.fit;
            if let WindowQuality::Degraded(handicaps) = &job.window.quality {
                reasons.extend(handicaps.iter().map(ToString::to_string));
            }
            if let Some(log) = &job.actuator.log {
                reasons.extend(log.gaps().map(|gap| gap.to_string()));
            }
            if !is_calibrated {
                reasons.push(format!("type {} is not calibrated", of_type.calibration.actuator_type));
            }
            match &progress {
                LearningProgress::Learns(reason) => reasons.push(reason.clone()),
                LearningProgress::NotToLearn if self.outdated.contains(&job.actuator.name) => {
                    reasons.push(OUTDATED.to_owned());
                }
                LearningProgress::NotToLearn | LearningProgress::Waits(_) => {}
            }
            reasons.extend(assessed.reasons);
            reasons.extend(estimate.competing_optimum.map(|other| ambiguous(&estimate, &other)));
            if is_short && (estimate.cut || unchecked) {
                reasons.push(cut_by_deadline(limit.deadline_ms, &estimate, unchecked));
            } else if estimate.cut {
                let budget = self.config.identification().evaluations_max;
                reasons.push(format!("best of {budget} evaluations, the search had not ended"));
            }
            found = Some(estimate);
        }
        match &progress {
            LearningProgress::Learns(reason) if found.is_none() && is_for_relations => reasons.push(reason.clone()),
            LearningProgress::Waits(reason) => reasons.push(reason.clone()),
            LearningProgress::Learns(_) | LearningProgress::NotToLearn => {}
        }
        // A fault vector that does not explain the data is no estimate.
        let explained = found.as_ref().filter(|estimate| !estimate.is_unmodelled());
        let levels = *self.config.health().levels();
        let damage = explained.map(damage_evidence);
        let is_commissioned = self.knows_unit(&job.actuator);
        reasons.extend(damage.and_then(|damage| too_uncertain(&damage, &levels, is_commissioned)));
        let shown = damage.map_or([None; FaultId::COUNT], |damage| damage.shown(&levels));
        let damage = damage.filter(|_| !unchecked);
        let history = self.histories.history_at(&job.actuator, job.window.t_start_ns)?;
        if is_commissioned {
            history.release();
        }
        let counted_damage = damage.as_ref().filter(|_| !is_learning);
        reasons.extend(counted_damage.and_then(|damage| history.fallen(damage)));
        let status = match (&found, explained, reasons.is_empty()) {
            (None, _, _) => WindowStatus::Invalid,
            (Some(estimate), None, _) => {
                reasons.extend(estimate.unmodelled().as_ref().map(ToString::to_string));
                WindowStatus::Unmodelled
            }
            (Some(_), Some(_), true) => WindowStatus::Ok,
            (Some(_), Some(_), false) => WindowStatus::Degraded,
        };
        match status {
            WindowStatus::Ok => self.counts.ok += 1,
            WindowStatus::Degraded => self.counts.degraded += 1,
            WindowStatus::Unmodelled => self.counts.unmodelled += 1,
            WindowStatus::Invalid => self.counts.invalid += 1,
        }
        let config = self.config.clone();
        let specification = job.actuator.specification;
        let coefficients = self.models.of_type(&job.actuator.type_name)?.calibration.coefficients();
        let falls_short = |faults: &[FaultVector; CHECK_LANES]| {
            unmet_requirements(&job.params, &coefficients, &specification, faults)
        };
        let checked = explained.filter(|_| !unchecked);
        let counted = checked.filter(|_| !is_learning);
        let evidence = WindowEvidence {
            damage_evidence: counted_damage,
            fault: counted.map(|estimate| &estimate.fault),
            fit: &fit,
            unmet_requirement: specification.is_set().then_some(&falls_short as _),
        };
        let mut decision = history.update(&job, &evidence, &config);
        // An invalid window is no evidence of a sensor either.
        let readings = (status != WindowStatus::Invalid).then_some(&readings);
        let commissioned = self.models.unit(&job.actuator).and_then(|unit| sensors_of(unit, &job));
        let sensors = history.update_sensors(&job, readings, commissioned);
        if is_learning {
            decision.state = HealthState::Unknown;
            decision.health.state = HealthState::Unknown;
            decision.health.states = [HealthState::Unknown; FaultId::COUNT];
            decision.health.faults.clear();
        }
        let reason = reasons.join("; ");
        let health = health_record(&job, status, &reason, found.as_ref(), shown, &decision, &suspects);
        let rul = rul_record(&job, found.as_ref(), &decision, config.rul());
        let news = history.note_published(&health, &rul);
        let in_a_row = history.in_a_row().clone();
        Ok(AssessedWindow {
            window: window_record(&job, status, &reason, fit),
            health,
            sensors: sensors_record(&job, &sensors),
            rul,
            suspects,
            is_calibrated,
            damage_evidence: damage,
            shortened: is_short.then(|| shortened_record(&job, limit, found.as_ref())),
            in_a_row,
            news,
            unit: record::UnitMark::Untold,
            events_ns: Vec::new(),
        })
    }

    /// Identifies an actuator that stands still, to measure how long identification takes on this computer.
    ///
    /// # Errors
    /// As [`Assessor::assess`].
    pub fn rehearse(&self, actuator: &ActuatorConfig, effort: &Effort<'_>) -> Result<(), AssessError> {
        let samples = (0.5 * actuator.params.sensors.sample_rate) as usize;
        let identifier = Identifier {
            params: actuator.params,
            calibration: self.models.of_type(&actuator.type_name)?.calibration.clone(),
            method: self.method,
            motor: MotorKnowledge::default(),
            tolerances: actuator.tolerances,
        };
        let at_rest = SensedSample {
            seq: 0,
            currents: [0.0; 3],
            motor_counts: 0,
            output_counts: 0,
            setpoint: Setpoint::Position(0.0),
        };
        let prepared = Prepared::new(&actuator.params, &vec![at_rest; samples], &[], 0, None);
        let conditions = Conditions {
            load_torque: None,
            v_dc: actuator.params.motor.v_dc,
            winding_temp_deg_c: None,
        };
        identifier.identify_within(&prepared, conditions, self.seed, effort)?;
        Ok(())
    }

    /// The identifier for a window: its type's calibration, and what is known of its unit.
    ///
    /// # Errors
    /// No model was loaded for the actuator's type.
    pub fn identifier_of(&self, job: &WindowJob) -> Result<Identifier, AssessError> {
        let unit = self.models.unit(&job.actuator);
        let monitor = unit.and_then(|unit| unit.monitor);
        let of_type = self.models.of_type(&job.actuator.type_name)?.calibration.clone();
        Ok(Identifier {
            params: monitor.map_or(job.params, |monitor| monitor.parameters.applied_to(&job.params)),
            calibration: with_steps(of_type, job)
                .with_current_time_constant(monitor.map_or(0.0, |monitor| monitor.current_time_constant_s)),
            method: self.method,
            motor: motor_knowledge_at(self.models.motor(&job.actuator), job.conditions.winding_temp_deg_c),
            // The scatter of its own windows stands for them in a commissioned unit.
            tolerances: unit.map_or(job.actuator.tolerances, |_| Tolerances::NONE),
        })
    }
}

/// Reason of a window of a unit whose calibration was learnt before a replacement.
pub const OUTDATED: &str = "its calibration is older than a recorded replacement, and not used";

/// What commissioning has shown of the sensors, where it was at the sample rate of the window: the errors of its models go with the rate.
fn sensors_of<'a>(unit: &'a UnitCalibration, job: &WindowJob) -> Option<&'a CommissionedSensors> {
    let rate_hz = job.params.sensors.sample_rate;
    let is_same = |of: f64| (rate_hz / of - 1.0).abs() <= RATE_MARGIN;
    unit.sensors
        .as_ref()
        .filter(|_| unit.seen.sample_rate_hz.is_some_and(is_same))
}

/// Damage of the faults in the window; one of which it shows nothing has no finite sigma and keeps its state.
#[must_use]
pub fn damage_evidence(estimate: &Estimate) -> DamageEvidence {
    let sigma = estimate.damage_sigma();
    DamageEvidence {
        damage: estimate.fault.damages(),
        sigma: Some(FaultId::ALL.map(|fault| sigma[fault.parameter()])),
    }
}
