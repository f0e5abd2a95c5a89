//! The monitor of one unit: its parameters from all windows, then the apparent fault vector of each.

use ema_identify::effort::Effort;
use ema_identify::relations::ELEMENT_COUNT;
use ema_identify::unit_calibration::{ElementStatistics, UnitMonitor, UnitParameter, elements_of};
use ema_identify::unit_estimate::{USUAL_COST, corrected};
use ema_identify::unit_fit::WINDOWS_MIN;
use ema_identify::unit_parameters_fit::fit_unit_parameters;
use ema_identify::{Estimate, Identifier};
use ema_models::{Conditions, FaultId, Tolerances};

use super::evidence::Evidence;
use super::{CommissioningError, FarParameter, TOLERANCES_MAX};
use crate::assess::{AssessError, Assessor, conditions};
use crate::motion::moves_one_way;
use crate::outbox::WindowJob;
use crate::outliers::identify_without_outliers;

/// Tolerances from its type within which a parameter is usual.
const USUAL_TOLERANCES: f64 = 1.0;

/// A monitor that was learnt.
pub(super) struct MonitorLearnt {
    pub(super) unit: UnitMonitor,
    pub(super) evidence: Evidence,
    /// What was found in each window, before the baseline corrects it.
    pub(super) estimates: Vec<Estimate>,
}

/// Learns the monitor of a unit, its currents by one of these time constants, s; `None` where the windows do not determine it.
///
/// # Errors
/// Those of the configuration.
pub(super) fn learn_monitor(
    assessor: &Assessor,
    jobs: &mut [WindowJob],
    time_constants_s: &[f64],
    seed: u64,
    progress: &dyn Fn(u64),
) -> Result<Option<MonitorLearnt>, CommissioningError> {
    let Some(unit) = fit(assessor, jobs, time_constants_s)? else {
        progress(jobs.len() as u64);
        return Ok(None);
    };
    let mut estimates: Vec<Estimate> = Vec::with_capacity(jobs.len());
    for job in &mut *jobs {
        let (mut identifier, conditions) = of_type(assessor, job, unit.current_time_constant_s)?;
        identifier.params = unit.parameters.applied_to(&job.params);
        identifier.motor = crate::assess::motor_knowledge_at(unit.motor(), job.conditions.winding_temp_deg_c);
        let effort = Effort::unlimited();
        let found = identify_without_outliers(&identifier, &mut job.window, conditions, seed, &effort);
        estimates.extend(found.map_err(AssessError::from)?.map(|(_, estimate)| estimate));
        progress(1);
    }
    let shown: Vec<[Option<f64>; ELEMENT_COUNT]> = estimates
        .iter()
        .map(|estimate| {
            let elements = elements_of(&estimate.fault);
            std::array::from_fn(|n| {
                let parameter = ema_identify::relations::Element::ALL[n].fault().parameter();
                estimate.observable[parameter].then_some(elements[n])
            })
        })
        .collect();
    let unit = UnitMonitor {
        cost: estimates.iter().map(|estimate| estimate.cost).sum::<f64>() / estimates.len() as f64,
        baseline: ElementStatistics::of_windows(&shown),
        ..unit
    };
    let of_unit: Vec<Estimate> = estimates
        .iter()
        .zip(&*jobs)
        .map(|(estimate, job)| corrected(&unit, estimate.clone(), job.params.sensors.sample_rate).estimate)
        .collect();
    let mut sigmas: Vec<_> = of_unit.iter().map(|estimate| estimate.sigma).collect();
    for (sigma, job) in sigmas.iter_mut().zip(&*jobs) {
        // Windows with worn friction would show it by the reading of the load alone, and so not at all.
        if moves_one_way(job) {
            sigma[FaultId::Friction.parameter()] = None;
        }
    }
    let explained = of_unit.iter().filter(|estimate| !estimate.is_unmodelled()).count();
    Ok(Some(MonitorLearnt {
        evidence: Evidence::new(&sigmas, explained),
        unit,
        estimates,
    }))
}

/// Time constants of the currents that are tried, s: comparators, then current control with a bandwidth of 1,000, 600 and 350 Hz.
pub(super) const CURRENT_TIME_CONSTANTS_S: [f64; 4] = [0.0, 1.6e-4, 2.7e-4, 4.5e-4];

/// Costs within this factor of the least one explain the windows alike.
const ALIKE: f64 = 2.0;

