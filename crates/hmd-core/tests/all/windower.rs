//! The stream of samples: their order, gaps in it, and what is counted; windows that are checked again.

use ema_models::{SensedSample, Setpoint};
use hmd_core::window::{
    CutShort, Degradation, Invalidity, StreamCounts, TimedSample, Window, WindowConfig, WindowQuality, Windower,
};

use crate::window::{bench, mixed, still, timed, windows};

fn windower() -> Windower {
    Windower::new(WindowConfig::default(), &bench(2000.0)).expect("default settings")
}

/// Samples at rest, and a step of the command with the sample of this number.
fn step_at(step: usize, count: usize) -> Vec<TimedSample> {
    still((0..count).map(|n| Setpoint::Position(if n < step { 0.0 } else { 0.25 })))
}

#[test]
fn an_identical_sample_is_a_late_copy_up_to_the_longest_gap_and_a_restart_beyond_it() {
    // 5 ms: ten samples.
    for (back, expected) in [(1, (1, 0)), (10, (1, 0)), (11, (0, 1)), (30, (0, 1))] {
        let (mut windower, samples) = (windower(), step_at(1000, 100));
        for &sample in &samples {
            windower.push(sample);
        }
        windower.push(samples[99 - back]);
        let counts = windower.counts();
        assert_eq!((counts.duplicates, counts.restarts), expected, "{back} samples back");
    }
}

#[test]
fn a_lower_number_with_another_content_is_a_restart_and_the_same_number_a_copy() {
    let (mut windower, samples) = (windower(), step_at(1000, 100));
    for &sample in &samples {
        windower.push(sample);
    }
    let mut other = samples[99];
    other.sensed.output_counts = 1;
    windower.push(other);
    assert_eq!((windower.counts().duplicates, windower.counts().restarts), (1, 0));
    other.seq = 98;
    windower.push(other);
    assert_eq!((windower.counts().duplicates, windower.counts().restarts), (1, 1));
}

#[test]
fn every_sample_copy_gap_restart_and_glitch_is_counted_once() {
    let mut windower = windower();
    let mut samples = step_at(1000, 300);
    for glitch in [50, 70] {
        samples[glitch].sensed.setpoint = Setpoint::Position(0.8);
    }
    for &sample in &samples {
        match sample.seq {
            120 | 130..135 => {}
            200 => assert!([sample; 3].iter().all(|&copy| windower.push(copy).is_none())),
            _ => assert_eq!(windower.push(sample), None),
        }
    }
    samples[..100]
        .iter()
        .for_each(|&sample| assert_eq!(windower.push(sample), None));
    assert_eq!(windower.finish(), None);
    let expected = StreamCounts {
        samples: 294 + 100,
        duplicates: 2,
        missing: 6,
        restarts: 1,
        glitches: 4,
    };
    assert_eq!(windower.counts(), expected);
}

#[test]
fn rest_goes_on_through_a_gap_as_long_as_itself_and_no_longer_one() {
    // Rest until 60, a gap, ten more samples of rest, and a step.
    let windows_with = |gap: u64| {
        let mut samples = step_at(70, 1200);
        for sample in &mut samples[60..] {
            sample.seq += gap;
        }
        windows(&bench(2000.0), &samples)
    };
    let with_gap = windows_with(40);
    assert_eq!(with_gap.len(), 1);
    assert_eq!(with_gap[0].samples[40].seq, 110, "the trigger");
    assert!(windows_with(41).is_empty());
}

#[test]
fn a_gap_within_a_window_ends_it_when_its_time_is_over() {
    let mut samples = step_at(100, 2000);
    // The window goes from 60 to 1060.
    for sample in &mut samples[900..] {
        sample.seq += 500;
    }
    let mut windower = windower();
    let window = samples
        .iter()
        .find_map(|&sample| windower.push(sample))
        .expect("a window");
    assert_eq!((window.samples.len(), window.lost), (1001, 161));
    assert!(!windower.is_open());
    assert_eq!(windower.counts().missing, 500);
}

