//! Gain of all currents, and voltage of the link, by the law of the drive.
//!
//! Set point and angles are measured, so the law of the position and speed loops ([`ema_models::Ace`]) says which torque the drive asks for:
//! `T = K_p e + K_i ∫e`, `e = clamp(G_p f (θ_cmd − θ_out), ±ω_max) − ω_m`; a worn controller changes the factor f. Load, friction, inertia
//! and winding are not in it. Where it asks for more than `G_T I_max` and has voltage to spare, I_max flows: the read current over it is the
//! gain of the sensors. Where it lacks much current for a while, its voltage is at the limit `V_dc / √3`, and `|R i_q + k ω, ω_e L i_q|`
//! shows the link. Derived here. A fit of the gain below the limit was tried and dropped: the steps of the encoder and the lag of the
//! current bias it by 5 to 12 % (`bench`, chirps).

use ema_models::{ActuatorParams, Setpoint, Tolerances};

use super::signals::{Row, Signals};

/// Factors on the position gain: the least and the largest of the fault vector.
const FACTORS: [f64; 2] = [0.5, 1.5];

/// Current that the drive asks for at each sample, A, before its limit: the smaller one of both factors, 0 where they differ in sign; the
/// first `rest` samples precede the trigger. `None` where the drive is off.
fn asked_at_least(signals: &Signals, params: &ActuatorParams, rest: usize) -> Option<Vec<f64>> {
    let at_rest = signals.rows.get(..rest.max(2))?;
    let i_q = at_rest.iter().map(|row| signals.i_dq(row)[1]).sum::<f64>() / at_rest.len() as f64;
    let torque_gain = params.motor.torque_gain();
    let [slow, fast] = FACTORS.map(|factor| asked(signals, params, factor, torque_gain * i_q));
    let least = |(slow, fast): (f64, f64)| {
        let size = if slow * fast > 0.0 {
            slow.abs().min(fast.abs())
        } else {
            0.0
        };
        size.copysign(slow) / torque_gain
    };
    Some(slow?.into_iter().zip(fast?).map(least).collect())
}

/// Torque that the drive asks for at each sample, Nm, before its limit, with a factor on its position gain; `None` where it is off.
fn asked(signals: &Signals, params: &ActuatorParams, factor: f64, at_rest: f64) -> Option<Vec<f64>> {
    let controller = &params.controller;
    let step = 1.0 / signals.rate_hz;
    let largest = params.motor.torque_gain() * params.motor.i_max;
    let error = |row: &Row| {
        let reference = match row.setpoint {
            Setpoint::Idle => return None,
            Setpoint::Position(angle) => {
                let reference = controller.g_p * factor * (angle - row.theta_out);
                reference.clamp(-controller.omega_max, controller.omega_max)
            }
            Setpoint::Speed(speed) => speed,
        };
        Some(reference - row.omega_m)
    };
    let mut before = error(signals.rows.first()?)?;
    let mut integral = at_rest - controller.k_p * before;
    let torques = signals.rows.iter().map(|row| {
        let error = error(row)?;
        let torque = controller.k_p * error + integral;
        if torque.abs() < largest {
            integral += controller.k_i * step * 0.5 * (error + before);
        }
        before = error;
        Some(torque)
    });
    torques.collect()
}

/// Standard deviations of the tolerances that nothing explains.
const SIGMAS: f64 = 4.0;

/// Current asked for, in multiples of the limit, at which the limit holds whatever the law's numbers are.
const BEYOND_LIMIT: f64 = 1.5;

/// Time in which a current settles at its limit, and time for which it then holds it, s.
const SETTLES_S: f64 = 2e-3;
const HOLDS_S: f64 = 3e-3;

/// Range of a held current, as a share of the limit: the ripple of comparators included.
const HELD: f64 = 0.04;

/// Gain of all currents, with its standard deviation, where the current that flows at the limit is not that of the limit; the first `rest`
/// samples precede the trigger.
pub(super) fn gain_at_limit(
    signals: &Signals,
    params: &ActuatorParams,
    tolerances: &Tolerances,
    rest: usize,
) -> Option<(f64, f64)> {
    let limit = params.motor.i_max;
    let asked = asked_at_least(signals, params, rest)?;
    let samples = |time: f64, least: usize| ((time * signals.rate_hz).round() as usize).max(least);
    let (settles, holds) = (samples(SETTLES_S, 1), samples(HOLDS_S, 2));
    let shares: Vec<Option<f64>> = signals
        .rows
        .iter()
        .zip(&asked)
        .map(|(row, asked)| {
            let is_limited = asked.abs() > BEYOND_LIMIT * limit && signals.is_controlled(row);
            is_limited.then(|| signals.i_dq(row)[1] * asked.signum() / limit)
        })
        .collect();
    let runs = shares
        .split(Option::is_none)
        .filter_map(|run| run.get(settles..))
        .filter(|run| run.len() >= holds);
    let (mut sum, mut count) = (0.0, 0.0);
    for run in runs {
        let (min, max) = run
            .iter()
            .flatten()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(min, max), &share| {
                (f64::min(min, share), f64::max(max, share))
            });
        if max - min > HELD * max.abs() {
            return None;
        }
        sum += run.iter().flatten().sum::<f64>();
        count += run.len() as f64;
    }
    let gain: f64 = sum / count;
    let sigma = gain * tolerances.i_max.hypot(tolerances.current_gain);
    (count > 0.0 && gain > 0.0 && (gain - 1.0).abs() > SIGMAS * sigma).then_some((gain, sigma))
}

