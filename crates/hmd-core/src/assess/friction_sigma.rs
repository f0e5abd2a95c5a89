//! How far friction may be off for conditions that commissioning has not seen.

use ema_identify::relations::{Directions, GearLossSigma, Term};
use ema_identify::unit_calibration::{UnitCalibration, UnitParameter};

use crate::motion::{beyond, friction_sigma_by_temperature, moves_one_way};
use crate::outbox::WindowJob;

/// One standard deviation of k1 by load and temperature beyond those of commissioning.
pub(super) fn friction_sigma(job: &WindowJob, unit: &UnitCalibration) -> f64 {
    by_load(job, unit).hypot(friction_sigma_by_temperature(job, unit.seen.winding_temp_deg_c))
}

/// One standard deviation of k1 by a measured load beyond those of commissioning, Nm. 0 where either is not measured.
fn by_load(job: &WindowJob, unit: &UnitCalibration) -> f64 {
    let (Some(range), Some(load)) = (unit.seen.load_torque_nm, job.conditions.load_torque_nm) else {
        return 0.0;
    };
    let directions = if moves_one_way(job) {
        Directions::One
    } else {
        Directions::Both
    };
    let gear_ratio = job.params.transmission.gear_ratio;
    gear_loss_sigma(job).of_friction(beyond(range, load), directions, gear_ratio, dry_friction(job, unit))
}

/// How well it is known what the gear of an actuator loses under a load.
pub(super) fn gear_loss_sigma(job: &WindowJob) -> GearLossSigma {
    GearLossSigma::new(&job.params.transmission, &job.actuator.tolerances)
}

/// Dry friction of a unit when it was commissioned, Nm at the motor.
fn dry_friction(job: &WindowJob, unit: &UnitCalibration) -> f64 {
    let by_relations = unit
        .relations
        .map(|relations| relations.commissioned.balance.of(Term::DryFriction));
    let by_monitor = || {
        let params = unit.monitor?.parameters.applied_to(&job.params);
        Some(UnitParameter::DryFriction.value(&params))
    };
    let learnt = by_relations.or_else(by_monitor).filter(|learnt| *learnt > 0.0);
    learnt.unwrap_or(job.params.transmission.friction_dynamic)
}
