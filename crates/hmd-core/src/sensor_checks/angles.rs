//! The two angles and the set point against each other.

use ema_models::ActuatorParams;

use super::least_squares::fit;
use super::other_unit::{UNIT_MIN, reference_over_setpoint};
use super::signals::{Row, Signals, commanded_angle, range};

/// What the output turns for each turn of the motor, times the gear ratio: 1 where all numbers are right.
///
/// `None` where the motion is too small against the play.
pub(super) fn output_over_motor(signals: &Signals, params: &ActuatorParams) -> Option<f64> {
    let gear_ratio = params.transmission.gear_ratio;
    let travel = signals.span(|row| row.theta_m) / gear_ratio;
    let resolution = params.sensors.output_lsb() + WORN_PLAYS * params.transmission.backlash;
    if travel.max(signals.span(|row| row.theta_out)) < TRAVEL_MIN * resolution {
        return None;
    }
    if stands_alone(signals, gear_ratio, resolution) {
        return None;
    }
    let first = signals.rows.first()?;
    let rows = signals.rows.iter().map(|row| {
        let motor = (row.theta_m - first.theta_m) / gear_ratio;
        ([1.0, motor], row.theta_out - first.theta_out)
    });
    let free = (0.0, f64::INFINITY);
    let found = fit(rows, [free; 2], 1.0)?;
    // Another gear ratio is a line; an angle that stands still for a while is none.
    let scatter = resolution + SCATTER * signals.span(|row| row.theta_out);
    (found.mean_square < scatter * scatter).then_some(found.value[1])
}

/// Whether one angle stands, to the count, for [`STANDS_S`] and longer while the other turns by more than `least`, rad at the output: by
/// a play or because it is frozen, but not by a wrong ratio.
fn stands_alone(signals: &Signals, gear_ratio: f64, least: f64) -> bool {
    let needed = ((STANDS_S * signals.rate_hz).round() as usize).max(2);
    let alone = |stands: fn(&Row) -> f64, turns: fn(&Row) -> f64, per_output: f64| {
        let (mut begin, mut found) = (0, false);
        for (n, row) in signals.rows.iter().enumerate() {
            let first = &signals.rows[begin];
            if stands(row).to_bits() != stands(first).to_bits() {
                begin = n;
            } else if n - begin >= needed {
                found |= (turns(row) - turns(first)).abs() > per_output * least;
            }
        }
        found
    };
    alone(|row| row.theta_m, |row| row.theta_out, 1.0) || alone(|row| row.theta_out, |row| row.theta_m, gear_ratio)
}

/// A motor that stands from one sample to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SuddenStop {
    /// Speed before it, rad/s.
    pub(super) speed: f64,
    /// Torque that it takes, in multiples of the largest torque of the motor.
    pub(super) torque_share: f64,
}

/// The first stop of the resolver's counts, for [`STANDS_S`] and longer, that takes [`STOP_MIN`] times what motor and friction have: a
/// rotor behind a hard stop swings.
pub(super) fn sudden_stop(signals: &Signals, params: &ActuatorParams) -> Option<SuddenStop> {
    let motor = &params.motor;
    let largest = motor.torque_gain() * motor.i_max + params.transmission.friction_static;
    let stands = ((STANDS_S * signals.rate_hz).round() as usize).max(3);
    let angles: Vec<f64> = signals.rows.iter().map(|row| row.theta_m).collect();
    angles.windows(stands + 2).find_map(|near| {
        let [before, last, standing @ ..] = near else {
            return None;
        };
        let speed = (last - before) * signals.rate_hz;
        let torque_share = motor.j * speed.abs() * signals.rate_hz / largest;
        let is_standing = standing.iter().all(|angle| angle.to_bits() == last.to_bits());
        (is_standing && torque_share > STOP_MIN).then_some(SuddenStop { speed, torque_share })
    })
}

/// An output angle that stands while the motor turns beyond the play.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FrozenOutput {
    /// Range of the difference of the angles, rad at the output.
    pub(super) turned: f64,
    /// The same before the angle stood.
    pub(super) play: f64,
}