/// Part of the largest current that a drive lacks at the limit of its voltage, and time for which it does, s.
const LACKS: f64 = 0.25;
const LACKS_S: f64 = 0.01;

/// Scatter of the voltage, as a share, of one limit.
const ONE_VOLTAGE: f64 = 0.06;

/// Share of the link voltage that a drive uses which modulates by sines alone, of what it may use.
const BY_SINES: f64 = 0.866;

/// Voltage of the link that the motor shows, V, with its standard deviation, where it is clearly below the `read` one.
pub(super) fn link_by_law(
    signals: &Signals,
    params: &ActuatorParams,
    tolerances: &Tolerances,
    rest: usize,
    read: f64,
) -> Option<(f64, f64)> {
    let motor = &params.motor;
    let asked = asked_at_least(signals, params, rest)?;
    let voltage = |(row, asked): (&Row, &f64)| {
        let i_q = signals.i_dq(row)[1];
        let direction = row.omega_m.signum();
        let lacks = (direction * asked).min(motor.i_max) - direction * i_q > LACKS * motor.i_max;
        let across = motor.pole_pairs * row.omega_m * motor.l_s * i_q;
        lacks.then(|| 3_f64.sqrt() * (motor.r_s * i_q + motor.k * row.omega_m).hypot(across))
    };
    let needed = ((LACKS_S * signals.rate_hz).round() as usize).max(4);
    let all: Vec<Option<f64>> = signals.rows.iter().zip(&asked).map(voltage).collect();
    let longest = all.split(Option::is_none).max_by_key(|run| run.len())?;
    if longest.len() < needed {
        return None;
    }
    let count = longest.len() as f64;
    let mean = longest.iter().flatten().sum::<f64>() / count;
    let scatter = (longest.iter().flatten().map(|u| (u - mean) * (u - mean)).sum::<f64>() / count).sqrt();
    let sigma = scatter.hypot(mean * tolerances.k.hypot(tolerances.v_dc));
    let is_low = scatter < ONE_VOLTAGE * mean && mean < BY_SINES * read && read - mean > SIGMAS * sigma;
    is_low.then_some((mean, sigma))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ema_models::SensedSample;

    const REST: usize = 40;

    /// A `bench` motor that accelerates by 5000 rad/s² towards a far set point, up to `fastest`, rad/s; it reads `gain` times I_max while it
    /// accelerates, then 1 A.
    fn motion(gain: f64, fastest: f64) -> (ActuatorParams, Signals) {
        let mut params = ActuatorParams::bench();
        params.sensors.sample_rate = 2000.0;
        let (mut angle, mut speed) = (0.0, 0.0);
        let third = core::f64::consts::TAU / 3.0;
        let samples: Vec<SensedSample> = (0..400)
            .map(|seq| {
                let is_moving = seq >= REST;
                if is_moving {
                    speed = f64::min(speed + 2.5, fastest);
                }
                angle += speed / 2000.0;
                let i_q = match is_moving {
                    false => 0.0,
                    true if speed < fastest => gain * params.motor.i_max,
                    true => 1.0,
                };
                let theta_e = params.motor.pole_pairs * angle;
                SensedSample {
                    seq: seq as u64,
                    currents: [0.0, 1.0, 2.0].map(|phase| -i_q * (theta_e - phase * third).sin()),
                    motor_counts: (angle / params.sensors.motor_lsb()) as i64,
                    output_counts: 0,
                    setpoint: Setpoint::Position(if is_moving { 1.0 } else { 0.0 }),
                }
            })
            .collect();
        let signals = Signals::new(&params, &samples, &[]);
        (params, signals)
    }

    #[test]
    fn a_current_at_the_limit_that_reads_otherwise_is_a_gain() {
        let gain = |gain: f64| {
            let (params, signals) = motion(gain, 150.0);
            gain_at_limit(&signals, &params, &Tolerances::USUAL, REST)
        };
        for wrong in [0.85, 1.2] {
            let (found, sigma) = gain(wrong).unwrap();
            assert!((found - wrong).abs() < 0.005 && sigma < 0.03, "{found} ± {sigma}");
        }
        assert_eq!(gain(1.0), None);
        assert_eq!(gain(0.95), None, "within the tolerances of limit and gain");
    }

    #[test]
    fn a_speed_that_lacks_voltage_shows_the_link() {
        let link = |fastest: f64, read: f64| {
            let (params, signals) = motion(1.0, fastest);
            link_by_law(&signals, &params, &Tolerances::USUAL, REST, read)
        };
        // The speed that 290 V allow with 1 A.
        let (found, sigma) = link(183.0, 380.0).unwrap();
        assert!((found - 290.0).abs() < 3.0 && sigma < 15.0, "{found} ± {sigma}");
        assert_eq!(
            link(183.0, 320.0),
            None,
            "within its tolerance, and that of the modulation"
        );
        // At the speed that was commanded, no more current is asked for.
        assert_eq!(link(200.0, 380.0), None);
    }
}
