//! How far a count may be from its neighbours, and what is a spike, a jump or a kink.

use super::super::bench_slots::{flawed_in, slots};
use super::*;

/// A counter that turns by up to 100 counts in a period, and by 2 counts more in the next.
const LIMITS: CounterLimits = CounterLimits {
    part: Part::Motor,
    defect: Defect::MotorSpike,
    speed: 100.0,
    acceleration: 2.0,
    jitter: 0.0,
};

const JITTERING: CounterLimits = CounterLimits { jitter: 0.1, ..LIMITS };

/// Places of no spikes.
const NONE: [usize; 0] = [];

fn at(index: usize, count: f64) -> Point {
    Point { index, count }
}

/// Points at successive indices.
fn points(counts: &[f64]) -> Vec<Point> {
    counts.iter().enumerate().map(|(n, &count)| at(n, count)).collect()
}

fn is(found: f64, expected: f64) -> bool {
    (found - expected).abs() < 1e-9
}

// Lines.

#[test]
fn the_slope_of_a_line_is_counts_per_period_from_either_end() {
    let (left, right) = (at(3, 10.0), at(7, 30.0));
    assert!(is(slope((&left, &right)), 5.0));
    assert!(is(slope((&right, &left)), 5.0));
}

#[test]
fn a_line_allows_the_slack_and_twice_what_the_acceleration_does_up_to_its_far_end() {
    let (far, near) = (at(10, 0.0), at(11, 0.0));
    let allowed_at = |index| allowed(&at(index, 0.0), (&near, &far), 50.0, &LIMITS);
    // 8 counts, and 2 counts for each of 1·2, 2·3, 3·4.
    assert!(is(allowed_at(12), 12.0) && is(allowed_at(13), 20.0) && is(allowed_at(14), 32.0));
    // The same from the other side.
    let (near, far) = (at(13, 0.0), at(14, 0.0));
    assert!(is(allowed(&at(12, 0.0), (&near, &far), 50.0, &LIMITS), 12.0));
}

#[test]
fn jitter_of_three_instants_is_allowed_by_the_speed() {
    let more = |point: usize, near: usize, far: usize| {
        let (point, near, far) = (at(point, 0.0), at(near, 0.0), at(far, 0.0));
        let of = |limits| allowed(&point, (&near, &far), 40.0, limits);
        of(&JITTERING) - of(&LIMITS)
    };
    // 40 counts a period, a tenth of a period and a quarter more: 5 counts for the instant itself and for the near one's, each
    // twice, and as much for the line's tilt by its length.
    assert!(is(more(12, 11, 10), 20.0));
    assert!(is(more(13, 11, 10), 30.0));
    assert!(is(more(12, 11, 9), 15.0));
    assert!(is(more(12, 13, 14), 20.0));
}

#[test]
fn the_distance_from_a_line_has_its_side_and_is_1_where_just_allowed() {
    let (far, near) = (at(4, 100.0), at(5, 110.0));
    for (count, expected) in [(120.0, 0.0), (132.0, 1.0), (108.0, -1.0), (144.0, 2.0)] {
        assert!(is(off_line(&at(6, count), (&near, &far), 10.0, &LIMITS), expected));
    }
    let (near, far) = (at(7, 130.0), at(8, 140.0));
    for (count, expected) in [(120.0, 0.0), (132.0, 1.0), (108.0, -1.0)] {
        assert!(is(off_line(&at(6, count), (&near, &far), 10.0, &LIMITS), expected));
    }
}

// Spikes by two lines.

/// Indices of the spikes in a ramp of sixteen counts, the counts of some places changed.
fn spikes(run: usize, changed: &[(usize, f64)]) -> Vec<usize> {
    let mut ramp: Vec<f64> = (0..16).map(|n| 20.0 * f64::from(n)).collect();
    for &(n, by) in changed {
        ramp[n] += by;
    }
    off_both_lines(&points(&ramp), run, &LIMITS)
}

#[test]
fn a_count_is_a_spike_off_both_lines_by_more_than_they_allow() {
    for sign in [1.0, -1.0] {
        for place in [0, 5, 8, 10, 15] {
            assert_eq!(spikes(1, &[(place, 12.0 * sign)]), NONE, "{place}");
            assert_eq!(spikes(1, &[(place, 12.1 * sign)]), [place], "{place}");
        }
    }
}

/// Found here: a spike among the first four counts took all those before it along, which at 400 Hz made the window invalid.
#[test]
fn a_spike_near_an_end_is_the_only_one() {
    for run in [1, 2] {
        for place in 0..=16 - run {
            let wrong: Vec<usize> = (place..place + run).collect();
            let changed: Vec<(usize, f64)> = wrong.iter().map(|&n| (n, 500.0)).collect();
            assert_eq!(spikes(run, &changed), wrong);
        }
    }
}