/// Factor on a play, and counts of the encoder, that no elasticity adds to it.
const PLAY_FACTOR: f64 = 2.0;
const PLAY_COUNTS: f64 = 8.0;

/// The output angle that stands to the end of a window while the difference of the angles leaves the range that it had before. That range is
/// the play where the output had moved both ways; a one-way motion may not have shown it.
pub(super) fn frozen_output(signals: &Signals, params: &ActuatorParams) -> Option<FrozenOutput> {
    let rows = &signals.rows;
    let last = rows.last()?;
    let from = rows
        .iter()
        .rposition(|row| row.theta_out.to_bits() != last.theta_out.to_bits())?
        + 1;
    let stands_s = (rows.len() - from) as f64 / signals.rate_hz;
    let counts = PLAY_COUNTS * params.sensors.output_lsb();
    if stands_s < STANDS_S || !moved_both_ways(&rows[..from], counts) {
        return None;
    }
    let range = |rows: &[Row]| {
        let difference = |row: &Row| row.theta_out - row.theta_m / params.transmission.gear_ratio;
        let (min, max) = rows
            .iter()
            .map(difference)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(min, max), x| {
                (min.min(x), max.max(x))
            });
        max - min
    };
    let (turned, play) = (range(rows), range(&rows[..from]));
    (turned > PLAY_FACTOR * play + counts).then_some(FrozenOutput { turned, play })
}

/// Whether the output moved by more than `least` in one direction and then in the other.
fn moved_both_ways(rows: &[Row], least: f64) -> bool {
    let (mut min, mut max) = (f64::INFINITY, f64::NEG_INFINITY);
    let (mut rose, mut fell) = (false, false);
    for row in rows {
        (min, max) = (min.min(row.theta_out), max.max(row.theta_out));
        rose |= row.theta_out - min > least;
        fell |= max - row.theta_out > least;
    }
    rose && fell
}

/// Torque of a stop that no motor has, in multiples of the largest one.
const STOP_MIN: f64 = 4.0;

/// Time for which an angle stands, s.
const STANDS_S: f64 = 0.02;

/// Scatter about a line, share of the output's travel.
const SCATTER: f64 = 0.03;

/// Travel in multiples of play and resolution from which on the ratio is known to a few per cent.
const TRAVEL_MIN: f64 = 4.0;

/// Play of a worn transmission, in multiples of that of a new one.
const WORN_PLAYS: f64 = 40.0;

/// Travel of the output over that of the set point in position mode; `None` where the set point stands.
pub(super) fn output_over_setpoint(signals: &Signals) -> Option<f64> {
    let commanded = signals.span(|row| commanded_angle(row.setpoint).unwrap_or(f64::NAN));
    let ratio = signals.span(|row| row.theta_out) / commanded;
    (commanded > HELD_RAD && ratio.is_finite() && ratio > 0.0).then_some(ratio)
}

/// What the output has turned for what was commanded, from a rest at the set point to a rest; `None` where either is none.
pub(super) fn followed_to_rest(signals: &Signals) -> Option<f64> {
    let rows = &signals.rows;
    let stands = ((STANDS_S * signals.rate_hz).round() as usize).max(2);
    let (begin, end) = (rows.get(..stands)?, rows.get(rows.len().checked_sub(stands)?..)?);
    let is_rest = |near: &[Row]| {
        let (least, most) = range(near.iter().map(|row| row.theta_out));
        let (low, high) = range(near.iter().map(|row| commanded_angle(row.setpoint).unwrap_or(f64::NAN)));
        most - least < HELD_RAD && high - low < HELD_RAD
    };
    let (first, last) = (rows.first()?, rows.last()?);
    let commanded = commanded_angle(last.setpoint)? - commanded_angle(first.setpoint)?;
    let is_held = is_rest(begin) && is_rest(end) && commanded.abs() > HELD_RAD;
    is_held.then(|| (last.theta_out - first.theta_out) / commanded)
}

