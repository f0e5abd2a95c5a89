//! Undoes the wraps of the two angle counters of a window.
//!
//! A log may begin after a counter has wrapped, and then resolver and encoder seem to be turns apart. The gear couples the
//! two angles, so the right wraps are those that bring them together.

use ema_models::{ActuatorParams, SensedSample, Setpoint};

/// Counts after which the resolver's counter (s32) and the encoder's (s24) wrap.
const MOTOR_WRAP: i64 = 1 << 32;
const OUTPUT_WRAP: i64 = 1 << 24;

/// Wraps of the encoder that are tried on either side.
const OUTPUT_WRAPS: i64 = 32;

/// Largest difference of the two angles that belongs together, rad at the output; play and alignment are far smaller, and
/// one wrap of either counter is far more.
const TOGETHER: f64 = 0.1;

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
}
