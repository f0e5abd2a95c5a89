//! Puts the two angle counters of a window on one wrap and on one zero.
//!
//! A log may begin after a counter has wrapped, and then resolver and encoder seem to be turns apart. The gear couples the
//! two angles, so the right wraps are those that bring them together. Which turn of the motor is the zero of the output is a choice of who
//! mounted them: what no play explains is taken out.

use ema_models::{ActuatorParams, FaultVector, SensedSample, Setpoint};

/// Counts after which the resolver's counter (s32) and the encoder's (s24) wrap.
const MOTOR_WRAP: i64 = 1 << 32;
const OUTPUT_WRAP: i64 = 1 << 24;

/// Wraps of the encoder that are tried on either side.
const OUTPUT_WRAPS: i64 = 32;

/// Largest difference of the two angles that belongs together, rad at the output; play and alignment are far smaller, and
/// one wrap of either counter is far more.
const TOGETHER: f64 = 0.1;

/// Counts by which the output moves in both directions where it has met both flanks of the play, and counts that a flank is uncertain by.
const FLANK_COUNTS: i64 = 4;
const UNCERTAIN_COUNTS: f64 = 2.0;

/// The widest play.
pub(crate) const WORN_OUT: FaultVector = FaultVector {
    backlash: 1.0,
    ..FaultVector::NOMINAL
};

/// Brings wraps and zeros of both counters of a window together; `known_zero` is that of its unit, rad, where the unit was commissioned. What
/// is left of the zero of the output, a part of a count, rad.
pub(crate) fn align_counters(params: &ActuatorParams, samples: &mut [SensedSample], known_zero: Option<f64>) -> f64 {
    align_counter_wraps(params, samples);
    let between = Between::of(params, samples);
    let expected = known_zero.map_or(0.0, |known| known + whole_turns(params, between.middle - known));
    move_output(params, samples, between.zero(params, expected))
}

/// The whole turns of the motor that are nearest to an angle behind the gear, rad; 0 for what is no angle.
pub(crate) fn whole_turns(params: &ActuatorParams, angle: f64) -> f64 {
    if !angle.is_finite() {
        return 0.0;
    }
    let turn = turn_rad(params);
    (angle / turn).round() * turn
}

/// A turn of the motor behind the gear, rad.
pub(crate) fn turn_rad(params: &ActuatorParams) -> f64 {
    core::f64::consts::TAU / params.transmission.gear_ratio
}

/// What lies between motor and output in a window.
pub(crate) struct Between {
    /// Middle of it, rad at the output; not finite without samples.
    pub(crate) middle: f64,
    /// Half of its width, rad.
    half_width: f64,
    /// Whether the output moved in both directions, and so met both flanks of the play.
    pub(crate) met_both: bool,
}

impl Between {
    pub(crate) fn of(params: &ActuatorParams, samples: &[SensedSample]) -> Self {
        let per_motor_count = params.sensors.motor_lsb() / params.transmission.gear_ratio;
        let per_output_count = params.sensors.output_lsb();
        let [mut low, mut high] = [f64::INFINITY, f64::NEG_INFINITY];
        // Largest rise above, and fall below, what the output was before.
        let (mut least, mut most, mut rise, mut fall) = (i64::MAX, i64::MIN, 0, 0);
        for sample in samples {
            let between = sample.motor_counts as f64 * per_motor_count - sample.output_counts as f64 * per_output_count;
            (low, high) = (low.min(between), high.max(between));
            (least, most) = (least.min(sample.output_counts), most.max(sample.output_counts));
            rise = rise.max(sample.output_counts.saturating_sub(least));
            fall = fall.max(most.saturating_sub(sample.output_counts));
        }
        Self {
            // A count holds the angles from its own to the next.
            middle: 0.5 * (low + high) + 0.5 * (per_motor_count - per_output_count),
            half_width: 0.5 * (high - low),
            met_both: rise.min(fall) >= FLANK_COUNTS,
        }
    }