/// What the set point shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SetpointError {
    /// The set point is so many times the angle that the output follows.
    Unit(f64),
    /// The output follows the set point in the other direction.
    Reversed,
    /// The output follows so many times the set point, by another scale of the encoder.
    Scale(f64),
    /// The output turns before the set point moves, away from it: speed of the motor, rad/s.
    Late(f64),
    /// At rest the output is this far from the set point, rad, and the drive makes no torque.
    Zero(f64),
    /// The same, but the motion does not end in a rest that tells a zero from another scale of the set point.
    ZeroOrScale(f64),
    /// From rest to rest the set point moves so many times as far as the output, which the drive does not see.
    SetpointScale(f64),
}

/// Share of ω_max that a drive exceeds as long as its set point is far away.
const CHASING: f64 = 0.5;

/// Torque that the position error asks for, in multiples of what the rest of the drive can hide.
const ASKED: f64 = 4.0;

/// Range of a set point that has not moved yet, rad: the default threshold of the trigger and what it may miss.
const HELD_RAD: f64 = 1.5e-3;

/// Speed before the set point moves, share of ω_max, that is no rest.
const MOVING: f64 = 0.05;

/// Checks the set point of a window in position mode; its first `rest` samples precede the trigger.
pub(super) fn setpoint_error(signals: &Signals, params: &ActuatorParams, rest: usize) -> Option<SetpointError> {
    let scale = followed(signals, params, rest);
    if let Some(SetpointError::Unit(_) | SetpointError::Reversed) = scale {
        return scale;
    }
    if let Some(times) = reference_over_setpoint(signals, params) {
        return Some(SetpointError::Unit(1.0 / times));
    }
    let error = |n: usize| Some(commanded_angle(signals.rows.get(n)?.setpoint)? - signals.rows[n].theta_out);
    let (first, at_rest) = (error(0)?, signals.rows.get(..rest.max(2))?);
    let controller = &params.controller;
    let (begin, end) = (at_rest.first()?, at_rest.last()?);
    let turned = end.theta_m - begin.theta_m;
    let speed = turned * signals.rate_hz / (at_rest.len() - 1) as f64;
    let held = commanded_angle(begin.setpoint)? - commanded_angle(end.setpoint)?;
    let output_speed = speed / params.transmission.gear_ratio;
    // Nothing that belongs to an earlier command runs away from the set point.
    let is_at_setpoint = first.abs() < 2e-3;
    if speed.abs() > MOVING * controller.omega_max && held.abs() < HELD_RAD {
        let last = error(rest.max(2) - 1)?;
        if last.abs() > first.abs() && (last * output_speed) < 0.0 && (is_at_setpoint || last.abs() > 2e-3) {
            return Some(SetpointError::Late(speed));
        }
    }
    unseen_deviation(signals, params, at_rest).or(scale)
}

/// A rest of the motor.
#[derive(Clone, Copy, Debug)]
struct Rest {
    /// Set point less output angle at its first sample, rad.
    deviation: f64,
    /// Whether the drive makes no torque against it.
    is_unseen: bool,
}

impl Rest {
    /// Of consecutive samples; `None` where the motor turns.
    fn of(signals: &Signals, params: &ActuatorParams, rows: &[Row]) -> Option<Self> {
        let (begin, end) = (rows.first()?, rows.last()?);
        let turned = end.theta_m - begin.theta_m;
        if turned.abs() >= STANDS_COUNTS * params.sensors.motor_lsb().max(params.sensors.output_lsb()) {
            return None;
        }
        let deviation = commanded_angle(begin.setpoint)? - begin.theta_out;
        let controller = &params.controller;
        let torque_gain = params.motor.torque_gain();
        let largest = torque_gain * params.motor.i_max;
        let speed = (controller.g_p * deviation).clamp(-controller.omega_max, controller.omega_max);
        let asked = (speed * controller.k_p).clamp(-largest, largest).abs();
        let current = rows.iter().map(|row| signals.i_dq(row)[1]).sum::<f64>() / rows.len() as f64;
        let torque = (torque_gain * current).abs();
        Some(Self {
            deviation,
            is_unseen: asked > ASKED * (torque + params.transmission.friction_static),
        })
    }
}

