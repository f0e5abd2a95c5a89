//! Calibration of one unit: healthy windows of it -> how far its motor is off its type.
//!
//! In: windows of one unit that are fit for an assessment, and the calibrations of their type. Out: the [`UnitCalibration`], or why
//! the windows are refused. CPU-bound.

use ema_identify::is_unmodelled;
use ema_identify::unit_calibration::UnitCalibration;
use ema_identify::unit_fit::{WINDOWS_MIN, fit_motor};

use crate::assess::{AssessError, Assessor, conditions, damage_evidence};
use crate::health::{Health, Levels, LevelsError};
use crate::outbox::WindowJob;
use crate::outliers::identify_without_outliers;
use ema_models::FaultId;

/// Why a unit was not calibrated.
#[derive(Debug, thiserror::Error)]
pub enum CommissioningError {
    /// Not enough windows.
    #[error("expected at least {WINDOWS_MIN} windows that can be assessed, found {0}")]
    TooFew(usize),
    /// A measurement is beyond what an actuator can have been working with.
    #[error("window {window}: {sentence}")]
    Conditions {
        /// Number of the window.
        window: u64,
        /// What is beyond.
        sentence: String,
    },
    /// A window shows faults.
    #[error("window {window}: expected a healthy unit, found {faults}")]
    Faults {
        /// Number of the window.
        window: u64,
        /// Their names.
        faults: String,
    },
    /// No window says anything of the motor.
    #[error("expected windows that tell of the motor, found none that do")]
    Undetermined,
    /// No motor of the type explains the windows.
    #[error(
        "expected windows of a healthy unit of type {type_name}, found none of its motors explains them: cost {cost:.0}"
    )]
    Unmodelled {
        /// Name of the type.
        type_name: String,
        /// Mean cost of the windows.
        cost: f64,
    },
    /// The configuration cannot be used.
    #[error(transparent)]
    Assess(#[from] AssessError),
    /// The search's settings contradict each other.
    #[error(transparent)]
    Search(#[from] ema_ga::ConfigError),
    /// The health levels contradict each other.
    #[error(transparent)]
    Levels(#[from] LevelsError),
}

impl CommissioningError {
    /// Whether the windows are the reason, and not the settings.
    #[must_use]
    pub fn is_by_windows(&self) -> bool {
        !matches!(self, Self::Assess(_) | Self::Search(_) | Self::Levels(_))
    }
}

/// Calibrates one unit by its healthy windows, each assessed alone by `levels` and the type calibrations of `assessor`.
///
/// # Errors
/// [`CommissioningError`], also where a window shows a fault.
pub fn calibrate_unit(
    assessor: &Assessor,
    levels: [Levels; FaultId::COUNT],
    jobs: &mut [WindowJob],
    seed: u64,
) -> Result<UnitCalibration, CommissioningError> {
    if jobs.len() < WINDOWS_MIN {
        return Err(CommissioningError::TooFew(jobs.len()));
    }
    let type_name = jobs[0].actuator.type_name.clone();
    let levels = levels.map(Levels::at_once);
    let mut prepared = Vec::new();
    for job in &mut *jobs {
        // The unit is calibrated anew, without an earlier calibration of it.
        let identifier = assessor.identifier_of(job)?;
        let window = job.window.number;
        let conditions = conditions(job).map_err(|sentence| CommissioningError::Conditions { window, sentence })?;
        let (samples, estimate) = identify_without_outliers(&identifier, &mut job.window, conditions, seed)?;
        let decision = Health::new(levels)?.update(0, Some(&damage_evidence(&estimate)));
        if !decision.faults.is_empty() {
            let names: Vec<&str> = decision.faults.iter().map(|fault| fault.name()).collect();
            let faults = names.join(", ");
            return Err(CommissioningError::Faults { window, faults });
        }
        prepared.push((identifier, samples, conditions));
    }
    let coefficients: Vec<_> = prepared
        .iter()
        .map(|(identifier, ..)| identifier.calibration.coefficients())
        .collect();
    let compared: Vec<_> = prepared
        .iter()
        .zip(&coefficients)
        .map(|((identifier, window, conditions), coefficients)| {
            identifier.comparison(window, coefficients, *conditions)
        })
        .collect();
    let Some(fit) = fit_motor(&compared) else {
        return Err(CommissioningError::Undetermined);
    };
    if is_unmodelled(fit.cost) {
        let cost = fit.cost;
        return Err(CommissioningError::Unmodelled { type_name, cost });
    }
    Ok(UnitCalibration::new(&type_name, jobs.len() as u32, &fit.motor))
}
