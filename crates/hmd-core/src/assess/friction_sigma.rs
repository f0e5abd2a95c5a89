//! How far friction may be off for conditions that commissioning has not seen.

use ema_identify::unit_calibration::Seen;

use crate::motion::{beyond, friction_torque_sigma, moves_one_way};
use crate::outbox::WindowJob;

/// One standard deviation of k1 by load and temperature beyond those of commissioning.
pub(super) fn friction_sigma(job: &WindowJob, seen: &Seen) -> f64 {
    by_load(job, seen).hypot(by_temperature(job, seen))
}

/// One standard deviation of k1 by a load beyond those of commissioning, Nm: `½ σ_T/T_d` with
/// `σ_T = a M/(2 N) √((σ_o/η_o)² + (σ_a η_a)²)`, the shares σ of the efficiencies that their tolerances leave, and a = 1; in motion one way,
/// which tells nothing of the other direction, a = 2. Derived here from the torque of a load at the motor shaft, M/(N η_o) opposing and
/// M η_a/N aiding. 0 where either is not measured.
fn by_load(job: &WindowJob, seen: &Seen) -> f64 {
    let (Some(range), Some(load)) = (seen.load_torque_nm, job.conditions.load_torque_nm) else {
        return 0.0;
    };
    let beyond = beyond(range, load);
    let gear = &job.params.transmission;
    let directions = if moves_one_way(job) { 2.0 } else { 1.0 };
    let torque = 0.5 * directions * beyond / gear.gear_ratio * gear_loss_sigma(job);
    0.5 * torque / gear.friction_dynamic.max(f64::MIN_POSITIVE)
}

/// One standard deviation of the torque that the gear loses under a load, as a share of that load's torque at the motor, by the tolerances of
/// the efficiencies: `√((σ_o/η_o)² + (σ_a η_a)²)`.
pub(super) fn gear_loss_sigma(job: &WindowJob) -> f64 {
    let gear = &job.params.transmission;
    let tolerances = &job.actuator.tolerances;
    let opposing = tolerances.efficiency_opposing / gear.efficiency_opposing;
    let aiding = tolerances.efficiency_aiding * gear.efficiency_aiding;
    opposing.hypot(aiding)
}

/// The same by a winding temperature beyond those of commissioning, `½ σ_T/T_d`. A healthy `bench` 25 K colder than at commissioning, its C and
/// T_d in the middle of their usual ranges, reads friction of 0.10. 0 where either temperature is not measured. Derived here.
fn by_temperature(job: &WindowJob, seen: &Seen) -> f64 {
    let dry = job.params.transmission.friction_dynamic.max(f64::MIN_POSITIVE);
    0.5 * friction_torque_sigma(job, seen.winding_temp_deg_c) / dry
}
