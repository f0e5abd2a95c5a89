//! Gain of all currents, by the limit of the drive: no current lasts beyond I_max.

use ema_models::Tolerances;

use super::signals::{Row, Signals};

/// Time that a current lasts which the drive commands, s.
const LASTS_S: f64 = 0.01;

/// Deviation from the limit, in standard deviations of limit and gain, that no tolerance explains.
const SIGMAS: f64 = 4.0;

/// Largest current that lasts over I_max, where it is beyond the tolerances of both.
pub(super) fn gain_beyond_limit(signals: &Signals, tolerances: &Tolerances) -> Option<f64> {
    let explained = 1.0 + SIGMAS * tolerances.i_max.hypot(tolerances.current_gain);
    let gain = lasting(signals);
    (gain > explained).then_some(gain)
}

/// Largest current that lasts over I_max.
fn lasting(signals: &Signals) -> f64 {
    let samples = ((LASTS_S * signals.rate_hz).round() as usize).max(3);
    let amplitude = |row: &Row| {
        let [d, q] = signals.i_dq(row);
        d.hypot(q)
    };
    let least = |rows: &[Row]| rows.iter().map(amplitude).fold(f64::INFINITY, f64::min);
    signals.rows.windows(samples).map(least).fold(0.0, f64::max) / signals.i_max()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ema_models::{ActuatorParams, SensedSample, Setpoint};

    /// The gain that a current of this amplitude, held for 20 ms, shows.
    fn shown(amplitude: f64) -> Option<f64> {
        let params = ActuatorParams::bench();
        let sample = |seq: u64| {
            let held = if (100..140).contains(&seq) { amplitude } else { 1.0 };
            SensedSample {
                seq,
                currents: [held, -0.5 * held, -0.5 * held],
                motor_counts: 0,
                output_counts: 0,
                setpoint: Setpoint::Position(0.0),
            }
        };
        let samples: Vec<SensedSample> = (0..400).map(sample).collect();
        gain_beyond_limit(&Signals::new(&params, &samples, &[]), &Tolerances::USUAL)
    }

    #[test]
    fn a_current_beyond_the_limit_is_a_gain_and_one_within_its_tolerance_is_none() {
        let limit = ActuatorParams::bench().motor.i_max;
        assert!((shown(1.2 * limit).unwrap() - 1.2).abs() < 1e-9);
        assert_eq!(shown(1.07 * limit), None);
    }
}
