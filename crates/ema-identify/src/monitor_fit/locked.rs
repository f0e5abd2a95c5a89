//! Whether the motor stood while it was commanded to move.

use ema_models::Setpoint;

use super::window::MonitoredWindow;

/// Share of what was commanded that the motor must have turned.
const LEAST_TURN: f64 = 0.1;

/// Time that it has for it, s: what is commanded later than this before the window's end does not count.
const TIME_TO_TURN: f64 = 0.1;

/// Whether the motor stood while it was commanded to move. Then there is nothing to compare: a brake, a jam and a motor
/// without any torque look the same. What it cannot turn at its largest speed in the time left is not asked of it.
pub(crate) fn is_locked(window: &impl MonitoredWindow) -> bool {
    let Some((first_setpoint, first_angle)) = window.setpoints_and_angles().next() else {
        return false;
    };
    let rate = window.params().sensors.sample_rate;
    let counted = window.sample_count().saturating_sub((TIME_TO_TURN * rate) as usize);
    let gear = window.params().transmission.gear_ratio;
    let omega_max = window.params().controller.omega_max;
    let time_left = |since: usize| window.sample_count().saturating_sub(since) as f64 / rate;
    let (mut commanded, mut farthest_commanded, mut turned) = (0.0, 0.0_f64, 0.0_f64);
    let mut possible = f64::INFINITY;
    for (n, (setpoint, angle)) in window.setpoints_and_angles().enumerate() {
        if n < counted {
            match (setpoint, first_setpoint) {
                (Setpoint::Position(now), Setpoint::Position(before)) => commanded = gear * (now - before),
                (Setpoint::Speed(speed), _) => commanded += speed / rate,
                _ => {}
            }
            farthest_commanded = farthest_commanded.max(f64::abs(commanded));
            if commanded != 0.0 && possible.is_infinite() {
                possible = omega_max * time_left(n);
            }
        }
        turned = turned.max((angle - first_angle).abs());
    }
    turned < LEAST_TURN * farthest_commanded.min(possible)
}