/// A deviation of the output at rest that the drive does not see. A zero is the same at both ends of a motion, that of another scale goes with
/// the set point.
fn unseen_deviation(signals: &Signals, params: &ActuatorParams, at_rest: &[Row]) -> Option<SetpointError> {
    let rows = &signals.rows;
    let stands = ((STANDS_S * signals.rate_hz).round() as usize).max(2);
    let at_end = rows.get(rows.len().checked_sub(stands)?..)?;
    let is_held = |rows: &[Row]| {
        let (least, most) = range(rows.iter().map(|row| commanded_angle(row.setpoint).unwrap_or(f64::NAN)));
        most - least < HELD_RAD
    };
    let begin = Rest::of(signals, params, at_rest)?;
    let Some(end) = Rest::of(signals, params, at_end).filter(|_| is_held(at_end)) else {
        let error = if may_be_scale(at_rest.first()?) {
            SetpointError::ZeroOrScale(begin.deviation)
        } else {
            SetpointError::Zero(begin.deviation)
        };
        return begin.is_unseen.then_some(error);
    };
    if !begin.is_unseen && !end.is_unseen {
        return None;
    }
    let commanded = commanded_angle(rows.last()?.setpoint)? - commanded_angle(rows.first()?.setpoint)?;
    let change = end.deviation - begin.deviation;
    let counts = END_COUNTS * params.sensors.output_lsb();
    if change.abs() < counts + SAME_ZERO * begin.deviation.abs() {
        return begin.is_unseen.then_some(SetpointError::Zero(begin.deviation));
    }
    (commanded.abs() > HELD_RAD && commanded - change != 0.0)
        .then(|| SetpointError::SetpointScale(commanded / (commanded - change)))
}

/// Whether a scale that a set point may have explains its distance from an output at rest.
fn may_be_scale(row: &Row) -> bool {
    let scale = commanded_angle(row.setpoint).map(|commanded| commanded / row.theta_out);
    scale.is_some_and(|scale| SCALE_POSSIBLE.contains(&scale))
}

/// Scales of a set point that are no matter of another unit.
const SCALE_POSSIBLE: std::ops::Range<f64> = 0.5..2.0;

/// Counts by which a motor at rest turns.
const STANDS_COUNTS: f64 = 4.0;

/// Counts of the encoder by which two rests at one set point differ, and the share of an encoder's zero.
const END_COUNTS: f64 = 4.0;
const SAME_ZERO: f64 = 0.1;

