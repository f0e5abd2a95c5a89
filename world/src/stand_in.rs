//! Answers in the place of identification: of each window what the seed says, of one in a hundred what identification finds.

use ema_identify::effort::Effort;
use ema_identify::{Estimate, Fit, Identifier, InferredReadings};
use ema_models::{Conditions, FAULT_COUNT, FaultVector, MotorDeviation, Unknowns};
use hmd_core::assess::{AssessError, Estimator, Identification};
use hmd_core::outbox::WindowJob;
use hmd_core::seed::{mix, name_hash};

use crate::clock::EPOCH_NS;

/// Standard deviation of every damage.
pub const SIGMA: f64 = 0.01;

/// Of so many windows one is identified.
const IDENTIFIED: u64 = 100;

/// A healthy window in so many shows friction above a level: often enough for several in a row.
const OUTLIER: u64 = 4;

/// Of the outliers one in so many is no more than its scatter explains, though above a level.
const INSIGNIFICANT: u64 = 3;

/// Of the windows of a unit about a level one in so many lies below it.
const BELOW: u64 = 5;

/// Standard deviation of such an outlier.
const SIGMA_LARGE: f64 = 0.06;

/// Answers from a seed.
#[derive(Clone, Copy, Debug)]
pub struct StandIn {
    /// The seed.
    pub seed: u64,
}

/// Names of units that wear; the others stay healthy.
#[must_use]
pub fn is_worn(actuator: &str) -> bool {
    actuator.ends_with(['3', '7'])
}

/// Names of units whose damage stays about a level.
#[must_use]
pub fn hovers(actuator: &str) -> bool {
    actuator.ends_with(['1', '5'])
}

impl StandIn {
    /// Friction of a window as it is answered, `None` where it is identified.
    #[must_use]
    pub fn friction(&self, actuator: &str, t_start_ns: u64) -> Option<f64> {
        let chance = mix(self.seed, &[name_hash(actuator), t_start_ns]);
        if chance.is_multiple_of(IDENTIFIED) {
            return None;
        }
        let scatter = SIGMA * ((chance >> 32) as f64 / f64::from(u32::MAX));
        if is_worn(actuator) {
            // From nothing to 0.7 in a minute.
            let since_s = 1e-9 * t_start_ns.saturating_sub(EPOCH_NS) as f64;
            return Some((since_s / 60.0).min(1.0) * 0.7 + scatter);
        }
        if hovers(actuator) {
            // Below the level of watch by less than its hysteresis, or above it.
            let is_below = (chance >> 8).is_multiple_of(BELOW);
            return Some(if is_below { 0.028 + scatter } else { 0.055 + scatter });
        }
        let is_outlier = (chance >> 8).is_multiple_of(OUTLIER);
        Some(if is_outlier { 0.12 + scatter } else { scatter })
    }
}

impl Estimator for StandIn {
    fn estimate(
        &self,
        identifier: &Identifier,
        job: &mut WindowJob,
        conditions: Conditions,
        seed: u64,
        effort: &Effort<'_>,
    ) -> Result<Option<(Estimate, Fit)>, AssessError> {
        let Some(friction) = self.friction(&job.actuator.name, job.window.t_start_ns) else {
            return Identification.estimate(identifier, job, conditions, seed, effort);
        };
        let chance = mix(self.seed, &[job.window.t_start_ns]);
        let is_vague = !is_worn(&job.actuator.name) && friction > 0.1 && chance.is_multiple_of(INSIGNIFICANT);
        let fault = FaultVector {
            friction,
            ..FaultVector::NOMINAL
        };
        let mut sigma = [Some(SIGMA); 8];
        if is_vague {
            sigma[0] = Some(SIGMA_LARGE);
        }
        sigma[FaultVector::ECCENTRICITY_PHASE_INDEX] = None;
        let estimate = Estimate {
            fault,
            unknowns: Unknowns {
                fault,
                load_torque: 0.0,
                integral: 0.0,
                motor: MotorDeviation::default(),
            },
            sigma,
            observable: [true; 8],
            cost: 1.0,
            residual_rms_a: 0.1,
            evaluations: 1,
            cut: false,
            competing_optimum: None,
            share: [0.0; FAULT_COUNT],
            back_emf_off: 0.0,
            other_motor: false,
            locked: false,
            deviations: Vec::new(),
            inferred: InferredReadings::default(),
        };
        Ok(Some((estimate, Fit::default())))
    }
}