    /// Zero of the output, rad: the one that is expected, or the middle of what lies between if no play explains the difference. In a window
    /// that has met one flank only, a small one cannot be told from the place within the play.
    fn zero(&self, params: &ActuatorParams, expected: f64) -> f64 {
        let explained = if self.met_both {
            self.half_width
        } else {
            0.5 * WORN_OUT.backlash_factor() * params.transmission.backlash
        };
        let uncertain = UNCERTAIN_COUNTS * params.sensors.output_lsb();
        let is_explained = (self.middle - expected).abs() <= explained + uncertain;
        if is_explained || !self.middle.is_finite() {
            expected
        } else {
            self.middle
        }
    }
}

/// Moves output and set point by the whole counts in this angle, rad; what is left of it.
fn move_output(params: &ActuatorParams, samples: &mut [SensedSample], by_rad: f64) -> f64 {
    let per_output_count = params.sensors.output_lsb();
    let counts = (by_rad / per_output_count).round();
    if counts.abs() < 1.0 {
        return by_rad;
    }
    for sample in samples {
        sample.output_counts = sample.output_counts.saturating_add(counts as i64);
        if let Setpoint::Position(angle) = &mut sample.setpoint {
            *angle += counts * per_output_count;
        }
    }
    by_rad - counts * per_output_count
}

