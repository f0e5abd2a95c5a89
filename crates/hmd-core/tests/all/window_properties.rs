//! What holds of windows out of any samples.

use std::sync::Arc;

use ema_models::{SensedSample, Setpoint};
use hmd_core::config::Config;
use hmd_core::outbox::WindowJob;
use hmd_core::sample::MeasuredConditions;
use hmd_core::sensor_checks::examine;
use hmd_core::window::{Defect, Invalidity, TimedSample, WindowConfig, WindowQuality, Windower};
use proptest::prelude::*;

use crate::window::{bench, mixed, only, still, timed, windows};

/// Anything a decoder could hand over: mostly a little step forward, sometimes a jump, with any signals.
fn any_samples() -> impl Strategy<Value = Vec<TimedSample>> {
    let number = prop_oneof![8 => -20.0..20.0f64, 1 => prop::num::f64::ANY];
    let setpoint = prop_oneof![
        1 => Just(Setpoint::Idle),
        6 => number.clone().prop_map(Setpoint::Position),
        3 => Just(Setpoint::Position(0.0)),
        3 => number.clone().prop_map(Setpoint::Speed),
    ];
    let step = prop_oneof![20 => Just(1_u64), 4 => 0..20_u64, 1 => any::<u64>()];
    let held = prop_oneof![Just(1_usize), 8..60_usize, 200..300_usize];
    let counts = prop_oneof![4 => -1000..1000_i64, 1 => any::<i64>()];
    let one = (
        step,
        held,
        setpoint,
        prop::array::uniform3(number),
        counts.clone(),
        counts,
        any::<u64>(),
    );
    prop::collection::vec(one, 0..40).prop_map(|blocks| {
        let mut seq = 0_u64;
        let mut samples = Vec::new();
        for (step, held, setpoint, currents, motor_counts, output_counts, stamp_ns) in blocks {
            for _ in 0..held {
                seq = seq.wrapping_add(step);
                let sensed = SensedSample {
                    seq,
                    currents,
                    motor_counts,
                    output_counts,
                    setpoint,
                };
                samples.push(TimedSample { seq, stamp_ns, sensed });
            }
        }
        samples
    })
}

