//! A motor angle of another instant than currents and output angle.
//!
//! A motor angle that is late by τ is behind the output angle by `τ ω_m`, beside the play and the bending of the gear: `θ_out − θ_m/n =
//! c + ½ w s + τ θ_m'/n − b i_q`, s = ±1 the flank, while the output moves with the motor. Phase currents are then turned by `τ ω_e` against the
//! rotor; where the log has them in the rotor's frame, that frame was right, and the torque precedes the acceleration: `J θ_m'' = T − τ T' − …`.
//! An output that is early, or currents that are late, break one of the two relations only. Derived here.

use ema_models::ActuatorParams;

use super::flank::{Flank, REVERSAL_COUNTS};
use super::gear_ratio::bending;
use super::least_squares::fit;
use super::signals::{Row, Signals};
use super::wiring::{LATE_MAX_S, LEFT, OFF_AXIS_LATE, Wiring, best_lateness, share_on_torque_axis};

/// A motor angle that is late against the other signals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MotorTime {
    /// Time, s; negative where it is early.
    pub(super) late_s: f64,
    /// The same in samples.
    pub(super) late: isize,
    /// Whether the log has the currents in the rotor's frame.
    pub(super) in_rotor_frame: bool,
}

/// Standard deviations of a time that chance does not make.
const SIGMAS: f64 = 4.0;

/// Difference of two times of one motor angle, sample periods, and as a share.
const ALIKE_PERIODS: f64 = 0.75;
const ALIKE_SHARE: f64 = 0.25;

/// Time by which the motor angle is late against the output angle and, as much, against the currents.
pub(super) fn motor_time(signals: &Signals, params: &ActuatorParams) -> Option<MotorTime> {
    let (late_s, sigma) = late_by_output(signals, params)?;
    let late = (late_s * signals.rate_hz).round() as isize;
    if late == 0 || late_s.abs() < SIGMAS * sigma || late_s.abs() > LATE_MAX_S + 1.0 / signals.rate_hz {
        return None;
    }
    let is_same =
        |other_s: f64| (other_s - late_s).abs() < (ALIKE_PERIODS / signals.rate_hz).max(ALIKE_SHARE * late_s.abs());
    let counts = |row: &Row| signals.is_controlled(row);
    let share = share_on_torque_axis(signals, Wiring::Right, counts)?;
    let (currents_late, best) = best_lateness(signals)?;
    let in_rotor_frame = if 1.0 - best < LEFT * (1.0 - share) && 1.0 - share > OFF_AXIS_SEEN {
        if !is_same(-(currents_late as f64) / signals.rate_hz) {
            return None;
        }
        false
    } else if 1.0 - share < OFF_AXIS_LATE {
        let (by_torque_s, sigma) = late_by_torque(signals, params)?;
        if !is_same(by_torque_s) || by_torque_s.abs() < SIGMAS * sigma {
            return None;
        }
        true
    } else {
        return None;
    };
    Some(MotorTime {
        late_s,
        late,
        in_rotor_frame,
    })
}

/// Share of the current off the torque axis that is none of noise and rounding.
const OFF_AXIS_SEEN: f64 = 2e-3;

/// Time for which the residuals of both equations are alike, s: half a swing of the slowest gear.
const ALIKE_S: f64 = 3e-3;

/// Lateness of the motor angle by the output angle, s, with its standard deviation.
fn late_by_output(signals: &Signals, params: &ActuatorParams) -> Option<(f64, f64)> {
    let (gear_ratio, count) = (params.transmission.gear_ratio, params.sensors.output_lsb());
    let first = signals.rows.first()?;
    let (mut of_motor, mut of_output) = (Flank::default(), Flank::default());
    let rows = signals.rows.iter().filter_map(|row| {
        let motor = (row.theta_m - first.theta_m) / gear_ratio;
        let output = row.theta_out - first.theta_out;
        let flanks = [&mut of_motor, &mut of_output]
            .into_iter()
            .zip([motor, output])
            .map(|(flank, angle)| flank.follow(angle, REVERSAL_COUNTS * count))
            .sum::<f64>();
        let pushes = of_motor.pushes(motor, count) && of_output.pushes(output, count);
        let [_, i_q] = signals.i_dq(row);
        (pushes && flanks != 0.0).then_some(([1.0, 0.25 * flanks, row.omega_m / gear_ratio, -i_q], output - motor))
    });
    let free = (0.0, f64::INFINITY);
    let play = (0.0, signals.span(|row| row.theta_out).max(count));
    let alike = (ALIKE_S * signals.rate_hz).max(1.0);
    let found = fit(rows, [free, play, free, (0.0, bending(params))], alike)?;
    Some((found.value[2], found.sigma[2]))
}

/// Speed below which dry friction has no sign, rad/s.
const SPEED_MIN: f64 = 3.0;

