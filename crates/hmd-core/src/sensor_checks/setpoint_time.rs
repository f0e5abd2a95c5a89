//! Set point before or after its effect: by the law of the speed loop (`ema_identify::relations::setpoint_delay`).
//!
//! In steady motion a set point that is logged at another time looks like another controller gain. Its delay is found to first order,
//! then again with the set point moved by it, until less than a sample is left.

use ema_identify::relations::{CommissionedRelations, SetpointDelay, SinceCommissioning, setpoint_delay};
use ema_identify::unit_calibration::Seen;

use super::correction::Correction;
use super::findings::Finding;
use super::suspect::Suspect;
use crate::outbox::WindowJob;
use crate::setpoint_hold::{held_s, time_sigma};

/// Longest time, s, that is looked for.
const LONGEST_S: f64 = 15e-3;

/// Rounds in which the set point is moved.
const ROUNDS: usize = 6;

/// Standard deviations of a delay that no noise makes.
const SIGMAS: f64 = 4.0;

/// Largest standard deviation of a delay that is named, s.
const SIGMA_MAX_S: f64 = 1e-3;

/// Delay beside those of commissioning that other motions have, sample periods, and s: drives of the simulated units (0.6 to 0.8 periods at
/// 400 Hz, 1 at 2 kHz).
const OTHER_MOTION_PERIODS: f64 = 0.5;
const OTHER_MOTION_S: f64 = 0.3e-3;

/// Change of the delay by that of the sample period: a set point holds for one, and at 400 Hz currents and angles are smoothed over several.
/// `bench` at 400 Hz against 2 kHz: 0.89 periods with a hysteresis drive, 0.97 with a vector drive.
const RATE_PERIODS: f64 = 0.75;
const OTHER_RATE_PERIODS: f64 = 0.25;

/// Delay of the drives of healthy units that were not commissioned, sample periods, and what their speed filters and current loops add to
/// either side, s.
const USUAL_PERIODS: f64 = 0.4;
const OTHER_DRIVE_PERIODS: f64 = 0.6;
const OTHER_DRIVE_S: f64 = 1.0e-3;

/// Gain ratios that the law of a type's position loop finds: with others, as of a set point that the drive limits in its rate, it is none.
const GAINS: std::ops::Range<f64> = 0.45..1.6;

/// The set point that is logged clearly before or after its effect: against that of the `commissioned` unit's healthy windows and what they have
/// seen, where it is moved by whole samples, else against the law of the type.
#[must_use]
pub fn setpoint_time(job: &WindowJob, commissioned: Option<(&CommissionedRelations, &Seen)>) -> Option<Finding> {
    let rate_hz = job.params.sensors.sample_rate;
    let torque_scale = commissioned.and_then(|(unit, _)| unit.torque_scale);
    let (expected_s, scatter_s, allowed_s) = match commissioned.map(|(unit, seen)| (&unit.setpoint_delay, seen)) {
        Some((healthy, _)) if healthy.windows == 0 => return None,
        Some((healthy, seen)) => {
            let longer_s = seen.sample_rate_hz.map_or(0.0, |then_hz| 1.0 / rate_hz - 1.0 / then_hz);
            (
                healthy.mean + RATE_PERIODS * longer_s,
                healthy.scatter.hypot(time_sigma(seen.setpoint_held_s)),
                OTHER_MOTION_S + OTHER_MOTION_PERIODS / rate_hz + OTHER_RATE_PERIODS * longer_s.abs(),
            )
        }
        None => (
            USUAL_PERIODS / rate_hz,
            0.0,
            OTHER_DRIVE_S + OTHER_DRIVE_PERIODS / rate_hz,
        ),
    };
    let (moved, found) = delay(job, torque_scale)?;
    let early_s = moved as f64 / rate_hz + found.delay_s.value - expected_s;
    let of_hold = time_sigma(held_s(&job.window.samples, rate_hz));
    let sigma_s = found.delay_s.sigma.hypot(scatter_s).hypot(of_hold);
    let is_shown = sigma_s < SIGMA_MAX_S && (commissioned.is_some() || GAINS.contains(&found.gain));
    if early_s.abs() < allowed_s + SIGMAS * sigma_s || !is_shown {
        return None;
    }
    let side = if early_s > 0.0 { "before" } else { "after" };
    let since = commissioned.map_or("", |_| ", other than at commissioning");
    let evidence = format!(
        "it seems to be logged {:.1} ± {:.1} ms {side} currents and angles{since}",
        1e3 * early_s.abs(),
        1e3 * sigma_s
    );
    let samples = (early_s * rate_hz).round() as isize;
    // The monitor of a unit that was not commissioned needs the set point to the sample.
    let correction = commissioned.map(|_| Correction::SetpointBefore(samples));
    Some(Finding::new(Suspect::SetpointDelay, &evidence, correction))
}

/// Samples by which the set point is moved to a later one, and the delay that is left, less than one sample; `None` where none is shown.
fn delay(job: &WindowJob, torque_scale: Option<f64>) -> Option<(isize, SetpointDelay)> {
    let rate_hz = job.params.sensors.sample_rate;
    let mut moved = 0;
    for _ in 0..ROUNDS {
        let mut other = job.clone();
        Correction::SetpointBefore(moved).apply(&mut other);
        let aligned = other.window.aligned(&job.params, SinceCommissioning::default());
        let found = setpoint_delay(&aligned.measured(), torque_scale)?;
        let left = (found.delay_s.value * rate_hz).round() as isize;
        if left.abs() <= 1 {
            return Some((moved, found));
        }
        moved += left;
        if moved.unsigned_abs() as f64 > LONGEST_S * rate_hz {
            return None;
        }
    }
    None
}
