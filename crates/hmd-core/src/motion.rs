//! How an actuator moves in a window.

use ema_identify::unit_calibration::Motion;
use ema_models::{FRICTION_TEMPERATURE_SPAN_K, SensedSample};
use ema_wire::quantity::current_a;

use crate::outbox::WindowJob;
use crate::setpoint_hold::held_s;
use crate::step_width::step_width;

/// Conditions and motion of a window, to be compared with those of commissioning.
#[must_use]
pub(crate) fn motion_of(job: &WindowJob) -> Motion {
    Motion {
        winding_temp_deg_c: job.conditions.winding_temp_deg_c,
        load_torque: job.conditions.load_torque_nm,
        steps: steps(job),
        has_output_angle: job.actuator.has_output_angle(),
        setpoint_held_s: held_s(&job.window.samples, job.params.sensors.sample_rate),
        ..Motion::of(&job.params, &job.window.samples)
    }
}

/// Steps of currents, A, motor and output angle, counts, by the samples that were measured.
pub(crate) fn steps(job: &WindowJob) -> [f64; 3] {
    let window = &job.window;
    let of = |signal: &dyn Fn(&SensedSample) -> f64, unit: f64| {
        let all = window.samples.iter().enumerate();
        let measured = all.filter(|(n, _)| window.filled.binary_search(n).is_err());
        let values: Vec<f64> = measured.map(|(_, sample)| signal(sample)).collect();
        step_width(&values, unit)
    };
    let of_phases = [0, 1, 2].map(|phase| of(&|sample| sample.currents[phase], current_a(1)));
    let of_currents = of_phases.into_iter().filter(|step| *step > 0.0).reduce(f64::min);
    [
        of_currents.unwrap_or(0.0),
        of(&|sample| sample.motor_counts as f64, 1.0),
        of(&|sample| sample.output_counts as f64, 1.0),
    ]
}

/// Speed from which on friction has the sign of a direction, rad/s, and time for which it must last, s.
const MOVES: f64 = 3.0;
const LASTS_S: f64 = 0.01;

/// Speed of the motor between samples, rad/s.
fn speeds(job: &WindowJob) -> impl Iterator<Item = f64> {
    let sensors = &job.params.sensors;
    let per_count = sensors.motor_lsb() * sensors.sample_rate;
    let turned = |pair: &[SensedSample]| pair[1].motor_counts.saturating_sub(pair[0].motor_counts);
    job.window
        .samples
        .windows(2)
        .map(move |pair| turned(pair) as f64 * per_count)
}

/// Mean magnitude of the motor's speed while it turns, rad/s; 0 where it does not.
fn mean_speed(job: &WindowJob) -> f64 {
    let moving = speeds(job).map(f64::abs).filter(|speed| *speed > MOVES);
    let (sum, count) = moving.fold((0.0, 0.0_f64), |(sum, count), speed| (sum + speed, count + 1.0));
    sum / count.max(1.0)
}

/// Magnitude of the motor's speed that a twentieth of the samples passes while it turns, rad/s; 0 where it does not.
fn top_speed(job: &WindowJob) -> f64 {
    let mut moving: Vec<f64> = speeds(job).map(f64::abs).filter(|speed| *speed > MOVES).collect();
    let place = moving.len() * 19 / 20;
    if place == moving.len() {
        return 0.0;
    }
    *moving.select_nth_unstable_by(place, f64::total_cmp).1
}

/// Factor on the sigma of friction in motion one way, which shows friction and load together; of units commissioned by steps, also where the load
/// is read: 2 of 26 windows of `bench` with a worn friction end 4.7 sigmas off without.
pub(crate) const ONE_WAY_FACTOR: f64 = 2.0;

/// Whether the motor turns for a while in one direction only.
pub(crate) fn moves_one_way(job: &WindowJob) -> bool {
    let needed = (LASTS_S * job.params.sensors.sample_rate).ceil();
    let (mut runs, mut longest) = ([0.0_f64; 2], [0.0_f64; 2]);
    for speed in speeds(job) {
        for (place, speed) in [speed, -speed].into_iter().enumerate() {
            runs[place] = if speed > MOVES { runs[place] + 1.0 } else { 0.0 };
            longest[place] = longest[place].max(runs[place]);
        }
    }
    longest.iter().any(|&longest| longest < needed)
}

/// How far a value lies beyond a range.
pub(crate) fn beyond([least, most]: [f64; 2], value: f64) -> f64 {
    (least - value).max(value - most).max(0.0)
}

/// One standard deviation, K, of the temperature of a window from that of commissioning where one of both is not measured: the seasons of a
/// place, or a motor that has worked for a while.
pub(crate) const UNKNOWN_TEMPERATURE_SIGMA_K: f64 = 20.0;

/// One standard deviation of a friction torque at the motor shaft by a winding temperature ΔT beyond those of commissioning, in the unit of both its
/// parts: `√((σ_d dry)² + (σ_c viscous)²) · ΔT/80 K` with the tolerances of the logarithms of T_d and C at 80 K. Where either temperature is not
/// measured, ΔT is [`UNKNOWN_TEMPERATURE_SIGMA_K`]. Derived here.
fn friction_sigma(job: &WindowJob, commissioned_deg_c: Option<[f64; 2]>, [dry, viscous]: [f64; 2]) -> f64 {
    let off_k = match (commissioned_deg_c, job.conditions.winding_temp_deg_c) {
        (Some(range), Some(found)) => beyond(range, found),
        _ => UNKNOWN_TEMPERATURE_SIGMA_K,
    };
    let tolerances = &job.actuator.tolerances;
    let (dry, viscous) = (
        tolerances.friction_temperature * dry,
        tolerances.viscous_temperature * viscous,
    );
    dry.hypot(viscous) * off_k / FRICTION_TEMPERATURE_SPAN_K
}

/// The same of the load at the output, Nm, that the motion needs, where the friction is `worn` times that of commissioning. What the friction changes at the
/// top speed may pass for a load of one direction (test `friction_at_other_temperatures_is_neither_denied_nor_accused`). C counts at the end of its tolerance. Derived here.
pub(crate) fn load_sigma_by_temperature(job: &WindowJob, commissioned_deg_c: Option<[f64; 2]>, worn: f64) -> f64 {
    let (motor, transmission) = (&job.params.motor, &job.params.transmission);
    let dry = worn.max(1.0) * transmission.friction_dynamic;
    let viscous = (1.0 + job.actuator.tolerances.c) * motor.c * top_speed(job);
    transmission.gear_ratio * friction_sigma(job, commissioned_deg_c, [dry, viscous])
}

/// The same of the friction parameter k1, `½ σ_T/T_d`. A healthy `bench` 25 K colder than at commissioning, its C and T_d in the middle of their
/// usual ranges, reads friction of 0.10. Derived here.
pub(crate) fn friction_sigma_by_temperature(job: &WindowJob, commissioned_deg_c: Option<[f64; 2]>) -> f64 {
    let dry = job.params.transmission.friction_dynamic.max(f64::MIN_POSITIVE);
    let viscous = job.params.motor.c * mean_speed(job);
    0.5 * friction_sigma(job, commissioned_deg_c, [dry, viscous]) / dry
}