#[test]
fn a_jump_of_the_command_in_the_very_last_sample_opens_no_window() {
    let mut windower = windower();
    for sample in step_at(100, 101) {
        assert_eq!(windower.push(sample), None);
    }
    assert_eq!(windower.finish(), None);
    // With one more there is one, which is cut short.
    let mut windower = self::windower();
    for sample in step_at(100, 102) {
        assert_eq!(windower.push(sample), None);
    }
    let window = windower.finish().expect("a window");
    assert_eq!(
        window.quality,
        WindowQuality::Invalid(Invalidity::CutShort(CutShort::StreamEnded))
    );
    assert_eq!(window.samples.len(), 42);
}

#[test]
fn what_came_before_a_break_is_no_rest_for_what_comes_after_it() {
    let mut windower = windower();
    let samples = step_at(100, 1300);
    for &sample in &samples[..90] {
        windower.push(sample);
    }
    assert_eq!(windower.finish(), None);
    // Ten samples of rest are left, whose numbers go on.
    for &sample in &samples[90..] {
        assert_eq!(windower.push(sample), None);
    }
    assert_eq!(windower.counts().missing, 0);
}

#[test]
fn a_window_counts_the_copies_that_came_while_it_was_open() {
    let mut windower = windower();
    let mut found = Vec::new();
    for sample in step_at(100, 1200) {
        found.extend(windower.push(sample));
        // Five before the window, three in it.
        if [10, 20, 30, 40, 50, 300, 301, 302].contains(&sample.seq) {
            windower.push(sample);
        }
    }
    assert_eq!((found.len(), found[0].duplicates), (1, 3));
    assert_eq!(windower.counts().duplicates, 8);
}

#[test]
fn a_window_begins_the_pre_trigger_time_before_the_triggers_stamp() {
    let mut samples = step_at(100, 1200);
    // The trigger was read late.
    samples[100].stamp_ns += 123_456;
    let window = windows(&bench(2000.0), &samples).remove(0);
    assert_eq!(window.t_start_ns, samples[60].stamp_ns + 123_456);
    // A clock that has just begun.
    for sample in &mut samples {
        sample.stamp_ns = 10_000 * sample.seq;
    }
    assert_eq!(windows(&bench(2000.0), &samples).remove(0).t_start_ns, 0);
}

#[test]
fn at_each_place_one_wrong_count_is_the_only_sample_that_is_filled() {
    for rate in [400.0, 2000.0] {
        let params = bench(rate);
        let rest = (0.02 * rate) as usize;
        let count = (0.5 * rate) as usize + 1;
        let setpoint = |n: usize| Setpoint::Position(if n < 2 * rest { 0.0 } else { 0.25 });
        let good: Vec<TimedSample> = (0..2 * count)
            .map(|n| {
                let sensed = SensedSample {
                    seq: n as u64,
                    currents: [0.0; 3],
                    motor_counts: 0,
                    output_counts: 0,
                    setpoint: setpoint(n),
                };
                timed(sensed, rate)
            })
            .collect();
        for place in (0..6).chain(count - 6..count) {
            for motor in [true, false] {
                let mut samples = good.clone();
                let sensed = &mut samples[rest + place].sensed;
                let counts = if motor {
                    &mut sensed.motor_counts
                } else {
                    &mut sensed.output_counts
                };
                *counts = 1 << 20;
                let window = windows(&params, &samples).remove(0);
                let filled = Degradation::Filled { lost: 0, rejected: 1 };
                assert_eq!(
                    window.quality,
                    WindowQuality::Degraded(vec![filled]),
                    "{place} at {rate} Hz, {motor}"
                );
                assert_eq!(window.filled, [place]);
            }
        }
    }
}

