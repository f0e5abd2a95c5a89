//! What estimates the windows of the suites `paper` and `random`: a search, or the relations of a commissioned unit.

use ema_ga::ConfigError;
use ema_identify::relations::{BalanceShape, CommissionError, MeasuredWindow, MeasurementNoise, commission};
use ema_identify::unit_calibration::UnitRelations;
use ema_identify::unit_estimate::{AlignedWindow, estimate_by_relations};
use ema_identify::{Estimate, Identifier};
use ema_models::{ActuatorParams, FaultVector, Profile, SensedSample};
use hmd_core::seed::mix;
use rayon::prelude::*;

use crate::simulated::SimulatedWindow;

/// Healthy windows that a unit is commissioned by.
const COMMISSIONING_WINDOWS: u64 = 12;

/// Stream of the seeds of those windows, which no suite uses.
const COMMISSIONING: u64 = 0xC0;

/// What estimates the windows.
#[derive(Clone, Debug)]
pub enum Estimator {
    /// The monitor and a search.
    Search(Box<Identifier>),
    /// The relations of a unit that is its type exactly.
    Relations(Box<(UnitRelations, ActuatorParams)>),
}

impl Estimator {
    /// The relations of a unit, by twelve healthy windows of its own.
    ///
    /// # Errors
    /// The windows do not determine them.
    pub fn commissioned(params: &ActuatorParams, seed: u64) -> Result<Self, CommissionError> {
        let windows: Vec<SimulatedWindow> = (0..COMMISSIONING_WINDOWS)
            .into_par_iter()
            .map(|n| {
                let seed = mix(seed, &[COMMISSIONING, n]);
                SimulatedWindow::new(params, FaultVector::NOMINAL, Profile::Mixed, seed)
            })
            .collect();
        let aligned: Vec<AlignedWindow<'_>> = windows.iter().map(|window| aligned(params, window)).collect();
        let measured: Vec<MeasuredWindow<'_, SensedSample>> = aligned.iter().map(AlignedWindow::measured).collect();
        let commissioned = commission(&measured, &BalanceShape::usual(params))?;
        let residuals = measured
            .iter()
            .map(|window| commissioned.estimate(window).torque_residual_rms);
        let unit = UnitRelations {
            residual_rms_nm: residuals.sum::<f64>() / measured.len() as f64,
            sigma_factors: [1.0; ema_identify::relations::ELEMENT_COUNT],
            noise: MeasurementNoise::mean(measured.iter().filter_map(MeasurementNoise::of)),
            commissioned,
        };
        Ok(Self::Relations(Box::new((unit, *params))))
    }

    pub(super) fn params(&self) -> &ActuatorParams {
        match self {
            Self::Search(identifier) => &identifier.params,
            Self::Relations(unit) => &unit.1,
        }
    }

    pub(super) fn estimate(&self, window: &SimulatedWindow, seed: u64) -> Result<Estimate, ConfigError> {
        match self {
            Self::Search(identifier) => identifier.identify(&window.prepared, window.conditions, seed),
            Self::Relations(unit) => {
                let (unit, params) = &**unit;
                Ok(estimate_by_relations(unit, &aligned(params, window), false).estimate)
            }
        }
    }
}

fn aligned<'a>(params: &'a ActuatorParams, window: &SimulatedWindow) -> AlignedWindow<'a> {
    AlignedWindow::new(params, &window.samples, &[], None)
}
