//! The assembler under lost, repeated and reordered frames and long silences.

use crate::common::nth_sample;
use ema_wire::{ActuatorId, Assembler, AssemblerStats, Frame, Sample, SampleFd, Status};
use proptest::prelude::*;

const PERIOD_NS: u64 = 500_000;

fn assembler() -> Assembler {
    Assembler::new(ActuatorId::new(5).expect("below 16"))
}

/// Frame j (0 to 2) of sample k, with its receive stamp.
fn sent(k: u64, j: usize) -> (Frame, u64) {
    (nth_sample(k).to_frames()[j], k * PERIOD_NS + 130_000 * (j as u64 + 1))
}

fn feed(assembler: &mut Assembler, frames: impl IntoIterator<Item = (Frame, u64)>) -> Vec<Sample> {
    frames
        .into_iter()
        .flat_map(|(frame, at)| assembler.push(&frame, at))
        .collect()
}

/// Effect of the link on one frame.
#[derive(Debug, Clone, Copy)]
enum LinkEffect {
    Pass,
    Drop,
    Repeat,
    Delay(u64),
}

fn link_effect() -> impl Strategy<Value = LinkEffect> {
    prop_oneof![
        6 => Just(LinkEffect::Pass),
        1 => Just(LinkEffect::Drop),
        1 => Just(LinkEffect::Repeat),
        1 => any::<u64>().prop_map(LinkEffect::Delay),
    ]
}

proptest! {
    #[test]
    fn without_loss_every_sample_is_delivered_once(first in any::<u32>(), count in 1_u64..600) {
        let ks = u64::from(first)..u64::from(first) + count;
        let mut assembler = assembler();
        let got = feed(&mut assembler, ks.clone().flat_map(|k| (0..3).map(move |j| sent(k, j))));
        prop_assert_eq!(got, ks.map(nth_sample).collect::<Vec<_>>());
        prop_assert_eq!(assembler.stats(), AssemblerStats { samples: count, ..Default::default() });
    }

    /// No sample has fields of two instants, whatever frames are lost, repeated or reordered and however long the silences
    /// are. Samples are delivered in order unless one is delayed by more than the span, which counts as a restart.
    #[test]
    fn no_sample_mixes_two_instants(
        effects in proptest::collection::vec([link_effect(), link_effect(), link_effect()], 1..150),
        silences in proptest::collection::vec((0..150_usize, 0..3_usize, 250..1030_u64), 0..4),
        longest_delay_ns in prop_oneof![Just(Assembler::DEFAULT_MAX_SPAN_NS), Just(2 * Assembler::DEFAULT_MAX_SPAN_NS)],
    ) {
        let mut frames = Vec::new();
        let mut k = 0;
        for (index, sample_effects) in effects.iter().enumerate() {
            for (j, effect) in sample_effects.iter().enumerate() {
                // The silence begins inside this sample and has any number of samples, among them exactly 256.
                k += silences.iter().filter(|(at, part, _)| (*at, *part) == (index, j)).map(|(_, _, n)| n).sum::<u64>();
                let (frame, at) = sent(k, j);
                match *effect {
                    LinkEffect::Pass => frames.push((frame, at)),
                    LinkEffect::Drop => {}
                    LinkEffect::Repeat => frames.extend([(frame, at), (frame, at + 1_000)]),
                    LinkEffect::Delay(by_ns) => frames.push((frame, at + by_ns % longest_delay_ns)),
                }
            }
            k += 1;
        }
        frames.sort_by_key(|(_, at)| *at);
        let mut assembler = assembler();
        let got = feed(&mut assembler, frames);
        assembler.close();
        let sent_as = |sample: &Sample| (0..k).find(|k| nth_sample(*k) == *sample);
        let order: Option<Vec<u64>> = got.iter().map(sent_as).collect();
        prop_assert!(order.is_some(), "mixed: {:?}", got.iter().find(|sample| sent_as(sample).is_none()));
        let steps_back = order.iter().flatten().zip(order.iter().flatten().skip(1)).filter(|(a, b)| b <= a).count();
        prop_assert_eq!(assembler.stats().restarts, steps_back as u64);
        prop_assert!(steps_back == 0 || longest_delay_ns > Assembler::DEFAULT_MAX_SPAN_NS);
        prop_assert_eq!(assembler.stats().conflicting, 0);
    }

    #[test]
    fn lost_samples_are_counted_exactly(lost in proptest::collection::vec(any::<[bool; 3]>(), 1..200)) {
        let count = lost.len() as u64 + 2; // one good sample at either end
        let is_lost = |k: u64, j: usize| k > 0 && k < count - 1 && lost[k as usize - 1][j];
        let mut assembler = assembler();
        let frames = (0..count).flat_map(|k| (0..3).map(move |j| (k, j))).filter(|(k, j)| !is_lost(*k, *j));
        let got = feed(&mut assembler, frames.map(|(k, j)| sent(k, j)));
        let whole = lost.iter().filter(|parts| !parts.contains(&true)).count() as u64 + 2;
        let begun = lost.iter().filter(|parts| parts.contains(&true) && parts.contains(&false)).count() as u64;
        prop_assert_eq!(got.len() as u64, whole);
        prop_assert_eq!(
            assembler.stats(),
            AssemblerStats { samples: whole, incomplete: begun, missing: count - whole, ..Default::default() }
        );
    }

    #[test]
    fn fd_frames_follow_the_same_rules(sizes in proptest::collection::vec((1_usize..=3, any::<bool>()), 1..60)) {
        let mut assembler = assembler();
        let (mut k, mut expected, mut repeats) = (0, Vec::new(), 0);
        let mut got = Vec::new();
        for (size, twice) in sizes {
            let samples: Vec<Sample> = (k..k + size as u64).map(nth_sample).collect();
            k += size as u64;
            let frame = Frame::SampleFd(SampleFd::from_samples(&samples)?);
            for _ in 0..=usize::from(twice) {
                got.extend(assembler.push(&frame, k * PERIOD_NS));
            }
            repeats += u64::from(twice) * size as u64;
            expected.extend(samples);
        }
        prop_assert_eq!(got, expected);
        // The last sample of a repeated frame is a duplicate of the newest; the samples before it are late.
        let stats = assembler.stats();
        prop_assert_eq!(stats.duplicates + stats.late, repeats);
    }
}