/// Lateness of the motor angle by the torque of the currents in the frame that they were logged in, s, with its standard deviation.
fn late_by_torque(signals: &Signals, params: &ActuatorParams) -> Option<(f64, f64)> {
    let half = ((ALIKE_S * signals.rate_hz).round() as usize).max(2);
    let motor = &params.motor;
    let torque = |row: &Row| motor.torque_gain() * signals.i_dq(row)[1];
    let torques: Vec<f64> = signals.rows.iter().map(torque).collect();
    let first = signals.rows.first()?;
    let step = half as f64 / signals.rate_hz;
    let rows = (half + 1..signals.rows.len().saturating_sub(half + 1)).filter_map(|n| {
        let around = &signals.rows[n - half..=n + half];
        let speed = signals.rows[n].omega_m;
        let moves = |row: &Row| row.omega_m * speed > 0.0 && row.omega_m.abs() > SPEED_MIN;
        if !around.iter().all(moves) {
            return None;
        }
        let second = around[2 * half].theta_m - 2.0 * around[half].theta_m + around[0].theta_m;
        let (mut smooth, mut slope) = (0.0, 0.0);
        for place in 0..=2 * half {
            let weight = (half as f64 - (place as f64 - half as f64).abs()) / (half * half) as f64;
            let at = n - half + place;
            smooth += weight * torques[at];
            slope += weight * 0.5 * (torques[at + 1] - torques[at - 1]) * signals.rate_hz;
        }
        let travel = signals.rows[n].theta_out - first.theta_out;
        let columns = [smooth, -slope, -speed.signum(), -speed, -1.0, -travel];
        Some((columns, motor.j * second / (step * step)))
    });
    let free = (0.0, f64::INFINITY);
    let friction = params.transmission.friction_dynamic;
    // In a motion of one frequency damping and age look alike.
    let prior = [
        free,
        free,
        (2.0 * friction, 2.0 * friction),
        (motor.c, motor.c.max(1e-9)),
        free,
        free,
    ];
    let found = fit(rows, prior, 2.0 * half as f64)?;
    let (gain, late) = (found.value[0], found.value[1]);
    (gain > SIGMAS * found.sigma[0]).then_some((late / gain, found.sigma[1] / gain))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor_checks::signals::Signals;
    use ema_models::{Real, SensedSample, Setpoint, follow_through_play};

    /// What is wrong in the samples of a motion to and fro.
    #[derive(Clone, Copy, Default)]
    struct Wrong {
        motor_late: usize,
        output_late: usize,
        currents_late: usize,
        in_rotor_frame: bool,
        play_rad: f64,
    }

    fn found(wrong: Wrong) -> Option<MotorTime> {
        let mut params = ActuatorParams::bench();
        params.sensors.sample_rate = 2000.0;
        let motor = params.motor;
        let mut output = 0.0;
        // Angle, torque-producing current and output angle of each instant: 70 rad/s at 3 Hz and 40 at 8 Hz, against 0.3 Nm of friction.
        let instants: Vec<[f64; 3]> = (0..1000)
            .map(|n| {
                let (mut angle, mut speed, mut acceleration) = (0.0, 0.0, 0.0);
                for (fastest, hz) in [(70.0, 3.0), (40.0, 8.0)] {
                    let per_s = core::f64::consts::TAU * hz;
                    let (sin, cos) = (per_s * f64::from(n) / 2000.0).sin_cos();
                    angle += fastest / per_s * (1.0 - cos);
                    speed += fastest * sin;
                    acceleration += fastest * per_s * cos;
                }
                let torque = motor.j * acceleration + 0.3 * f64::signum(speed);
                output = follow_through_play(output, angle / params.transmission.gear_ratio, 0.5 * wrong.play_rad);
                [angle, torque / motor.torque_gain(), output]
            })
            .collect();
        let samples: Vec<SensedSample> = (0..instants.len())
            .map(|n| {
                let at = |late: usize| instants[n.saturating_sub(late)];
                let read = at(wrong.motor_late)[0];
                let [turned, i_q, _] = at(wrong.currents_late);
                let theta_e = motor.pole_pairs * if wrong.in_rotor_frame { read } else { turned };
                let third = core::f64::consts::TAU / 3.0;
                SensedSample {
                    seq: n as u64,
                    currents: [0.0, 1.0, 2.0].map(|phase| -i_q * (theta_e - phase * third).sin_cos_poly().0),
                    motor_counts: (read / params.sensors.motor_lsb()).floor() as i64,
                    output_counts: (at(wrong.output_late)[2] / params.sensors.output_lsb()).round() as i64,
                    setpoint: Setpoint::Position(0.0),
                }
            })
            .collect();
        motor_time(&Signals::new(&params, &samples, &[]), &params)
    }

    #[test]
    fn a_late_motor_angle_is_found_with_its_samples_in_either_frame() {
        for in_rotor_frame in [false, true] {
            for motor_late in [1, 2, 3, 6] {
                for play_rad in [1e-4, 3e-3] {
                    let wrong = Wrong {
                        motor_late,
                        in_rotor_frame,
                        play_rad,
                        ..Wrong::default()
                    };
                    let found = found(wrong);
                    let is_found = found.is_some_and(|found| {
                        found.late == motor_late as isize && found.in_rotor_frame == in_rotor_frame
                    });
                    assert!(is_found, "{motor_late} {in_rotor_frame} {play_rad}: {found:?}");
                }
            }
        }
    }

    #[test]
    fn a_play_late_currents_and_a_late_output_are_no_late_motor_angle() {
        for wrong in [
            Wrong::default(),
            Wrong {
                play_rad: 1e-2,
                ..Wrong::default()
            },
            Wrong {
                currents_late: 3,
                ..Wrong::default()
            },
            Wrong {
                output_late: 3,
                ..Wrong::default()
            },
            Wrong {
                output_late: 3,
                in_rotor_frame: true,
                ..Wrong::default()
            },
        ] {
            assert_eq!(found(wrong), None);
        }
    }
}
