//! Gear ratio to parts in a thousand: what separates the two angles along the travel.
//!
//! `θ_out − θ_m/n = c + ε θ_m/n + ½ w s + τ θ_out' − b i_q`: ε the error of the ratio, w the play, s = ±1 the flank that the motor pushes, τ the
//! age of one angle against the other, b the bending by each ampere. Where the residual is no more than the encoder's counts, no play that
//! the output crosses and no error of the encoder makes up ε. A spring load bends a soft gear along the travel, too: its current tells, and
//! where it goes with the travel alone the sigma of ε says so. Derived here.

use ema_models::ActuatorParams;

use super::flank::{Flank, REVERSAL_COUNTS};
use super::least_squares::fit;
use super::signals::Signals;

/// Residual, root mean square, that counts of an encoder make, counts: 1/√12, with what filled samples add.
const OF_COUNTS: f64 = 0.4;

/// Residual beside it, as a share of what the error of the ratio makes of the travel.
const OF_ERROR: f64 = 0.05;

/// Softest gear: resonance of the motor before it, rad/s, and share of the inertia that swings.
const SOFT_RAD_S: f64 = 250.0;
const SOFT_INERTIA_SHARE: f64 = 0.09;

/// Error of a ratio that is none of teeth: bending that the current does not show, an eccentric encoder of 0.1 %.
const ERROR_MIN: f64 = 8e-3;

/// Counts of the encoder by which both ends of the travel may be off together.
const END_COUNTS: f64 = 0.5;

/// Age of one angle against the other, sample periods, that sensors have: a load that coasts through its play looks older.
const AGE_SAMPLES: f64 = 2.0;

/// Standard deviations of the fit.
const SIGMAS: f64 = 4.0;

/// Bending of the softest gear at the output by each ampere, rad/A.
pub(super) fn bending(params: &ActuatorParams) -> f64 {
    let motor = &params.motor;
    let stiffness = SOFT_RAD_S * SOFT_RAD_S * SOFT_INERTIA_SHARE * motor.j;
    motor.torque_gain() / (stiffness * params.transmission.gear_ratio)
}

/// What the output turns for each turn of the motor, times the gear ratio, with its standard deviation, where that is clearly not 1.
pub(super) fn precise_ratio(signals: &Signals, params: &ActuatorParams) -> Option<(f64, f64)> {
    let count = params.sensors.output_lsb();
    let gear_ratio = params.transmission.gear_ratio;
    let first = signals.rows.first()?;
    let angles = signals.rows.iter().map(|row| {
        let motor = (row.theta_m - first.theta_m) / gear_ratio;
        let [_, i_q] = signals.i_dq(row);
        (motor, row.theta_out - first.theta_out, row.omega_m / gear_ratio, i_q)
    });
    let mut of_motor = Flank::default();
    let rows = angles.filter_map(|(motor, output, speed, i_q)| {
        let flank = of_motor.follow(motor, REVERSAL_COUNTS * count);
        (flank != 0.0).then_some(([1.0, motor, 0.5 * flank, speed, -i_q], output - motor))
    });
    let (free, age) = ((0.0, f64::INFINITY), 1.0 / signals.rate_hz);
    // A motion one way has one flank, which is as good as the constant.
    let play = (0.0, signals.span(|row| row.theta_out).max(count));
    let found = fit(rows, [free, free, play, (0.0, age), (0.0, bending(params))], 1.0)?;
    let (error, sigma) = (found.value[1], found.sigma[1]);
    let travel = signals.span(|row| row.theta_m) / gear_ratio;
    let explained = (OF_COUNTS * count).hypot(OF_ERROR * error * travel);
    let least = ERROR_MIN + END_COUNTS * count / travel + SIGMAS * sigma;
    let is_line = found.mean_square < explained * explained;
    let is_age = found.value[3].abs() < AGE_SAMPLES * age;
    (is_line && is_age && error.abs() > least).then_some((1.0 + error, sigma.hypot(END_COUNTS * count / travel)))
}