#[test]
fn two_counts_in_a_row_are_a_run_of_spikes() {
    // The second of them is further from the line before it, and the first from the one behind.
    for (changed, expected) in [
        ([(7, 20.1), (8, 20.1)], &[7, 8][..]),
        ([(7, 20.1), (8, 19.9)], &[]),
        ([(7, 19.9), (8, 20.1)], &[]),
        ([(7, -20.1), (8, -20.1)], &[7, 8]),
        ([(7, 20.1), (8, -20.1)], &[7, 8]),
        ([(14, 12.1), (15, 20.1)], &[14, 15]),
        ([(0, 20.1), (1, 12.1)], &[0, 1]),
    ] {
        assert_eq!(spikes(2, &changed), expected, "{changed:?}");
    }
}

#[test]
fn a_kink_and_a_step_are_no_spikes() {
    for slope in [30.0, -30.0] {
        let kink: Vec<f64> = (0..10).map(|n| slope * f64::from(n - 5).max(0.0)).collect();
        let step: Vec<f64> = (0..10).map(|n| slope * f64::from(n / 5)).collect();
        for run in [1, 2] {
            assert_eq!(off_both_lines(&points(&kink), run, &LIMITS), NONE);
            assert_eq!(off_both_lines(&points(&step), run, &LIMITS), NONE);
        }
    }
}

#[test]
fn the_neighbours_of_a_spike_are_judged_without_it() {
    // The line before the last count would go through the spike.
    assert_eq!(spikes(1, &[(13, 500.0)]), [13]);
    assert_eq!(spikes(1, &[(14, 500.0)]), [14]);
    assert_eq!(spikes(2, &[(12, 500.0), (13, 500.0)]), [12, 13]);
    assert_eq!(spikes(2, &[(13, 500.0), (14, 500.0)]), [13, 14]);
    // Another spike three places on is seen in the same pass.
    assert_eq!(spikes(1, &[(5, 500.0), (8, 500.0)]), [5, 8]);
    let pairs = [(5, 500.0), (6, 500.0), (9, 500.0), (10, 500.0)];
    assert_eq!(spikes(2, &pairs), [5, 6, 9, 10]);
}

#[test]
fn too_few_counts_have_no_spikes() {
    assert_eq!(off_both_lines(&points(&[0.0, 500.0]), 1, &LIMITS), NONE);
    assert_eq!(off_both_lines(&points(&[0.0]), 1, &LIMITS), NONE);
    assert_eq!(off_both_lines(&[], 2, &LIMITS), NONE);
    assert_eq!(off_both_lines(&points(&[0.0, 0.0, 500.0]), 1, &LIMITS), [2]);
}

#[test]
fn where_instants_jitter_the_faster_of_two_lines_says_by_how_much() {
    // 80 counts a period on one side: 40 more are allowed, from both lines.
    for slope in [-80.0, 80.0] {
        for behind in [false, true] {
            let found = |by: f64| {
                let turned = |n: i32| slope * f64::from(if behind { n.max(0) } else { n.min(0) });
                let count = |n: i32| if n == 0 { by } else { turned(n) };
                let counts: Vec<f64> = (-6..=6).map(count).collect();
                off_both_lines(&points(&counts), 1, &JITTERING)
            };
            assert_eq!((found(51.0), found(53.0)), (vec![], vec![6]), "{slope}, {behind}");
        }
    }
}

// Counts that are too fast.

#[test]
fn a_count_out_of_reach_is_a_spike_and_one_within_it_is_none() {
    let found = |counts: &[f64]| too_fast(&points(counts), &LIMITS);
    for sign in [1.0, -1.0] {
        assert_eq!(found(&[0.0, 0.0, sign * 108.0, 0.0, 0.0]), Ok(vec![]));
        assert_eq!(found(&[0.0, 0.0, sign * 108.1, 0.0, 0.0]), Ok(vec![2]));
    }
    // Each further period adds its reach.
    let with_gap = |count: f64| too_fast(&[at(0, 0.0), at(1, 0.0), at(4, count), at(5, count)], &LIMITS);
    assert_eq!(with_gap(308.0), Ok(vec![]));
    assert_eq!(with_gap(308.1), Ok(vec![4]), "the next has one period more");
}

