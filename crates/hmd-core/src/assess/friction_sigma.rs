//! How far friction may be off for conditions that commissioning has not seen.

use ema_identify::unit_calibration::Seen;
use ema_models::FRICTION_TEMPERATURE_SPAN_K;

use crate::motion::{mean_speed, moves_one_way};
use crate::outbox::WindowJob;

/// One standard deviation of k1 by load and temperature beyond those of commissioning.
pub(super) fn friction_sigma(job: &WindowJob, seen: &Seen) -> f64 {
    by_load(job, seen).hypot(by_temperature(job, seen))
}

/// How far a value lies beyond a range.
fn beyond([least, most]: [f64; 2], value: f64) -> f64 {
    (least - value).max(value - most).max(0.0)
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
    let tolerances = &job.actuator.tolerances;
    let opposing = tolerances.efficiency_opposing / gear.efficiency_opposing;
    let aiding = tolerances.efficiency_aiding * gear.efficiency_aiding;
    let directions = if moves_one_way(job) { 2.0 } else { 1.0 };
    let torque = 0.5 * directions * beyond / gear.gear_ratio * opposing.hypot(aiding);
    0.5 * torque / gear.friction_dynamic.max(f64::MIN_POSITIVE)
}

/// The same by a winding temperature ΔT beyond those of commissioning: `½ √((σ_d T_d)² + (σ_c C ω)²)/T_d · ΔT/80 K` with the tolerances of
/// the logarithms of T_d and C at 80 K and the mean speed ω of the motion. A healthy `bench` 25 K colder than at commissioning, its C and T_d
/// in the middle of their usual ranges, reads friction of 0.10. 0 where either temperature is not measured. Derived here.
fn by_temperature(job: &WindowJob, seen: &Seen) -> f64 {
    let (Some(range), Some(found)) = (seen.winding_temp_deg_c, job.conditions.winding_temp_deg_c) else {
        return 0.0;
    };
    let tolerances = &job.actuator.tolerances;
    let dry = job.params.transmission.friction_dynamic;
    let viscous = job.params.motor.c * mean_speed(job);
    let spread = (tolerances.friction_temperature * dry).hypot(tolerances.viscous_temperature * viscous);
    0.5 * spread / dry.max(f64::MIN_POSITIVE) * beyond(range, found) / FRICTION_TEMPERATURE_SPAN_K
}