/// How the output follows the set point, once a motion has ended that the window begins in: it belongs to an earlier command. How far
/// the output had to go is then unknown, and the direction is all that is checked.
fn followed(signals: &Signals, params: &ActuatorParams, rest: usize) -> Option<SetpointError> {
    let omega = signals.rows.first()?.omega_m;
    let slow = MOVING * params.controller.omega_max;
    let begins_at_rest = omega.abs() <= slow;
    let ended = |row: &Row| begins_at_rest || row.omega_m * omega.signum() <= slow;
    let rows = &signals.rows[signals.rows.iter().position(ended)?..];
    let commanded = rows.iter().map(|row| commanded_angle(row.setpoint));
    let commanded: Vec<f64> = commanded.collect::<Option<_>>()?;
    let (min, max) = range(commanded.iter().copied());
    let (least, most) = range(rows.iter().map(|row| row.theta_out));
    let (setpoint, output) = (max - min, most - least);
    let lsb = params.sensors.output_lsb();
    if setpoint < 10.0 * lsb || output < 10.0 * lsb {
        return None;
    }
    let late = &rows[rows.len() * 2 / 3..];
    let speed = late.iter().map(|row| row.omega_m).sum::<f64>() / late.len().max(1) as f64;
    let chases = speed.abs() > CHASING * params.controller.omega_max;
    if setpoint > UNIT_MIN * output && !chases && begins_at_rest {
        return Some(SetpointError::Unit(setpoint / output));
    }
    let (first_setpoint, first_output) = (commanded[0], rows[0].theta_out);
    let followed = rows
        .iter()
        .zip(&commanded)
        .map(|(row, command)| ([1.0, command - first_setpoint], row.theta_out - first_output));
    let free = (0.0, f64::INFINITY);
    let slope = fit(followed, [free; 2], 1.0)?.value[1];
    if slope < -REVERSED {
        return Some(SetpointError::Reversed);
    }
    // At the end both stand.
    let stands = late.iter().all(|row| row.omega_m.abs() < slow);
    let held = commanded[rows.len() * 2 / 3..]
        .iter()
        .all(|&x| (x - max).abs().min((x - min).abs()) < HELD_RAD);
    let (last, row) = (commanded.last()?, rows.last()?);
    let missed = last - first_setpoint - (row.theta_out - first_output);
    // Only where the motor stood at first is all of the motion that of the set point.
    let begin = signals.rows.get(..rest.max(2))?;
    (Rest::of(signals, params, begin).is_some() && stands && held && missed.abs() > SCALE_ERROR * setpoint)
        .then_some(SetpointError::Scale(output / setpoint))
}

/// Slope of output over set point that is no lag of a chirp.
const REVERSED: f64 = 0.2;

/// Share of the set point's range by which an output at rest may miss it.
const SCALE_ERROR: f64 = 0.1;

#[cfg(test)]
mod tests {
    use super::*;
    use ema_models::{SensedSample, Setpoint};

    /// The stop of a motor that turns at 100 rad/s, brakes at this rate, rad/s², from 0.1 s on, and stands.
    fn stop(deceleration: f64) -> Option<SuddenStop> {
        let params = ActuatorParams::bench();
        let rate_hz = params.sensors.sample_rate;
        let (mut angle, mut speed) = (0.0, 100.0);
        let samples: Vec<SensedSample> = (0..1000)
            .map(|seq| {
                if seq as f64 > 0.1 * rate_hz {
                    speed = f64::max(speed - deceleration / rate_hz, 0.0);
                }
                angle += speed / rate_hz;
                SensedSample {
                    seq,
                    currents: [0.0; 3],
                    motor_counts: (angle / params.sensors.motor_lsb()) as i64,
                    output_counts: 0,
                    setpoint: Setpoint::Position(0.0),
                }
            })
            .collect();
        sudden_stop(&Signals::new(&params, &samples, &[]), &params)
    }

    /// An output that follows the motor through this play, rad, as both oscillate by 20 mrad with 5 Hz, and stands from `freezes_s` on.
    fn oscillation(play: f64, freezes_s: f64) -> Option<FrozenOutput> {
        let mut params = ActuatorParams::bench();
        params.sensors.sample_rate = 2000.0;
        let (mut output, gear_ratio) = (0.0, params.transmission.gear_ratio);
        let samples = (0..1000_u64).map(|seq| {
            let t = seq as f64 / 2000.0;
            let motor = 0.02 * (10.0 * std::f64::consts::PI * t).sin();
            if t < freezes_s {
                output = f64::clamp(output, motor - 0.5 * play, motor + 0.5 * play);
            }
            SensedSample {
                seq,
                currents: [0.0; 3],
                motor_counts: (motor * gear_ratio / params.sensors.motor_lsb()) as i64,
                output_counts: (output / params.sensors.output_lsb()) as i64,
                setpoint: Setpoint::Position(0.0),
            }
        });
        let samples: Vec<SensedSample> = samples.collect();
        frozen_output(&Signals::new(&params, &samples, &[]), &params)
    }

