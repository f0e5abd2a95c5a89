//! The zero of one unit's output angle against that of its motor: a fact of how both sensors were mounted, which a commissioned unit
//! keeps but for whole turns of the motor.

use std::vec::Vec;

use ema_models::{ActuatorParams, SensedSample};

use crate::counter_alignment::{Between, WORN_OUT, align_counter_wraps, turn_rad, whole_turns};

/// Share of a motor's turn within which a window of a worn unit lies of its zero: a turn cannot be taken for play, nor play for a turn.
const TURN_SHARE: f64 = 0.25;

/// Counts of the output within which the healthy windows of a unit agree on its zero.
const AGREED_COUNTS: f64 = 2.0;

/// Counts of the output that are taken for no zero at all.
const NONE_COUNTS: f64 = 0.25;

/// Zero of the output by healthy windows of one unit, rad, within half a turn of the motor behind the gear; derived here. The windows that
/// met both flanks of the play have it in the middle; the median of them is taken.
///
/// `None` where no window met both, they contradict each other, or a turn of the motor is so small behind the gear that a worn play could
/// be taken for one.
#[must_use]
pub fn output_zero<'a>(params: &ActuatorParams, windows: impl Iterator<Item = &'a [SensedSample]>) -> Option<f64> {
    let count = params.sensors.output_lsb();
    let worn_play = WORN_OUT.backlash_factor() * params.transmission.backlash;
    if 0.5 * worn_play + AGREED_COUNTS * count > TURN_SHARE * turn_rad(params) {
        return None;
    }
    let mut zeros: Vec<f64> = windows
        .filter_map(|window| {
            let mut samples = window.to_vec();
            align_counter_wraps(params, &mut samples);
            let between = Between::of(params, &samples);
            (between.met_both && between.middle.is_finite()).then_some(between.middle)
        })
        .collect();
    let first = *zeros.first()?;
    for zero in &mut zeros {
        *zero -= whole_turns(params, *zero - first);
    }
    zeros.sort_by(f64::total_cmp);
    let median = zeros[zeros.len() / 2];
    if zeros[zeros.len() - 1] - zeros[0] > 2.0 * AGREED_COUNTS * count {
        return None;
    }
    let zero = median - whole_turns(params, median);
    Some(if zero.abs() < NONE_COUNTS * count { 0.0 } else { zero })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::counter_alignment::align_counters;
    use ema_models::Setpoint;

    /// Angles of a motion over `span` rad behind a play, of an encoder whose zero is at `zero`.
    fn window(zero: f64, span: f64, play: f64, back: bool) -> Vec<SensedSample> {
        let params = ActuatorParams::bench();
        let (motor_lsb, output_lsb) = (
            params.sensors.motor_lsb() / params.transmission.gear_ratio,
            params.sensors.output_lsb(),
        );
        let steps = if back { 2000 } else { 1000 };
        let mut output = 0.3 * output_lsb + 0.5 * play;
        (0..steps)
            .map(|n| {
                let at = f64::from(if n < 1000 { n } else { 2000 - n }) / 1000.0;
                let motor = 0.3 * output_lsb + span * at;
                output = output.clamp(motor - 0.5 * play, motor + 0.5 * play);
                SensedSample {
                    seq: 0,
                    currents: [0.0; 3],
                    motor_counts: (motor / motor_lsb).floor() as i64,
                    output_counts: ((output - zero) / output_lsb).floor() as i64,
                    setpoint: Setpoint::Position(motor - zero),
                }
            })
            .collect()
    }

    #[test]
    fn a_unit_keeps_its_zero_but_for_turns_whatever_its_play() {
        let params = ActuatorParams::bench();
        let count = params.sensors.output_lsb();
        let healthy = params.transmission.backlash;
        for zero in [0.0, 0.41, 2.8, -37.3, 99.0].map(|counts| counts * count) {
            let windows = [0.02, 0.05, 0.03].map(|span| window(zero, span, healthy, true));
            let found = output_zero(&params, windows.iter().map(Vec::as_slice)).unwrap();
            assert!((found - zero).abs() < 0.2 * count, "{zero}: {found}");
            for turns in [0.0, -2.0, 5.0] {
                let shifted = zero + turns * turn_rad(&params);
                for (play, back) in [
                    (healthy, true),
                    (healthy, false),
                    (20.0 * healthy, true),
                    (20.0 * healthy, false),
                ] {
                    let mut samples = window(shifted, 0.04, play, back);
                    let left = align_counters(&params, &mut samples, Some(found));
                    let expected = window(0.0, 0.04, play, back);
                    for (s, e) in samples.iter().zip(&expected) {
                        let off = (s.output_counts - e.output_counts) as f64 * count + left;
                        assert!(off.abs() < 1.3 * count, "{zero}, {turns} turns, {play}, {back}: {off}");
                    }
                }
            }
        }
    }

    #[test]
    fn windows_that_say_nothing_or_contradict_each_other_give_no_zero() {
        let params = ActuatorParams::bench();
        let play = params.transmission.backlash;
        let one_way = window(0.01, 0.04, play, false);
        assert_eq!(output_zero(&params, [one_way.as_slice()].into_iter()), None);
        let [a, b] = [0.01, 0.02].map(|zero| window(zero, 0.04, play, true));
        assert_eq!(output_zero(&params, [a.as_slice(), b.as_slice()].into_iter()), None);
        let (mut as_known, mut alone) = (a.clone(), a);
        let left = [
            align_counters(&params, &mut as_known, Some(0.03)),
            align_counters(&params, &mut alone, None),
        ];
        assert_eq!(as_known, alone, "an encoder that was mounted anew");
        assert_eq!(left[0].to_bits(), left[1].to_bits());
    }
}
