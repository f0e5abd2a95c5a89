//! From windows to records: identification, then the health decision. Dear; never on a thread that does I/O.

mod records;
mod types;

use std::collections::BTreeMap;
use std::sync::Arc;

use ema_ga::ConfigError as SearchError;
use ema_ga::GaConfig;
use ema_models::{Conditions, FAULT_COUNT, FaultVector, MotorDeviation, MotorKnowledge, Scale};

use crate::calibration::CalibrationFileError;
use crate::config::{ActuatorConfig, Config, IdentificationConfig, SearchMethod};
use crate::front::WindowJob;
use crate::function::{TRIED, shortfalls};
use crate::health::{Judgement, LevelsError};
use crate::life::{EventError, Lives, Shown, events_of};
use crate::outliers::identify_without_outliers;
use crate::record;
use crate::seed::mix;
use crate::unit::{UnitCalibration, UnitError};
use crate::window::Verdict;
use ema_identify::calibration::MonitorForm;
use ema_identify::{Estimate, Fit, Identifier, Method, Population};
use records::{health_record, rul_record, window_record};
use types::KnownType;
pub use types::model_hash;

/// Why the judge cannot work.
#[derive(Debug, thiserror::Error)]
pub enum JudgeError {
    /// A type calibration is unusable.
    #[error(transparent)]
    Calibration(#[from] CalibrationFileError),
    /// A calibration file belongs to another monitor form.
    #[error("{path}: expected a calibration of the {expected:?} monitor, found one of the {found:?} monitor")]
    Form {
        /// The file.
        path: String,
        /// The form the configuration asks for.
        expected: MonitorForm,
        /// The form of the file.
        found: MonitorForm,
    },
    /// A unit's calibration is unusable.
    #[error(transparent)]
    Unit(#[from] UnitError),
    /// The search's settings contradict each other.
    #[error("identification: {0}")]
    Search(#[from] SearchError),
    /// The health levels contradict each other.
    #[error("health: {0}")]
    Levels(#[from] LevelsError),
    /// The maintenance events cannot be read.
    #[error("rul.events: {0}")]
    Events(#[from] EventError),
}

/// Judges the windows of all actuators, in the order in which they come.
#[derive(Debug)]
pub struct Judge {
    config: Arc<Config>,
    method: Method,
    seed: u64,
    types: BTreeMap<String, KnownType>,
    motors: BTreeMap<String, MotorKnowledge>,
    lives: Lives,
    counts: WindowCounts,
}

/// Windows by verdict.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WindowCounts {
    /// Identified without handicap.
    pub ok: u64,
    /// Identified with one.
    pub degraded: u64,
    /// Not fit to be judged.
    pub invalid: u64,
    /// Good data that no fault vector explains.
    pub unmodelled: u64,
}

/// The records of one window.
#[derive(Clone, Debug)]
pub struct Judged {
    /// What was seen, and the fit.
    pub window: record::Window,
    /// The verdict.
    pub health: record::Health,
    /// Remaining useful life; without numbers until there is a trend.
    pub rul: record::Rul,
}

impl Judge {
    /// For a configuration and the seed of every search.
    #[must_use]
    pub fn new(config: Arc<Config>, seed: u64) -> Self {
        let method = method(config.identification());
        Self {
            lives: Lives::new(config.clone()),
            config,
            method,
            seed,
            types: BTreeMap::new(),
            motors: BTreeMap::new(),
            counts: WindowCounts::default(),
        }
    }

    /// Reads the maintenance events of the configuration, again if they were read before.
    ///
    /// # Errors
    /// A file that is there and cannot be read.
    pub fn follow_events(&mut self) -> Result<(), JudgeError> {
        self.lives.follow(events_of(&self.config)?);
        Ok(())
    }

    /// Lives of all actuators.
    pub fn lives(&mut self) -> &mut Lives {
        &mut self.lives
    }

    /// Windows so far.
    #[must_use]
    pub fn counts(&self) -> WindowCounts {
        self.counts
    }

    /// Identifies a window and decides on health. The same job, seed and history give the same records on any number of
    /// threads.
    ///
    /// # Errors
    /// [`JudgeError`] when the configuration cannot be used at all; a bad window is a record, not an error.
    pub fn judge(&mut self, mut job: WindowJob) -> Result<Judged, JudgeError> {
        let mut reasons = Vec::new();
        let mut found = None;
        let mut fit = Fit::default();
        match conditions(&job) {
            _ if !job.window.verdict.is_fit() => reasons.push(job.window.verdict.to_string()),
            Err(absurd) => reasons.push(absurd),
            Ok(conditions) => {
                let calibrated = self.known_type(&job.actuator)?.calibrated;
                let identifier = self.of_job(&job)?;
                let seed = mix(self.seed, &[name_hash(&job.actuator.name), job.window.number]);
                let (prepared, estimate) = identify_without_outliers(&identifier, &mut job.window, conditions, seed)?;
                fit = identifier.fit(&prepared, conditions, &estimate);
                if let Verdict::Degraded(handicaps) = &job.window.verdict {
                    reasons.extend(handicaps.iter().map(ToString::to_string));
                }
                if !calibrated {
                    reasons.push(format!(
                        "type {} is not calibrated",
                        identifier.calibration.actuator_type
                    ));
                }
                if let Some(unseen) = unseen(&estimate) {
                    reasons.push(unseen);
                }
                reasons.extend(estimate.competing_optimum.map(|other| ambiguous(&estimate, &other)));
                if estimate.cut {
                    let budget = self.config.identification().evaluations_max;
                    reasons.push(format!("best of {budget} evaluations, the search had not ended"));
                }
                found = Some(estimate);
            }
        }
        let explained = found.as_ref().filter(|estimate| !estimate.is_unmodelled());
        let status = match (&found, explained, reasons.is_empty()) {
            (None, _, _) => "invalid",
            (Some(estimate), None, _) => {
                reasons.extend(estimate.unmodelled().as_ref().map(ToString::to_string));
                "unmodelled"
            }
            (Some(_), Some(_), true) => "ok",
            (Some(_), Some(_), false) => "degraded",
        };
        match status {
            "ok" => self.counts.ok += 1,
            "degraded" => self.counts.degraded += 1,
            "unmodelled" => self.counts.unmodelled += 1,
            _ => self.counts.invalid += 1,
        }
        let config = self.config.clone();
        let specification = job.actuator.specification;
        let coefficients = self.known_type(&job.actuator)?.calibration.coefficients();
        let falls_short =
            |faults: &[FaultVector; TRIED]| shortfalls(&job.params, &coefficients, &specification, faults);
        let judged = explained.map(judgement);
        let shown = Shown {
            judgement: judged.as_ref(),
            fault: explained.map(|estimate| &estimate.fault),
            fit: &fit,
            shortfall: specification.is_set().then_some(&falls_short as _),
        };
        let life = self.lives.at(&job.actuator, job.window.t_start_ns)?;
        let decision = life.update(&job, &shown, &config);
        let reason = reasons.join("; ");
        Ok(Judged {
            window: window_record(&job, status, &reason, fit),
            health: health_record(&job, status, &reason, found.as_ref(), &decision),
            rul: rul_record(&job, found.as_ref(), &decision, config.rul().horizon_h),
        })
    }

    /// The identifier for a type of actuator by name, with another monitor or method than the configuration's if asked;
    /// `None` where no such type is known.
    ///
    /// # Errors
    /// A calibration that cannot be used.
    pub fn identifier(
        &mut self,
        type_name: &str,
        monitor: Option<MonitorForm>,
        search: Option<SearchMethod>,
    ) -> Result<Option<Identifier>, JudgeError> {
        let config = self.config.clone();
        let Some(found) = config.actuator_type(type_name) else {
            return Ok(None);
        };
        let form = monitor.unwrap_or(config.identification().monitor);
        let path = found.calibration.as_deref().map(|path| config.resolve(path));
        let known = KnownType::load(type_name, &found.params, form, path.as_deref())?;
        let method = search.map_or(self.method, |search| method(&IdentificationConfig::for_method(search)));
        Ok(Some(Identifier {
            params: found.params,
            calibration: known.calibration,
            method,
            motor: MotorKnowledge::default(),
        }))
    }

    /// The identifier for a window: its type's calibration, and what is known of its motor.
    ///
    /// # Errors
    /// A calibration that cannot be used.
    pub fn of_job(&mut self, job: &WindowJob) -> Result<Identifier, JudgeError> {
        Ok(Identifier {
            motor: known_at(self.motor(&job.actuator)?, job.conditions.winding_temp_deg_c),
            ..self.of_uncalibrated(job)?
        })
    }

    /// The same for a window of a unit that nobody has calibrated yet, whatever the configuration says of it.
    ///
    /// # Errors
    /// A calibration of its type that cannot be used.
    pub fn of_uncalibrated(&mut self, job: &WindowJob) -> Result<Identifier, JudgeError> {
        Ok(Identifier {
            params: job.params,
            calibration: self.known_type(&job.actuator)?.calibration.clone(),
            method: self.method,
            motor: known_at(TYPE_TOLERANCE, job.conditions.winding_temp_deg_c),
        })
    }

    fn known_type(&mut self, actuator: &ActuatorConfig) -> Result<&KnownType, JudgeError> {
        if !self.types.contains_key(&actuator.type_name) {
            let form = self.config.identification().monitor;
            let path = actuator
                .type_calibration
                .as_deref()
                .map(|path| self.config.resolve(path));
            let known = KnownType::load(&actuator.type_name, &actuator.params, form, path.as_deref())?;
            self.types.insert(actuator.type_name.clone(), known);
        }
        Ok(&self.types[&actuator.type_name])
    }

    /// What is known of an actuator's motor: what its own calibration says, else the type's tolerance.
    fn motor(&mut self, actuator: &ActuatorConfig) -> Result<MotorKnowledge, JudgeError> {
        let Some(path) = &actuator.calibration else {
            return Ok(TYPE_TOLERANCE);
        };
        if let Some(known) = self.motors.get(&actuator.name) {
            return Ok(*known);
        }
        let found = UnitCalibration::load(&self.config.resolve(path), &actuator.type_name)?.motor();
        self.motors.insert(actuator.name.clone(), found);
        Ok(found)
    }
}

/// The search that a configuration asks for.
#[must_use]
pub fn method(section: &IdentificationConfig) -> Method {
    let mut search = GaConfig::for_dimension(FAULT_COUNT as u32);
    search.population = section.population as usize;
    search.elite_count = search.population.div_ceil(20);
    search.stop.max_generations = section.generations;
    search.stop.max_evaluations = Some(u64::from(section.evaluations_max));
    match section.method {
        SearchMethod::Hybrid => Method::Hybrid(Population::Genetic(search)),
        SearchMethod::Ga => Method::PaperGa(search),
    }
}

/// What is known of a unit that nobody calibrated: resistance within ±5 % of its type and back-EMF within ±3 %, as the
/// standard deviations of uniform distributions. A weak magnet looks much like three slightly shorted phases; estimated
/// along, it is not mistaken for them, and what cannot be told apart widens their sigma.
pub const TYPE_TOLERANCE: MotorKnowledge = MotorKnowledge {
    mean: MotorDeviation {
        resistance: 0.0,
        back_emf: 0.0,
    },
    covariance: [[0.05 * 0.05 / 3.0, 0.0], [0.0, 0.03 * 0.03 / 3.0]],
};

/// What is known of a motor under a temperature that is measured or not.
#[must_use]
pub fn known_at(motor: MotorKnowledge, winding_temp_deg_c: Option<f64>) -> MotorKnowledge {
    match winding_temp_deg_c {
        Some(_) => motor,
        None => motor.at_unknown_temperature(WINDING_TEMP_SIGMA_K),
    }
}

/// Load, supply and temperature as measured; without a measurement the load is left open, the supply is nominal and the
/// temperature widens what is known of the motor ([`known_at`]).
///
/// # Errors
/// A sentence when a measurement is beyond what the actuator can have been working with: then the sensor is bad.
pub fn conditions(job: &WindowJob) -> Result<Conditions, String> {
    let motor = &job.params.motor;
    let v_dc = job.conditions.dc_link_v.unwrap_or(motor.v_dc);
    let [low, high] = DC_LINK_SHARES.map(|share| share * motor.v_dc);
    if !(low..=high).contains(&v_dc) {
        return Err(format!("dc_link: expected {low:.0} to {high:.0} V, found {v_dc:.1} V"));
    }
    let load_torque = job.conditions.load_torque_nm;
    let load_max = LOAD_MAX_SHARE * Scale::new(&job.params).load();
    if let Some(load) = load_torque.filter(|load| load.abs() > load_max) {
        return Err(format!(
            "load_torque: expected at most {load_max:.0} Nm, found {load:.1} Nm"
        ));
    }
    let winding_temp_deg_c = job.conditions.winding_temp_deg_c;
    let [low, high] = WINDING_TEMP_DEG_C;
    if let Some(temperature) = winding_temp_deg_c.filter(|temperature| !(low..=high).contains(temperature)) {
        return Err(format!(
            "winding_temp: expected {low:.0} to {high:.0} °C, found {temperature:.1} °C"
        ));
    }
    Ok(Conditions {
        load_torque,
        v_dc,
        winding_temp_deg_c,
    })
}

/// DC link voltages that a drive works with, as shares of the nominal one.
const DC_LINK_SHARES: [f64; 2] = [0.5, 1.5];

/// Temperatures that a winding can have, °C: from the coldest air to where its insulation fails.
const WINDING_TEMP_DEG_C: [f64; 2] = [-80.0, 250.0];

/// What a temperature that nobody measures may be off 20 °C, K, as a standard deviation: −40 to 120 °C are within two.
const WINDING_TEMP_SIGMA_K: f64 = 45.0;

/// Largest load as a share of what the motor can lift without losses; a lossy gear holds more than the motor can lift.
const LOAD_MAX_SHARE: f64 = 2.0;

/// Damage of what the window shows; the rest has no sigma and is left as it was.
#[must_use]
pub fn judgement(estimate: &Estimate) -> Judgement {
    Judgement {
        damage: estimate.fault.damage(),
        sigma: Some(estimate.damage_sigma()),
    }
}

/// Says which parameters the window does not show. The phase k7 is no handicap: without eccentricity it has no meaning.
fn unseen(estimate: &Estimate) -> Option<String> {
    let names: Vec<&str> = (0..FAULT_COUNT)
        .filter(|&p| p != 6 && !estimate.observable[p])
        .map(|p| ema_models::FaultVector::NAMES[p])
        .collect();
    (!names.is_empty()).then(|| format!("not excited: {}", names.join(", ")))
}

/// Says which other values explain the window as well.
fn ambiguous(estimate: &Estimate, other: &ema_models::FaultVector) -> String {
    let (k, other) = (estimate.fault.to_array(), other.to_array());
    let names: Vec<String> = (0..FAULT_COUNT)
        .filter(|&p| p != 6 && (k[p] - other[p]).abs() > NOTABLE_DIFFERENCE)
        .map(|p| format!("{} {:.2} or {:.2}", ema_models::FaultVector::NAMES[p], k[p], other[p]))
        .collect();
    format!("ambiguous: {}", names.join(", "))
}

/// Difference of two explanations that is worth a word.
const NOTABLE_DIFFERENCE: f64 = 0.02;

/// FNV-1a, so that an actuator's searches do not depend on which others are there.
fn name_hash(name: &str) -> u64 {
    name.bytes().fold(0xCBF2_9CE4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3)
    })
}
