//! The windowing ring.

use crate::{SOME, for_any};
use ema_models::{ActuatorParams, SensedSample, Setpoint};
use hmd_core::window::{TimedSample, WindowConfig, Windower};

type AnySample = (u8, u64, u8, u8, i32);

fn samples() -> impl bolero::ValueGenerator<Output = Vec<AnySample>> {
    bolero::produce::<Vec<AnySample>>().with().len(0..=200usize)
}

/// Samples with counters that stand, step, skip and jump; in runs of up to 255.
fn stream(input: &[AnySample]) -> Vec<TimedSample> {
    let mut seq = 0u64;
    let mut samples = Vec::new();
    for (run, jump, kind, setpoint, counts) in input {
        seq = match kind % 8 {
            0 => *jump,
            1 => seq.wrapping_sub(jump % 16),
            2 => seq.saturating_add(jump % 5000),
            _ => seq,
        };
        for _ in 0..run % 64 {
            let value = f64::from(setpoint % 4) * 0.1;
            samples.push(TimedSample {
                seq,
                stamp_ns: seq.wrapping_mul(500_000),
                sensed: SensedSample {
                    seq,
                    currents: [0.1, -0.05, -0.05],
                    motor_counts: (*counts).into(),
                    output_counts: (*counts).into(),
                    setpoint: if setpoint & 128 == 0 {
                        Setpoint::Position(value)
                    } else {
                        Setpoint::Speed(f64::NAN)
                    },
                },
            });
            seq = seq.saturating_add(1);
        }
    }
    samples
}

/// Every sample is taken or a duplicate; windows are numbered in order and no longer than theirs, on a grid without gaps.
///
/// Up to 12 600 samples whose 64-bit counters stand still, step back and jump anywhere.
#[test]
fn windows_are_whole_and_counted() {
    let params = ActuatorParams::bench();
    for_any!(SOME / 4, samples(), |input: Vec<AnySample>| {
        let mut windower = Windower::new(WindowConfig::default(), &params).unwrap();
        let stream = stream(&input);
        let mut windows: Vec<_> = stream.iter().filter_map(|sample| windower.push(*sample)).collect();
        windows.extend(windower.finish());
        let counts = windower.counts();
        assert_eq!(counts.samples + counts.duplicates, stream.len() as u64);
        for (number, window) in (0..).zip(&windows) {
            assert_eq!(window.number, number);
            assert!(
                window.samples.len() <= window.expected,
                "{} of {}",
                window.samples.len(),
                window.expected
            );
            assert!(window.trigger < window.samples.len());
            assert!(window.filled.is_sorted() && window.filled.last().is_none_or(|at| *at < window.samples.len()));
            assert!(window.samples.windows(2).all(|two| two[0].seq + 1 == two[1].seq));
        }
    });
}