#[test]
fn a_rest_longer_than_the_window_is_watched_as_a_whole() {
    let config = WindowConfig {
        rest_ms: 100.0,
        duration_ms: 50.0,
        ..WindowConfig::default()
    };
    // Wherever in the memory of the last samples the step lies; a sample earlier there is no rest yet.
    for (step, expected) in (200..620).map(|step| (step, 1)).chain([(199, 0)]) {
        let mut windower = Windower::new(config, &bench(2000.0)).expect("possible settings");
        let samples = step_at(step, step + 150);
        let found: Vec<Window> = samples.iter().filter_map(|&sample| windower.push(sample)).collect();
        assert_eq!(found.len(), expected, "{step}");
        assert!(
            found
                .iter()
                .all(|window| window.samples[window.trigger].seq == step as u64)
        );
    }
}

#[test]
fn windows_are_numbered_from_where_another_windower_ended() {
    let mut windower = windower().numbered_from(7);
    assert_eq!(windower.next_number(), 7);
    let samples = step_at(100, 1200);
    let window = samples.iter().find_map(|&sample| windower.push(sample));
    assert_eq!(
        (window.map(|window| window.number), windower.next_number()),
        (Some(7), 8)
    );
}

#[test]
fn a_window_in_which_the_rate_changes_is_cut_short_for_that() {
    let mut windower = windower();
    for sample in step_at(100, 300) {
        assert_eq!(windower.push(sample), None);
    }
    let window = windower.finish_at_rate().expect("an open window");
    let cut = Invalidity::CutShort(CutShort::RateChanged);
    assert_eq!(
        (window.quality, window.samples.len()),
        (WindowQuality::Invalid(cut), 240)
    );
    assert_eq!(windower.finish_at_rate(), None);
}

// Checked again.

/// The mixed actuation with another sign of a current, which no window may have.
fn reversed() -> Window {
    let mut samples = mixed();
    samples.iter_mut().for_each(|sample| reverse(&mut sample.sensed));
    let window = windows(&bench(2000.0), &samples).remove(0);
    assert!(!window.quality.is_fit());
    window
}

fn reverse(sensed: &mut SensedSample) {
    sensed.currents[1] = -sensed.currents[1];
}

#[test]
fn a_window_that_is_checked_again_has_what_is_still_wrong_filled_and_named() {
    let mut window = reversed();
    window.samples.iter_mut().for_each(reverse);
    window.samples[500].motor_counts += 1 << 20;
    window.samples[501].currents[0] = 40.0;
    window
        .check_again(&WindowConfig::default(), &bench(2000.0))
        .expect("default settings");
    let filled = Degradation::Filled { lost: 0, rejected: 2 };
    assert_eq!(window.quality, WindowQuality::Degraded(vec![filled]));
    assert_eq!((window.filled.as_slice(), window.rejected), (&[500, 501][..], 2));
    let right = windows(&bench(2000.0), &mixed()).remove(0);
    assert!((window.samples[500].motor_counts - right.samples[500].motor_counts).abs() < 40);
    assert!((window.samples[501].currents[0] - right.samples[501].currents[0]).abs() < 1.0);
}

#[test]
fn a_window_that_is_fit_is_not_checked_again() {
    let mut samples = mixed();
    samples[500].sensed.currents[0] = 40.0;
    let mut window = windows(&bench(2000.0), &samples).remove(0);
    assert!(window.quality.is_fit() && window.rejected == 1);
    let before = window.clone();
    window
        .check_again(&WindowConfig::default(), &bench(2000.0))
        .expect("default settings");
    assert_eq!(window, before);
}

#[test]
fn settings_that_are_impossible_are_refused_when_a_window_is_checked_again() {
    let config = WindowConfig {
        duration_ms: 1e6,
        ..WindowConfig::default()
    };
    let refused = reversed().check_again(&config, &bench(2000.0));
    assert_eq!(refused.map_err(|refused| refused.field), Err("duration_ms"));
}
