//! Balance of the motor shaft with the type's numbers: gain and sign of the currents, and the load.
//!
//! `J ω' = g 3/2 k i_q − T_d sign ω − C ω − T_l / n`, averaged over triangles so that the second difference of the angle is the
//! acceleration averaged in the same way. Derived here.

use ema_models::ActuatorParams;

use super::least_squares::fit;
use super::signals::Signals;

/// What the balance finds in a window, each with its standard deviation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Balance {
    /// Torque by the motion over torque by the currents.
    pub(super) gain: (f64, f64),
    /// Load at the output, Nm; of windows whose samples are too far apart none is found.
    pub(super) load: Option<(f64, f64)>,
}

/// Half width of the triangles, s.
const HALF_WIDTH_S: f64 = 3e-3;

/// Samples of half a triangle from which on what the torque does between them averages out.
const HALF_WIDTH_FINE: usize = 4;

/// Speed below which dry friction has no sign, rad/s.
const SPEED_MIN: f64 = 3.0;

/// Standard deviation of the damping, as a share.
const DAMPING_SHARE: f64 = 1.0;

/// The balance of a window; `None` where it hardly moves.
pub(super) fn balance(signals: &Signals, params: &ActuatorParams) -> Option<Balance> {
    let half = ((HALF_WIDTH_S * signals.rate_hz).round() as usize).max(2);
    let is_fine = half >= HALF_WIDTH_FINE;
    let motor = &params.motor;
    let step = half as f64 / signals.rate_hz;
    let rows = (half..signals.rows.len().saturating_sub(half)).filter_map(|n| {
        let around = &signals.rows[n - half..=n + half];
        let (first, last) = (around.first()?, around.last()?);
        let speed = (last.theta_m - first.theta_m) / (2.0 * step);
        if !around
            .iter()
            .all(|row| row.omega_m * speed > 0.0 && row.omega_m.abs() > SPEED_MIN)
        {
            return None;
        }
        let acceleration = (last.theta_m - 2.0 * signals.rows[n].theta_m + first.theta_m) / (step * step);
        let weight = |place: usize| (half as f64 - (place as f64 - half as f64).abs()) / (half * half) as f64;
        let i_q: f64 = around
            .iter()
            .enumerate()
            .map(|(place, row)| weight(place) * signals.i_dq(row)[1])
            .sum();
        let columns = [
            motor.torque_gain() * i_q,
            -speed.signum(),
            -speed,
            -1.0 / params.transmission.gear_ratio,
        ];
        Some((columns, motor.j * acceleration))
    });
    let free = (0.0, f64::INFINITY);
    let friction = params.transmission.friction_dynamic;
    let prior = [
        free,
        // Any wear, but no friction that drives.
        (2.0 * friction, 2.0 * friction),
        (motor.c, DAMPING_SHARE * motor.c.max(1e-9)),
        free,
    ];
    let found = fit(rows, prior, 2.0 * half as f64)?;
    Some(Balance {
        gain: (found.value[0], found.sigma[0]),
        load: is_fine.then_some((found.value[3], found.sigma[3])),
    })
}