proptest! {
    #[test]
    fn anything_is_survived_and_accounted_for(samples in any_samples()) {
        let mut windower = Windower::new(WindowConfig::default(), &bench(400.0)).unwrap();
        let mut all = Vec::new();
        for &sample in &samples {
            all.extend(windower.push(sample));
        }
        all.extend(windower.finish());
        let counts = windower.counts();
        prop_assert_eq!(counts.samples + counts.duplicates, samples.len() as u64);
        prop_assert!(!windower.is_open());
        for (n, window) in all.iter().enumerate() {
            prop_assert_eq!(window.number, n as u64);
            prop_assert!(window.samples.len() <= window.expected && window.trigger < window.samples.len());
            prop_assert_eq!(window.lost + window.rejected, window.filled.len() as u64);
            prop_assert!(window.samples.windows(2).all(|pair| pair[1].seq == pair[0].seq + 1));
            prop_assert!(window.samples.iter().all(|s| s.currents.iter().all(|i| i.is_finite())));
            prop_assert!(!window.quality.is_fit() || window.samples.len() == window.expected);
            prop_assert!(!window.quality.to_string().is_empty());
        }
    }

    /// What was received may be anything; the checks of the sensors read it before any estimate.
    #[test]
    fn any_window_can_be_examined_for_wrong_sensors(samples in any_samples(), load in any::<Option<f64>>()) {
        let config = Config::from_toml_str("[[actuator]]\nid = 0\n", "hmd.toml").unwrap();
        let actuator = Arc::new(config.actuators()[0].clone());
        let params = bench(400.0);
        let mut windower = Windower::new(WindowConfig::default(), &params).unwrap();
        let mut all = Vec::new();
        for &sample in &samples {
            all.extend(windower.push(sample));
        }
        for window in all {
            let mut job = WindowJob {
                actuator: Arc::clone(&actuator),
                params,
                window,
                conditions: MeasuredConditions { load_torque_nm: load, ..MeasuredConditions::default() },
                operating_s: 0.0,
            };
            for finding in examine(&job) {
                prop_assert!(!finding.suspicions.is_empty());
                finding.correction.iter().for_each(|correction| correction.apply(&mut job));
            }
        }
    }

    #[test]
    fn drops_and_copies_are_filled_or_named(
        drops in prop::collection::btree_set(0..1160_usize, 0..160),
        copies in prop::collection::btree_set(0..1160_usize, 0..60),
    ) {
        let full = mixed();
        let link = |(n, &sample): (usize, &TimedSample)| {
            let times = if drops.contains(&n) { 0 } else { 1 + usize::from(copies.contains(&n)) };
            std::iter::repeat_n(sample, times)
        };
        let received: Vec<TimedSample> = full.iter().enumerate().flat_map(link).collect();
        let window = only(&received);
        // Nothing received is altered, and what is not received is marked.
        for (n, sample) in window.samples.iter().enumerate() {
            let truth = full[sample.seq as usize].sensed;
            prop_assert_eq!(window.filled.contains(&n), drops.contains(&(truth.seq as usize)));
            prop_assert!(window.filled.contains(&n) || *sample == truth);
        }
        match window.quality {
            WindowQuality::Complete => prop_assert_eq!(window.lost, 0),
            WindowQuality::Degraded(_) => prop_assert!((1..=100).contains(&window.lost)),
            WindowQuality::Invalid(Invalidity::CommandInGap { .. }) => prop_assert!(drops.contains(&79) || drops.contains(&80)),
            WindowQuality::Invalid(Invalidity::TooManyFlawed { defect, count, longest }) => {
                prop_assert_eq!(defect, Defect::Missing);
                prop_assert!(count > 100 || longest > 10 || (count > 20 && longest > 3));
            }
            WindowQuality::Invalid(other) => prop_assert!(false, "{}", other),
        }
    }

    #[test]
    fn flipped_bits_are_repaired_or_the_window_is_invalid(
        flips in prop::collection::btree_map(11..289_usize, (0..6_usize, 0..32_u32), 1..12),
    ) {
        let full = mixed();
        let mut received = full.clone();
        for (&place, &(field, bit)) in &flips {
            let at = 4 * place; // one flip in one sample at a time is what is promised
            let sensed = &mut received[at].sensed;
            match field {
                0..3 => {
                    let milliamps = (sensed.currents[field] * 1e3).round() as i16 ^ (1 << (bit % 16));
                    sensed.currents[field] = f64::from(milliamps) * 1e-3;
                }
                3 => sensed.motor_counts ^= 1 << bit,
                4 => sensed.output_counts ^= 1 << (bit % 24),
                _ => {
                    // At the step itself (80) a wrong height on the way to the right one cannot be distinguished from a command.
                    if let Setpoint::Position(angle) = sensed.setpoint
                        && at != 80
                    {
                        let micro = (angle * 1e6).round() as i32 ^ (1 << bit);
                        sensed.setpoint = Setpoint::Position(f64::from(micro) * 1e-6);
                    }
                }
            }
        }
        let window = windows(&bench(2000.0), &received).remove(0);
        if window.quality.is_fit() {
            for (n, sample) in window.samples.iter().enumerate() {
                let truth = full[sample.seq as usize].sensed;
                // What passes is below what the checks can tell from noise and motion. What is filled is as good as a
                // straight line through the steepest rise of the current.
                let allowed = if window.filled.contains(&n) { 3.0 } else { 1.0 };
                let current = (0..3).map(|j| (sample.currents[j] - truth.currents[j]).abs()).fold(0.0, f64::max);
                prop_assert!(current < allowed, "current off by {} at {}", current, sample.seq);
                prop_assert!((sample.motor_counts - truth.motor_counts).abs() < 300, "motor at {}", sample.seq);
                prop_assert!((sample.output_counts - truth.output_counts).abs() < 20, "output at {}", sample.seq);
                match (sample.setpoint, truth.setpoint) {
                    (Setpoint::Position(a), Setpoint::Position(b)) => prop_assert!((a - b).abs() < 3e-3),
                    other => prop_assert!(false, "{:?}", other),
                }
            }
        }
    }

    #[test]
    fn windows_depend_on_the_samples_alone(
        cuts in prop::collection::vec(1..200_usize, 1..20),
        before in prop::collection::vec(0..300_u64, 0..3),
    ) {
        // The same actuation after any history of rests, taken in chunks of any size, is the same window.
        let full = mixed();
        let shift: u64 = before.iter().sum();
        let mut stream = still(std::iter::repeat_n(full[0].sensed.setpoint, shift as usize));
        for sample in &mut stream {
            let setpoint = sample.sensed.setpoint;
            sample.sensed = SensedSample { seq: sample.seq, setpoint, ..full[0].sensed };
        }
        stream.extend(full.iter().map(|s| timed(SensedSample { seq: s.seq + shift, ..s.sensed }, 2000.0)));
        let mut windower = Windower::new(WindowConfig::default(), &bench(2000.0)).unwrap();
        let (mut found, mut rest, mut cuts) = (Vec::new(), stream.as_slice(), cuts.iter().cycle());
        while !rest.is_empty() {
            let (chunk, after) = rest.split_at(rest.len().min(*cuts.next().unwrap()));
            found.extend(chunk.iter().filter_map(|&sample| windower.push(sample)));
            rest = after;
        }
        let expected = only(&full);
        prop_assert_eq!(found.len(), 1);
        prop_assert_eq!(&found[0].quality, &WindowQuality::Complete);
        let unshifted = found[0].samples.iter().map(|s| SensedSample { seq: s.seq - shift, ..*s });
        prop_assert!(unshifted.eq(expected.samples.iter().copied()));
        prop_assert_eq!(found[0].t_start_ns, expected.t_start_ns + 500_000 * shift);
    }
}