#[test]
fn two_counts_that_agree_with_each_other_alone_are_a_jump() {
    let found = |counts: &[f64]| too_fast(&points(counts), &LIMITS);
    assert_eq!(found(&[0.0, 0.0, 0.0, 500.0, 550.0, 600.0]), Err(3));
    // Two that do not agree, and two with a good one between them, are spikes.
    assert_eq!(found(&[0.0, 0.0, 500.0, -500.0, 0.0]), Ok(vec![2, 3]));
    assert_eq!(found(&[0.0, 0.0, 500.0, 0.0, 500.0, 0.0]), Ok(vec![2, 4]));
}

#[test]
fn at_the_very_beginning_one_count_is_against_two() {
    let found = |counts: &[f64]| too_fast(&points(counts), &LIMITS);
    assert_eq!(found(&[500.0, 0.0, 0.0, 0.0]), Ok(vec![0]));
    assert_eq!(found(&[0.0, 500.0, 0.0, 0.0]), Ok(vec![1]));
    // The second and the third agree, and the first with the third: the second is too fast.
    assert_eq!(found(&[0.0, 150.0, 200.0, 250.0]), Ok(vec![1]));
    // No two of three agree: the first is as good as any.
    assert_eq!(found(&[0.0, 500.0, 1000.0, 50.0]), Ok(vec![1, 2]));
    assert_eq!(found(&[500.0, 0.0]), Ok(vec![]), "nobody decides");
}

// A pulse of speed.

#[test]
fn an_interval_whose_speed_stands_out_on_both_sides_is_a_jump() {
    for sign in [1.0, -1.0] {
        let step = |height: f64| -> Vec<f64> {
            (0..10)
                .map(|n| sign * (5.0 * f64::from(n) + if n < 6 { 0.0 } else { height }))
                .collect()
        };
        assert_eq!(pulse_of_speed(&points(&step(12.0)), &LIMITS), None);
        assert_eq!(pulse_of_speed(&points(&step(12.1)), &LIMITS), Some(6));
        let kink: Vec<f64> = (0..10).map(|n| sign * 40.0 * f64::from(n - 5).max(0.0)).collect();
        assert_eq!(pulse_of_speed(&points(&kink), &LIMITS), None);
    }
}

#[test]
fn where_instants_jitter_a_pulse_must_stand_out_from_the_faster_side() {
    let fast_before = |height: f64| [-80.0, 0.0, height, height];
    let fast_behind = |height: f64| [0.0, 0.0, height, height + 80.0];
    // 40 counts for the jitter, 12 without, and the kink of 80 counts on one side.
    assert_eq!(pulse_of_speed(&points(&fast_before(131.0)), &JITTERING), None);
    assert_eq!(pulse_of_speed(&points(&fast_before(133.0)), &JITTERING), Some(2));
    assert_eq!(pulse_of_speed(&points(&fast_behind(131.0)), &JITTERING), None);
    assert_eq!(pulse_of_speed(&points(&fast_behind(133.0)), &JITTERING), Some(2));
}

// In slots.

#[test]
fn spikes_are_refused_in_their_part_alone_wherever_the_counter_stands() {
    for (part, defect) in [(Part::Motor, Defect::MotorSpike), (Part::Output, Defect::OutputSpike)] {
        for origin in [0, i64::MIN, i64::MAX - 100_000] {
            let limits = CounterLimits { part, defect, ..LIMITS };
            let mut slots = slots(60, |n, s| {
                let spike = match n {
                    0 | 20 | 24 | 26 | 59 => 40,
                    40 | 41 => 80,
                    50 => 20_000,
                    _ => 0,
                };
                let count = origin + 10 * n as i64 + spike;
                if part == Part::Motor {
                    s.motor_counts = count;
                } else {
                    s.output_counts = count;
                }
            });
            // What was refused before is no neighbour.
            slots[30].sample.motor_counts = 0;
            slots[30].sample.output_counts = 0;
            slots[30].refuse(part, Defect::Repeated);
            assert_eq!(refuse_spikes(&mut slots, &limits), None);
            assert_eq!(flawed_in(&slots, part), [0, 20, 24, 26, 30, 40, 41, 50, 59], "{part:?}");
            assert_eq!(slots[40].first_defect(), Some(defect));
            let other = if part == Part::Motor { Part::Output } else { Part::Motor };
            assert!(flawed_in(&slots, other).is_empty());
        }
    }
}

#[test]
fn a_counter_that_jumps_gives_the_place_behind_the_jump() {
    // Too far for any speed; and no further than the speed allows.
    for height in [5000, 60] {
        let mut slots = slots(60, |n, s| {
            s.motor_counts = 10 * n as i64 + if n < 33 { 0 } else { height }
        });
        assert_eq!(refuse_spikes(&mut slots, &LIMITS), Some(33), "{height}");
    }
}
