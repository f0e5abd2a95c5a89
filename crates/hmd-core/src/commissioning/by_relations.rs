//! The relations of one unit, and what they say of windows that were left out.

use ema_identify::relations::{
    BalanceShape, CommissionError, CommissionedRelations, Element, FRICTION_MIN_SHARE, MeasuredWindow,
    MeasurementNoise, Needed, RelationsEstimate, SinceCommissioning, Term, coarse_torque_error, commission,
    commission_as,
};
use ema_identify::unit_calibration::{Seen, UnitParameter, UnitRelations, nominal_elements};
use ema_identify::unit_estimate::{AlignedWindow, estimate_by_relations};
use ema_models::{FaultId, FaultVector, SensedSample};

use super::evidence::Evidence;
use super::{FarParameter, PLAY, TOLERANCES_MAX};
use crate::outbox::WindowJob;

/// Tolerance of the play, as a share of the type's.
const PLAY_TOLERANCE: f64 = 0.5;

/// Error of the torque at ω_max, as a share of the largest, within which the damping is known; that of the residual of any unit.
const TORQUE_BEND: f64 = 5e-3;

/// Factor on the sigmas of the rotor's faults behind a gear that may bend: of a unit with a resonance at 90 Hz whose play is as wide as the twist
/// under its friction, healthy windows show shorts of up to 5 sigmas.
const BENDING_FACTOR: f64 = 3.0;

/// Relations that were learnt.
pub(super) struct RelationsLearnt {
    pub(super) unit: UnitRelations,
    pub(super) evidence: Evidence,
    /// What was found in each window by what was learnt from the others.
    pub(super) left_out: Vec<RelationsEstimate>,
}

/// Learns the relations of a unit from windows in these conditions.
///
/// # Errors
/// The windows do not determine them.
pub(super) fn learn_relations(jobs: &[WindowJob], seen: &Seen) -> Result<RelationsLearnt, CommissionError> {
    let aligned = jobs.iter().map(|job| {
        let since = SinceCommissioning {
            winding_temp: seen.winding_temp(job.conditions.winding_temp_deg_c),
            measured_load: job.conditions.load_torque_nm,
            ..SinceCommissioning::default()
        };
        job.window.aligned(&job.params, since)
    });
    let aligned: Vec<AlignedWindow<'_>> = aligned.collect();
    let windows: Vec<MeasuredWindow<'_, SensedSample>> = aligned.iter().map(AlignedWindow::measured).collect();
    let shape = BalanceShape::usual(&jobs[0].params);
    let commissioned = commission(&windows, &shape)?;
    let mut found = Vec::with_capacity(windows.len());
    for n in 0..windows.len() {
        let mut others = windows.clone();
        others.remove(n);
        let of_others = commission_as(&others, &commissioned.balance.shape).map_err(|error| match error {
            CommissionError::TooFewWindows { found } => CommissionError::TooFewWindows { found: found + 1 },
            CommissionError::NoSolution => error,
        })?;
        found.push(of_others.estimate(&windows[n]));
    }
    // One in which the motor stands has no residual.
    let moving = found.iter().filter(|found| found.torque_rows > 0);
    let rms = moving.clone().map(|found| found.torque_residual_rms).sum::<f64>() / moving.count().max(1) as f64;
    let sigma_factors = Element::ALL.map(|element| {
        let parameter = element.fault().parameter();
        let nominal = if parameter == ECCENTRICITY {
            0.0
        } else {
            nominal_elements()[element as usize]
        };
        // The amplitude of the eccentricity has two components.
        let components = if parameter == ECCENTRICITY { 2.0 } else { 1.0 };
        let squares: Vec<f64> = found
            .iter()
            .filter_map(|found| Some((found.k[parameter] - nominal) / found.sigma[parameter]?))
            .map(|ratio| ratio * ratio / components)
            .collect();
        let mean = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
        let is_of_the_rotor = Element::BALANCE.contains(&element) && element != Element::Friction;
        let of_bending = if commissioned.may_bend && is_of_the_rotor {
            BENDING_FACTOR
        } else {
            1.0
        };
        of_bending * mean.sqrt().max(1.0)
    });
    let unit = UnitRelations {
        residual_rms_nm: rms,
        sigma_factors,
        noise: MeasurementNoise::mean(windows.iter().filter_map(MeasurementNoise::of)),
        commissioned,
    };
    let sigmas: Vec<_> = aligned
        .iter()
        .map(|window| estimate_by_relations(&unit, window, false).estimate.sigma)
        .collect();
    let explained = found.iter().filter(|found| found.torque_rows > 0).count();
    Ok(RelationsLearnt {
        evidence: Evidence::new(&sigmas, explained),
        unit,
        left_out: found,
    })
}

const ECCENTRICITY: usize = FaultVector::ECCENTRICITY_PHASE_INDEX - 1;

impl RelationsLearnt {
    /// Whether a load closes the play in most windows: the monitor, which knows no such load, shows it no more.
    pub(super) fn is_play_closed(&self) -> bool {
        let backlash = FaultId::Backlash.parameter();
        let closed = self
            .left_out
            .iter()
            .filter(|found| found.needed[backlash] == Some(Needed::OpenReversal));
        2 * closed.count() > self.left_out.len()
    }

    /// The first parameter that is far from the type. Torques are relative to the type's k.
    pub(super) fn far_parameter(&self, job: &WindowJob) -> Option<FarParameter> {
        let CommissionedRelations { balance, baseline, .. } = &self.unit.commissioned;
        let tolerances = &job.actuator.tolerances;
        let of_torque = |parameter: UnitParameter| {
            parameter
                .tolerance(tolerances)
                .hypot(UnitParameter::BackEmf.tolerance(tolerances))
        };
        let far = |key, of_type: f64, found: f64, tolerance: f64| FarParameter {
            type_name: job.actuator.type_name.clone(),
            key,
            of_type,
            found,
            tolerance,
        };
        let motor = &job.params.motor;
        // What bends the torque with current or speed (saturation, iron losses) is taken for damping.
        let peak = motor.torque_gain() * motor.i_max;
        let error = TORQUE_BEND * peak;
        // What a gear that may bend leaves unexplained may be in phase with the speed.
        let unexplained = if self.unit.commissioned.may_bend {
            balance.residual_rms
        } else {
            0.0
        };
        let error = error.hypot(coarse_torque_error(&job.params)).hypot(unexplained);
        let bend = error / job.params.controller.omega_max;
        let of_balance = [
            (UnitParameter::Inertia, balance.of(Term::Inertia)),
            (UnitParameter::DryFriction, balance.of(Term::DryFriction)),
            (UnitParameter::Damping, balance.of(Term::Damping)),
        ]
        .map(|(parameter, found)| {
            let least = match parameter {
                UnitParameter::Damping => bend,
                // A data sheet may say none.
                UnitParameter::DryFriction => FRICTION_MIN_SHARE * peak,
                _ => 0.0,
            };
            let of_type = parameter.value(&job.params);
            let tolerance = (of_torque(parameter) * of_type).hypot(least);
            far(parameter.key(), of_type, found, tolerance)
        });
        let play = baseline[Element::Backlash as usize];
        // The scatter from window to window is no property of the unit.
        let sure = (play.mean - TOLERANCES_MAX * play.scatter).max(0.0);
        let of_type = job.params.transmission.backlash;
        let play = far(PLAY, of_type, sure, PLAY_TOLERANCE * of_type);
        of_balance
            .into_iter()
            .chain([play])
            .find(|far| (far.found - far.of_type).abs() > TOLERANCES_MAX * far.tolerance)
    }
}
