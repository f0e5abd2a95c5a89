//! How an actuator moves in a window.

use ema_identify::unit_calibration::Motion;
use ema_models::SensedSample;

use crate::outbox::WindowJob;

/// Conditions and motion of a window, to be compared with those of commissioning.
#[must_use]
pub(crate) fn motion_of(job: &WindowJob) -> Motion {
    Motion {
        winding_temp_deg_c: job.conditions.winding_temp_deg_c,
        load_torque: job.conditions.load_torque_nm,
        ..Motion::of(&job.params, &job.window.samples)
    }
}

/// Speed from which on friction has the sign of a direction, rad/s, and time for which it must last, s.
const MOVES: f64 = 3.0;
const LASTS_S: f64 = 0.01;

/// Whether the motor turns for a while in one direction only.
pub(crate) fn moves_one_way(job: &WindowJob) -> bool {
    let sensors = &job.params.sensors;
    let speed = |pair: &[SensedSample]| {
        pair[1].motor_counts.saturating_sub(pair[0].motor_counts) as f64 * sensors.motor_lsb() * sensors.sample_rate
    };
    let needed = (LASTS_S * sensors.sample_rate).ceil();
    let (mut runs, mut longest) = ([0.0_f64; 2], [0.0_f64; 2]);
    for pair in job.window.samples.windows(2) {
        let speed = speed(pair);
        for (place, speed) in [speed, -speed].into_iter().enumerate() {
            runs[place] = if speed > MOVES { runs[place] + 1.0 } else { 0.0 };
            longest[place] = longest[place].max(runs[place]);
        }
    }
    longest.iter().any(|&longest| longest < needed)
}