#[test]
fn frames_before_and_after_a_silence_of_256_samples_are_not_joined() {
    for cut in 1..3 {
        let mut assembler = assembler();
        let got = feed(
            &mut assembler,
            (0..cut).map(|j| sent(0, j)).chain((cut..3).map(|j| sent(256, j))),
        );
        assert_eq!(got, []);
        assembler.close();
        assert_eq!(assembler.stats().incomplete, 2);
    }
}

#[test]
fn frames_of_different_content_reject_the_sample() {
    let mut assembler = assembler();
    let (Frame::Position(mut position), at) = sent(0, 1) else {
        panic!("frame 1 is Position")
    };
    position.motor_counts += 1;
    let rejected = [sent(0, 0), sent(0, 1), (Frame::Position(position), at), sent(0, 2)];
    assert_eq!(feed(&mut assembler, rejected), []);
    // The whole sample in one frame, too: which of the three is right nobody knows.
    assert_eq!(assembler.push_sample(&nth_sample(0), at), None);
    assert_eq!(
        feed(&mut assembler, [sent(1, 0), sent(1, 1), sent(1, 2)]),
        [nth_sample(1)]
    );
    assert_eq!(
        assembler.stats(),
        AssemblerStats {
            samples: 1,
            conflicting: 1,
            late: 2,
            ..Default::default()
        }
    );
}

#[test]
fn a_restarted_device_is_counted_and_its_samples_are_delivered() {
    let mut assembler = assembler();
    let whole = |k, from_ns| (0..3).map(move |j| (nth_sample(k).to_frames()[j], from_ns));
    let got = feed(
        &mut assembler,
        whole(900, 0).chain(whole(0, 50_000_000)).chain(whole(1, 50_500_000)),
    );
    assert_eq!(got, [900, 0, 1].map(nth_sample));
    assert_eq!(
        assembler.stats(),
        AssemblerStats {
            samples: 3,
            restarts: 1,
            ..Default::default()
        }
    );
}

#[test]
fn status_frames_have_no_effect() {
    let status = Status {
        dc_link_dv: 0,
        winding_temp_dc: 0,
        load_torque_dnm: None,
        fault_flags: 0,
        seq8: 77,
    };
    let mut assembler = assembler();
    let got = feed(
        &mut assembler,
        [sent(0, 0), (Frame::Status(status), 200_000), sent(0, 1), sent(0, 2)],
    );
    assert_eq!(got, [nth_sample(0)]);
}

/// A serial line that was read late, and then a lot at once: all with one stamp.
#[test]
fn whole_samples_after_a_gap_are_delivered_whatever_their_stamps() {
    for step in [2, 128, 140, 255, 256, 257, 994, 32_767] {
        let mut assembler = assembler();
        let samples = [0, 1, 1 + step, 2 + step].map(nth_sample);
        let got: Vec<Sample> = samples
            .iter()
            .filter_map(|sample| assembler.push_sample(sample, 7))
            .collect();
        assert_eq!(got, samples, "{step}");
        let expected = AssemblerStats {
            samples: 4,
            missing: step - 1,
            ..Default::default()
        };
        assert_eq!(assembler.stats(), expected, "{step}");
        assert_eq!(assembler.push_sample(&samples[3], 7), None);
        assert_eq!(assembler.push_sample(&nth_sample(1 + step), 7), None);
        assert_eq!((assembler.stats().duplicates, assembler.stats().late), (1, 1));
    }
}

#[test]
fn a_counter_far_back_is_a_restart_though_the_stamps_are_one() {
    let mut assembler = assembler();
    for k in [40_000, 0, 1, 2] {
        assert!(assembler.push_sample(&nth_sample(k), 7).is_some(), "{k}");
    }
    assert_eq!((assembler.stats().restarts, assembler.stats().late), (0, 0));
    let mut assembler = self::assembler();
    for k in [20_000, 0, 1, 2] {
        assert!(assembler.push_sample(&nth_sample(k), 7).is_some(), "{k}");
    }
    assert_eq!((assembler.stats().restarts, assembler.stats().late), (1, 0));
}

#[test]
fn after_a_silence_the_last_sample_or_one_before_it_is_a_new_one() {
    for k in [900, 899] {
        let mut assembler = assembler();
        assert!(assembler.push_sample(&nth_sample(900), 0).is_some());
        assert!(assembler.push_sample(&nth_sample(k), 60_000_000_000).is_some(), "{k}");
        assert_eq!(
            (assembler.stats().restarts, assembler.stats().duplicates),
            (1, 0),
            "{k}"
        );
    }
}

#[test]
fn nothing_is_missing_before_another_stream() {
    let mut assembler = assembler();
    assert!(assembler.push_sample(&nth_sample(7), 0).is_some());
    assembler.begin_stream();
    assert!(assembler.push_sample(&nth_sample(300), PERIOD_NS).is_some());
    assert_eq!((assembler.stats().missing, assembler.stats().restarts), (0, 0));
}