    #[test]
    fn an_output_that_stands_beyond_its_play_is_frozen_and_one_within_a_wide_play_is_not() {
        for play in [1e-3, 5e-3, 15e-3] {
            assert_eq!(oscillation(play, 1.0), None, "play {play}");
        }
        let frozen = oscillation(1e-3, 0.27).unwrap();
        assert!(frozen.turned > 0.015 && frozen.play < 2e-3, "{frozen:?}");
        // Before the output has reversed nothing tells how wide the play is.
        assert_eq!(oscillation(1e-3, 0.04), None);
    }

    #[test]
    fn counts_that_freeze_in_motion_stop_more_suddenly_than_any_motor() {
        let motor = ActuatorParams::bench().motor;
        assert_eq!(stop(2.0 * motor.torque_gain() * motor.i_max / motor.j), None);
        let frozen = stop(1e9).unwrap();
        assert!(
            (frozen.speed - 100.0).abs() < 1.0 && frozen.torque_share > 10.0,
            "{frozen:?}"
        );
    }

    /// A motion of the output from rest to rest, without current, under a set point of this scale and an encoder of this zero, rad; where
    /// `rests` is false it moves on to the end.
    fn setpoint(scale: f64, zero: f64, rests: bool) -> Option<SetpointError> {
        let mut params = ActuatorParams::bench();
        params.sensors.sample_rate = 2000.0;
        let samples = (0..1000_u64).map(|seq| {
            let end = if rests { 600.0 } else { 1100.0 };
            let angle = 0.2 + 0.3 * ((seq as f64 - 100.0) / (end - 100.0)).clamp(0.0, 1.0);
            SensedSample {
                seq,
                currents: [0.0; 3],
                motor_counts: (angle * params.transmission.gear_ratio / params.sensors.motor_lsb()) as i64,
                output_counts: ((angle + zero) / params.sensors.output_lsb()).round() as i64,
                setpoint: Setpoint::Position(scale * angle),
            }
        });
        let samples: Vec<SensedSample> = samples.collect();
        setpoint_error(&Signals::new(&params, &samples, &[]), &params, 40)
    }

    #[test]
    fn a_zero_stays_where_the_set_point_goes_and_another_scale_goes_with_it() {
        assert_eq!(setpoint(1.0, 0.0, true), None);
        for scale in [1.1, 0.95] {
            let found = setpoint(scale, 0.0, true);
            let is_right = matches!(found, Some(SetpointError::SetpointScale(found)) if (found - scale).abs() < 0.005);
            assert!(is_right, "{scale}: {found:?}");
            let open = setpoint(scale, 0.0, false);
            assert!(matches!(open, Some(SetpointError::ZeroOrScale(_))), "{scale}: {open:?}");
        }
        let found = setpoint(1.0, 0.02, true);
        assert!(
            matches!(found, Some(SetpointError::Zero(zero)) if (zero + 0.02).abs() < 1e-3),
            "{found:?}"
        );
    }

    #[test]
    fn an_output_that_creeps_on_when_a_window_begins_shows_no_scale() {
        let mut params = ActuatorParams::bench();
        params.sensors.sample_rate = 2000.0;
        // It is 50 mrad behind a set point that stood for 20 ms, and creeps, when the next one comes.
        let samples = (0..1000_u64).map(|seq| {
            let t = seq as f64 / 2000.0;
            let angle = match t - 0.02 {
                moved if moved > 0.0 => 0.2 - 0.149 * (-25.0 * moved).exp(),
                _ => 0.05 + 0.05 * t,
            };
            SensedSample {
                seq,
                currents: [0.0; 3],
                motor_counts: (angle * params.transmission.gear_ratio / params.sensors.motor_lsb()) as i64,
                output_counts: (angle / params.sensors.output_lsb()) as i64,
                setpoint: Setpoint::Position(if seq < 40 { 0.1 } else { 0.2 }),
            }
        });
        let samples: Vec<SensedSample> = samples.collect();
        let found = setpoint_error(&Signals::new(&params, &samples, &[]), &params, 40);
        assert!(!matches!(found, Some(SetpointError::Scale(_))), "{found:?}");
    }
}
