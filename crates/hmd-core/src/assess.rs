//! From windows to records: identification, then the health decision. Dear; never on a thread that does I/O.

mod conditions;
mod models;
mod records;

use std::sync::Arc;

use ema_ga::GaConfig;
use ema_models::{FAULT_COUNT, FaultVector};

use crate::config::{Config, IdentificationConfig, SearchMethod};
use crate::demux::WindowJob;
use crate::functional_check::{TRIED, shortfalls};
use crate::health::Judgement;
use crate::history::{Lives, Shown};
use crate::outliers::identify_without_outliers;
use crate::record;
use crate::seed::mix;
use crate::window::Verdict;
use ema_identify::{Estimate, Fit, Identifier, Method, Population};
use records::{health_record, rul_record, window_record};

pub use conditions::{TYPE_TOLERANCE, conditions, known_at};
pub use models::{AssessError, Models, ReadText, TypeModel, model_hash};

/// Judges the windows of all actuators, in the order in which they come.
#[derive(Debug)]
pub struct Assessor {
    config: Arc<Config>,
    method: Method,
    seed: u64,
    models: Models,
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
pub struct AssessedWindow {
    /// What was seen, and the fit.
    pub window: record::Window,
    /// The verdict.
    pub health: record::Health,
    /// Remaining useful life; without numbers until there is a trend.
    pub rul: record::Rul,
}

impl Assessor {
    /// For a configuration, what its windows are assessed with, and the seed of every search.
    #[must_use]
    pub fn new(config: Arc<Config>, models: Models, seed: u64) -> Self {
        let method = method(config.identification());
        Self {
            lives: Lives::new(config.clone()),
            config,
            method,
            seed,
            models,
            counts: WindowCounts::default(),
        }
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
    /// [`AssessError`] when the configuration cannot be used at all; a bad window is a record, not an error.
    pub fn assess(&mut self, mut job: WindowJob) -> Result<AssessedWindow, AssessError> {
        let mut reasons = Vec::new();
        let mut found = None;
        let mut fit = Fit::default();
        match conditions(&job) {
            _ if !job.window.verdict.is_fit() => reasons.push(job.window.verdict.to_string()),
            Err(absurd) => reasons.push(absurd),
            Ok(conditions) => {
                let calibrated = self.models.of_type(&job.actuator.type_name)?.calibrated;
                let identifier = self.identifier_of(&job)?;
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
        let coefficients = self.models.of_type(&job.actuator.type_name)?.calibration.coefficients();
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
        Ok(AssessedWindow {
            window: window_record(&job, status, &reason, fit),
            health: health_record(&job, status, &reason, found.as_ref(), &decision),
            rul: rul_record(&job, found.as_ref(), &decision, config.rul().horizon_h),
        })
    }

    /// The identifier for a window: its type's calibration, and what is known of its motor.
    ///
    /// # Errors
    /// No model was loaded for the actuator's type.
    pub fn identifier_of(&self, job: &WindowJob) -> Result<Identifier, AssessError> {
        Ok(Identifier {
            params: job.params,
            calibration: self.models.of_type(&job.actuator.type_name)?.calibration.clone(),
            method: self.method,
            motor: known_at(self.models.motor(&job.actuator), job.conditions.winding_temp_deg_c),
        })
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