/// The parameters of the unit and how its drive follows the references: of the time constants that explain the windows alike, one that
/// leaves the actuator near its type, and of these the one that explains them best. Cost and baseline are still open.
fn fit(
    assessor: &Assessor,
    jobs: &[WindowJob],
    time_constants_s: &[f64],
) -> Result<Option<UnitMonitor>, CommissioningError> {
    if let [only] = time_constants_s {
        return fit_with(assessor, jobs, *only);
    }
    let few = &jobs[..WINDOWS_MIN.min(jobs.len())];
    let mut found = Vec::with_capacity(time_constants_s.len());
    for &current_time_constant_s in time_constants_s {
        found.extend(fit_with(assessor, few, current_time_constant_s)?);
    }
    let least = found.iter().map(|unit| unit.cost).fold(f64::INFINITY, f64::min);
    let best = found
        .iter()
        .filter(|unit| unit.cost <= ALIKE * least)
        .map(|unit| (far_parameter(unit, &few[0]).is_some(), unit))
        .min_by(|(far, unit), (other_far, other)| far.cmp(other_far).then(unit.cost.total_cmp(&other.cost)));
    best.map_or(Ok(None), |(_, best)| {
        fit_with(assessor, jobs, best.current_time_constant_s)
    })
}

/// The parameters of the unit for one time constant of its currents, s.
fn fit_with(
    assessor: &Assessor,
    jobs: &[WindowJob],
    current_time_constant_s: f64,
) -> Result<Option<UnitMonitor>, CommissioningError> {
    let mut prepared = Vec::with_capacity(jobs.len());
    for job in jobs {
        let (identifier, conditions) = of_type(assessor, job, current_time_constant_s)?;
        let samples = job.window.prepared(&identifier.params);
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
    let of_type = jobs.first().map_or(Tolerances::USUAL, |job| job.actuator.tolerances);
    Ok(fit_unit_parameters(&compared, &of_type).map(|fit| UnitMonitor {
        cost: fit.cost,
        parameters: if current_time_constant_s > 0.0 {
            fit.parameters.relative_to_back_emf()
        } else {
            fit.parameters
        },
        current_time_constant_s,
        baseline: Default::default(),
    }))
}

/// The identifier of the type for a window, every number known exactly, and the window's conditions.
fn of_type(
    assessor: &Assessor,
    job: &WindowJob,
    current_time_constant_s: f64,
) -> Result<(Identifier, Conditions), CommissioningError> {
    let window = job.window.number;
    let conditions = conditions(job).map_err(|sentence| CommissioningError::Conditions { window, sentence })?;
    let mut identifier = assessor.identifier_of(job)?;
    identifier.tolerances = Tolerances::NONE;
    identifier.calibration = identifier
        .calibration
        .with_current_time_constant(current_time_constant_s);
    Ok((identifier, conditions))
}

impl MonitorLearnt {
    /// Whether a parameter that is far from its type is the unit's own: the windows are explained like those of the type, and all
    /// other parameters are usual. Another drive than the type's moves several of them, or leaves a larger cost.
    pub(super) fn is_certain(&self, of_type: &Tolerances) -> bool {
        let distance =
            |parameter: UnitParameter| self.unit.parameters.of(parameter).share.abs() / parameter.tolerance(of_type);
        let unusual = UnitParameter::ALL
            .into_iter()
            .filter(|&parameter| distance(parameter) > USUAL_TOLERANCES);
        self.unit.cost <= USUAL_COST && unusual.count() <= 1
    }

    /// The first parameter of the actuator that is far from the type.
    pub(super) fn far_parameter(&self, job: &WindowJob) -> Option<FarParameter> {
        far_parameter(&self.unit, job)
    }

    /// Parameters of the controller that are far from the type.
    pub(super) fn far_of_controller(&self, job: &WindowJob) -> Vec<FarParameter> {
        UnitParameter::ALL
            .into_iter()
            .filter(|parameter| parameter.is_of_controller())
            .filter_map(|parameter| far(&self.unit, parameter, job))
            .collect()
    }
}

fn far_parameter(unit: &UnitMonitor, job: &WindowJob) -> Option<FarParameter> {
    UnitParameter::ALL
        .into_iter()
        .filter(|parameter| !parameter.is_of_controller())
        .find_map(|parameter| far(unit, parameter, job))
}

/// The parameter, if it is far from the type.
fn far(unit: &UnitMonitor, parameter: UnitParameter, job: &WindowJob) -> Option<FarParameter> {
    let share = unit.parameters.of(parameter).share;
    let of_type = parameter.value(&job.params);
    let own = parameter.tolerance(&job.actuator.tolerances);
    // Without voltages all torques are relative to the type's k.
    let tolerance = if unit.current_time_constant_s > 0.0 {
        own.hypot(UnitParameter::BackEmf.tolerance(&job.actuator.tolerances))
    } else {
        own
    };
    (share.abs() > TOLERANCES_MAX * tolerance).then(|| FarParameter {
        type_name: job.actuator.type_name.clone(),
        key: parameter.key(),
        of_type,
        found: (1.0 + share) * of_type,
        tolerance: tolerance * of_type,
    })
}