/// Puts both counters of a window on the wraps that bring the angles together at its first sample, the fewest that do; a
/// window where none do stays as it is. In position mode the encoder is on the setpoint's own turn, and stays there.
pub(crate) fn align_counter_wraps(params: &ActuatorParams, samples: &mut [SensedSample]) {
    let Some(first) = samples.first() else { return };
    let per_motor_count = params.sensors.motor_lsb() / params.transmission.gear_ratio;
    let per_output_count = params.sensors.output_lsb();
    let apart = first.motor_counts as f64 * per_motor_count - first.output_counts as f64 * per_output_count;
    let (motor_wrap, output_wrap) = (
        MOTOR_WRAP as f64 * per_motor_count,
        OUTPUT_WRAP as f64 * per_output_count,
    );
    let reach = match first.setpoint {
        Setpoint::Position(_) => 0,
        Setpoint::Idle | Setpoint::Speed(_) => OUTPUT_WRAPS,
    };
    // 0, 1, −1, 2, −2, …
    let candidates = (0..=2 * reach).map(|n| if n % 2 == 0 { -n / 2 } else { n / 2 + 1 });
    let found = candidates
        .map(|output| {
            (
                ((output as f64 * output_wrap - apart) / motor_wrap).round() as i64,
                output,
            )
        })
        .find(|&(motor, output)| (apart + motor as f64 * motor_wrap - output as f64 * output_wrap).abs() < TOGETHER);
    if let Some((motor, output)) = found {
        for sample in samples {
            sample.motor_counts = sample.motor_counts.saturating_add(motor.saturating_mul(MOTOR_WRAP));
            sample.output_counts = sample.output_counts.saturating_add(output.saturating_mul(OUTPUT_WRAP));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;

    fn sample(motor_counts: i64, output_counts: i64, setpoint: Setpoint) -> SensedSample {
        SensedSample {
            seq: 0,
            currents: [0.0; 3],
            motor_counts,
            output_counts,
            setpoint,
        }
    }

    #[test]
    fn counters_that_wrapped_come_together_again() {
        let params = ActuatorParams::bench();
        let per_output = params.sensors.output_lsb() * params.transmission.gear_ratio / params.sensors.motor_lsb();
        // 70 and 1 000 turns of the output: beyond the resolver's range, and beyond both.
        for (turns, setpoint) in [
            (70, Setpoint::Position(440.0)),
            (1000, Setpoint::Speed(1.0)),
            (0, Setpoint::Idle),
        ] {
            let output = turns * 20_000;
            let motor = (output as f64 * per_output) as i64;
            let wrapped_output = (output + OUTPUT_WRAP / 2).rem_euclid(OUTPUT_WRAP) - OUTPUT_WRAP / 2;
            let mut samples = [sample(i64::from(motor as i32), wrapped_output, setpoint)];
            align_counter_wraps(&params, &mut samples);
            let apart = samples[0].motor_counts as f64 / per_output - samples[0].output_counts as f64;
            assert!(apart.abs() < 1.0, "{turns} turns: {apart} counts apart");
            assert_eq!((samples[0].motor_counts - motor).rem_euclid(1 << 16), 0);
        }
    }

    #[test]
    fn counters_that_do_not_belong_together_stay() {
        let far = sample(0, 5000, Setpoint::Position(0.0));
        let mut samples = [far];
        align_counter_wraps(&ActuatorParams::bench(), &mut samples);
        assert_eq!(samples, [far]);
    }

    /// A motion forth and back by 60 counts of the output, which lies `offset` counts off, within a play of `play` counts.
    fn motion(offset: i64, play: i64, back: bool) -> Vec<SensedSample> {
        let params = ActuatorParams::bench();
        let per_output = params.sensors.output_lsb() * params.transmission.gear_ratio / params.sensors.motor_lsb();
        let mut output = 0;
        let steps = if back { 120 } else { 60 };
        (0..steps)
            .map(|n: i64| {
                let at = if n < 60 { n } else { 120 - n };
                output = output.clamp(at - play / 2, at + play / 2);
                let setpoint = Setpoint::Position((offset + at) as f64 * params.sensors.output_lsb());
                sample((at as f64 * per_output) as i64, output + offset, setpoint)
            })
            .collect()
    }

    #[test]
    fn another_zero_is_taken_out_and_a_play_is_not() {
        let params = ActuatorParams::bench();
        for (offset, play, back) in [(900, 2, true), (-5, 2, true), (900, 2, false), (900, 20, true)] {
            let mut samples = motion(offset, play, back);
            align_counters(&params, &mut samples, None);
            let moved = samples[10].output_counts - motion(0, play, back)[10].output_counts;
            assert!(
                moved.abs() <= 1 + play / 2,
                "{offset}, {play}, {back}: {moved} counts left"
            );
        }
        for (play, back) in [(2, true), (20, true), (20, false)] {
            let mut samples = motion(0, play, back);
            assert_eq!(align_counters(&params, &mut samples, None).to_bits(), 0);
            assert_eq!(samples, motion(0, play, back));
        }
    }

    /// Which turn of the motor is the zero of the output, and where within a count, changes nothing.
    #[test]
    fn any_zero_of_the_motor_leaves_the_same_angles() {
        let params = ActuatorParams::bench();
        let motor_lsb = params.sensors.motor_lsb() / params.transmission.gear_ratio;
        let output_lsb = params.sensors.output_lsb();
        let half_play = 0.5 * params.transmission.backlash;
        // A slow swing over some forty counts, the output behind the play.
        let swing = |zero: f64| -> Vec<SensedSample> {
            let mut output = 0.3 * output_lsb;
            (0..2000)
                .map(|n| {
                    let motor = 0.006 * libm::sin(f64::from(n) * 0.01) + 0.3 * output_lsb;
                    output = output.clamp(motor - half_play, motor + half_play);
                    let counts = libm::floor((output - zero) / output_lsb) as i64;
                    let setpoint = Setpoint::Position(motor - zero);
                    sample(libm::floor(motor / motor_lsb) as i64, counts, setpoint)
                })
                .collect()
        };
        for zero in [0.0, 1.0, -3.0].map(|turns| turns * core::f64::consts::TAU / params.transmission.gear_ratio) {
            for part in [0.0, 0.2, 0.49, 0.5, 0.51, 0.9] {
                let mut samples = swing(zero + part * output_lsb);
                let left = align_counters(&params, &mut samples, None);
                if zero.abs() > 0.0 && part < 0.1 {
                    let counts =
                        |samples: &[SensedSample]| -> Vec<i64> { samples.iter().map(|s| s.output_counts).collect() };
                    assert_eq!(counts(&samples), counts(&swing(0.0)), "{zero} rad");
                }
                let moved_by = samples[0].output_counts as f64 * output_lsb + left;
                let expected = swing(part * output_lsb)[0].output_counts as f64 * output_lsb + part * output_lsb;
                if zero.abs() > 0.0 {
                    assert!(
                        (moved_by - expected).abs() < 0.15 * output_lsb,
                        "{zero} rad and {part} counts: {moved_by} for {expected}"
                    );
                }
            }
        }
    }
}
