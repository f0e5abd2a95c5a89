//! How long a set point stands still between two changes of one motion, and what that hides of its time.
//!
//! A set point that is logged every H seconds, and held between, is up to H older than the one that the drive follows, by `H/√12` about the
//! mean. What that leaves of the time from a set point to its effect, and of the gain of the position loop with it, depends on how much of it
//! the kernel of the law averages out. Derived here.

use ema_models::{ActuatorParams, SensedSample, Setpoint};

/// Longest time between two changes that belong to one motion, s: 20 set points a second.
const LONGEST_S: f64 = 50e-3;

/// Time for which the commanded position of a window stands beyond a sample period while it moves, s: mean over its way.
pub(crate) fn held_s(samples: &[SensedSample], rate_hz: f64) -> f64 {
    let longest = LONGEST_S * rate_hz;
    let (mut since, mut way, mut held) = (None, 0.0, 0.0);
    for (n, pair) in samples.windows(2).enumerate() {
        let (Setpoint::Position(from), Setpoint::Position(to)) = (pair[0].setpoint, pair[1].setpoint) else {
            continue;
        };
        let change = (to - from).abs();
        if change <= 0.0 {
            continue;
        }
        let stood = since.replace(n).map_or(f64::INFINITY, |since| (n - since) as f64);
        if stood <= longest {
            way += change;
            held += change * (stood - 1.0);
        }
    }
    if way > 0.0 { held / way / rate_hz } else { 0.0 }
}

/// Hold of which the kernel of the law, 12 ms to either side, averages out nothing, s, and the power with which less of a shorter one is left. A
/// `bench` that was commissioned on set points logged as seldom, at 1 and 2 kHz, reads k8 off by 0.002 at 6 ms, 0.01 at 7 ms, 0.04 at 8 and
/// 9 ms, 0.16 at 10 ms.
const NOT_AVERAGED_S: f64 = 8e-3;
const AVERAGED_POWER: i32 = 4;

/// One standard deviation of the time of a set point that is held for this long, by the law of the speed loop, s.
pub(crate) fn time_sigma(held_s: f64) -> f64 {
    held_s / 12_f64.sqrt() * (held_s / NOT_AVERAGED_S).powi(AVERAGED_POWER)
}

/// Change of k8 by each second by which the set point of a steady motion is off, 1/s: `G_p (θ_cmd − θ_out)` is the speed there, and a set point
/// that is off by δ changes it by `G_p θ_cmd' δ`.
pub(crate) fn gain_per_s(params: &ActuatorParams) -> f64 {
    params.controller.g_p / params.transmission.gear_ratio
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The hold of a ramp whose set point changes with every so many samples, after a rest.
    fn of_ramp(every: u64) -> f64 {
        let samples = (0..1000).map(|seq| SensedSample {
            seq,
            currents: [0.0; 3],
            motor_counts: 0,
            output_counts: 0,
            setpoint: Setpoint::Position(0.01 * (seq / every).saturating_sub(200 / every) as f64),
        });
        held_s(&samples.collect::<Vec<_>>(), 2000.0)
    }

    #[test]
    fn what_a_hold_leaves_of_the_gain_covers_what_it_was_off_by() {
        let bench = ActuatorParams::bench();
        let sigma = |held_s| gain_per_s(&bench) * time_sigma(held_s);
        // Hold beyond a sample, error of k8.
        for (held_s, error) in [(6.5e-3, 0.01), (7.5e-3, 0.037), (8.5e-3, 0.04), (9e-3, 0.16)] {
            assert!(error < 2.0 * sigma(held_s), "{held_s}: {}", sigma(held_s));
        }
        assert!(sigma(2.5e-3) < 5e-4);
    }

    #[test]
    fn a_hold_is_what_lasts_beyond_a_sample_and_a_rest_is_none() {
        assert!(of_ramp(1).abs() < 1e-12);
        assert!((of_ramp(20) - 9.5e-3).abs() < 1e-9, "{}", of_ramp(20));
        // Steps of a tenth of a second are steps.
        assert!(of_ramp(200).abs() < 1e-12);
    }
}
