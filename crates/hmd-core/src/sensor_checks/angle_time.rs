//! One angle older than the other: behind a rigid gear the output leads or lags the motor by a time, which no worn part does.
//!
//! In motion in one direction the output lies at one flank of the play, so that with a motor angle that is τ older than the output angle
//! `θ_out − θ_m/n = c ∓ b/2 + τ ω_m/n`: what goes with the speed within each direction is τ. A wide play leaves that difference spread otherwise
//! (of its variance the speed explains 12 % at most: `bench` with a damage of 0.05 to 0.9), a shift in time leaves the counts alone. Derived
//! here.

use ema_identify::relations::{CommissionedRelations, Relation};
use ema_models::ActuatorParams;

use super::correction::Correction;
use super::findings::Finding;
use super::signals::Signals;
use super::suspect::Suspect;
use crate::outbox::WindowJob;

/// Motor speed from which on the output lies at a flank, rad/s.
const MOVING_RAD_S: f64 = 3.0;

/// Samples in motion from which on a time is found.
const ROWS_MIN: usize = 100;

/// Spread of the difference of both angles, relative to what healthy windows leave, from which on one is looked for.
const SPREAD_MIN: f64 = 2.0;

/// Spread of it that is left beside a time, as a share.
const LEFT_MAX: f64 = 0.5;

/// Shortest time, sample periods.
const PERIODS_MIN: f64 = 0.5;

/// Rounds in which the older angle is moved, and what is left then, sample periods.
const ROUNDS: usize = 4;
const PERIODS_LEFT: f64 = 0.1;

/// The angle that is older than the other one, in a window of a commissioned unit with a rigid gear; moved to later samples it is right.
/// `None` too where the healthy windows leave more than a count, as where one is older by nature.
#[must_use]
pub fn angle_time(job: &WindowJob, commissioned: &CommissionedRelations) -> Option<Finding> {
    let healthy = &commissioned.residual[Relation::Transmission as usize];
    let healthy_rad = healthy.mean_log.exp();
    let is_rigid = commissioned.balance.shape.compliance.is_rigid() && !commissioned.may_bend;
    if !is_rigid || healthy.windows == 0 || healthy_rad > job.params.sensors.output_lsb() {
        return None;
    }
    let lag_of = |job: &WindowJob| {
        let signals = Signals::new(&job.params, &job.window.samples, &job.window.filled);
        lag(&signals, &job.params)
    };
    let first = lag_of(job).filter(|lag| lag.is_shown(healthy_rad))?;
    let mut periods = first.periods;
    for _ in 1..ROUNDS {
        let mut moved = job.clone();
        later(periods).apply(&mut moved);
        let left = lag_of(&moved)?.periods;
        periods += left;
        if left.abs() < PERIODS_LEFT {
            break;
        }
    }
    let (older, newer) = if periods > 0.0 {
        ("motor", "output")
    } else {
        ("output", "motor")
    };
    let ms = 1e3 * periods.abs() / job.params.sensors.sample_rate;
    let evidence = format!("the {older} angle seems to be {ms:.2} ms older than the {newer} angle");
    Some(Finding::new(Suspect::SampleOrder, &evidence, Some(later(periods))))
}

/// The motor angle of so many samples later, or the output angle where it is the older one.
fn later(periods: f64) -> Correction {
    if periods > 0.0 {
        Correction::MotorLater(periods)
    } else {
        Correction::OutputLater(-periods)
    }
}

/// By how much the motor angle is older than the output angle.
#[derive(Clone, Copy, Debug)]
struct Lag {
    /// Sample periods.
    periods: f64,
    /// Spread of the difference of both angles within each direction, rad at the output, and what is left of it beside the time.
    spread_rad: f64,
    left_rad: f64,
}

impl Lag {
    /// Whether a time explains what healthy windows leave so much less of.
    fn is_shown(&self, healthy_rad: f64) -> bool {
        self.spread_rad > SPREAD_MIN * healthy_rad
            && self.left_rad < LEFT_MAX * self.spread_rad
            && self.periods.abs() > PERIODS_MIN
    }
}

fn lag(signals: &Signals, params: &ActuatorParams) -> Option<Lag> {
    let gear_ratio = params.transmission.gear_ratio;
    let (mut rows, mut squares, mut with_speed, mut of_speed) = (0, 0.0, 0.0, 0.0);
    for sign in [-1.0, 1.0] {
        // Output speed, and the output against the motor.
        let moving: Vec<[f64; 2]> = signals
            .rows
            .iter()
            .filter(|row| !row.is_filled && sign * row.omega_m > MOVING_RAD_S)
            .map(|row| [row.omega_m / gear_ratio, row.theta_out - row.theta_m / gear_ratio])
            .collect();
        let number = moving.len().max(1) as f64;
        let mean = [0, 1].map(|n| moving.iter().map(|row| row[n]).sum::<f64>() / number);
        for [speed, ahead] in &moving {
            let (speed, ahead) = (speed - mean[0], ahead - mean[1]);
            squares += ahead * ahead;
            with_speed += ahead * speed;
            of_speed += speed * speed;
        }
        rows += moving.len();
    }
    let time_s = with_speed / of_speed;
    let number = rows as f64;
    (rows >= ROWS_MIN && time_s.is_finite()).then(|| Lag {
        periods: time_s * signals.rate_hz,
        spread_rad: (squares / number).sqrt(),
        left_rad: ((squares - time_s * with_speed).max(0.0) / number).sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use ema_models::{SensedSample, Setpoint, follow_through_play};

    use super::*;

    /// The lag of a motion forth and back, 0.3 rad at up to 1 rad/s, behind this play, rad, with a motor angle so many samples old.
    fn found(play: f64, motor_old: f64, output_old: f64) -> Lag {
        let params = ActuatorParams::bench();
        let sensors = &params.sensors;
        let angle = |n: f64| 0.15 * (1.0 - (n / sensors.sample_rate / 0.15).cos());
        let mut output = -0.5 * play;
        let samples: Vec<SensedSample> = (0..2000)
            .map(|n| {
                let n = f64::from(n);
                output = follow_through_play(output, angle(n - output_old), 0.5 * play);
                let motor = angle(n - motor_old) * params.transmission.gear_ratio;
                SensedSample {
                    seq: n as u64,
                    currents: [0.0; 3],
                    motor_counts: (motor / sensors.motor_lsb()).floor() as i64,
                    output_counts: (output / sensors.output_lsb()).round() as i64,
                    setpoint: Setpoint::Idle,
                }
            })
            .collect();
        lag(&Signals::new(&params, &samples, &[]), &params).expect("motion")
    }

    #[test]
    fn an_older_angle_is_found_and_a_play_is_none() {
        let params = ActuatorParams::bench();
        let healthy_rad = params.sensors.output_lsb() / 12_f64.sqrt();
        let healthy_play = params.transmission.backlash;
        assert!(!found(healthy_play, 0.0, 0.0).is_shown(healthy_rad));
        for (motor_old, output_old) in [(2.0, 0.0), (3.0, 0.0), (6.0, 0.0), (0.0, 4.0), (1.5, 0.0)] {
            let lag = found(healthy_play, motor_old, output_old);
            assert!(lag.is_shown(healthy_rad), "{lag:?}");
            assert!((lag.periods - (motor_old - output_old)).abs() < 0.1, "{lag:?}");
        }
        for widths in [5.0, 30.0, 90.0] {
            let lag = found(widths * healthy_play, 0.0, 0.0);
            assert!(!lag.is_shown(healthy_rad), "{widths}: {lag:?}");
        }
    }
}
