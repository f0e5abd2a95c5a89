//! What makes a window invalid or a handicap of it, at exactly its limits.

use super::super::bench_slots::{FIRST, limits, lose, slots};
use super::*;
use ema_models::SensedSample;

/// Counts of the motor while the output turns by one, on the bench: 65 536 · 100 / 20 000.
const MOTOR_PER_OUTPUT: f64 = 327.68;

// Flawed samples.

/// What is said of 1001 samples of which these are missing.
fn without(missing: impl Fn(usize) -> bool) -> Option<Invalidity> {
    let mut slots = slots(1001, |_, _| ());
    for n in (1..slots.len()).filter(|&n| missing(n)) {
        lose(&mut slots, n);
    }
    too_many_flawed(&slots, &limits(2000.0).lengths)
}

fn gap(count: usize, longest: usize) -> Option<Invalidity> {
    let defect = Defect::Missing;
    Some(Invalidity::TooManyFlawed { defect, count, longest })
}

#[test]
fn a_hundred_scattered_samples_may_lack_and_no_more() {
    assert_eq!(without(|n| n % 10 == 5), None);
    assert_eq!(without(|n| n % 10 == 5 || n == 777), gap(101, 1));
    // 33 runs of three are as scattered as single ones.
    assert_eq!(without(|n| n % 30 >= 10 && n % 30 < 13 && n < 990), None);
}

#[test]
fn twenty_samples_may_lack_where_more_than_three_are_in_a_row() {
    let five_runs = |n: usize| n % 100 < 4 && (100..600).contains(&n);
    assert_eq!(without(five_runs), None);
    assert_eq!(without(|n| five_runs(n) || n == 700), gap(21, 4));
}

#[test]
fn ten_samples_in_a_row_may_lack_wherever_they_lie() {
    for start in [1, 500, 990] {
        assert_eq!(without(|n| (start..start + 10).contains(&n)), None, "{start}");
        assert_eq!(without(|n| (start..start + 11).contains(&n)), gap(11, 11), "{start}");
    }
}

#[test]
fn the_most_frequent_defect_is_named_and_of_equal_ones_the_first() {
    for (clipped, spikes, expected) in [
        (60, 50, Defect::Clipped),
        (55, 55, Defect::Clipped),
        (50, 60, Defect::MotorSpike),
    ] {
        let mut slots = slots(1001, |_, _| ());
        for n in 0..clipped {
            slots[4 * n].refuse(Part::Currents, Defect::Clipped);
        }
        for n in 0..spikes {
            slots[4 * n + 2].refuse(Part::Motor, Defect::MotorSpike);
        }
        let found = too_many_flawed(&slots, &limits(2000.0).lengths);
        let flawed = |defect, count| {
            Some(Invalidity::TooManyFlawed {
                defect,
                count,
                longest: 1,
            })
        };
        assert_eq!(found, flawed(expected, 110));
    }
}

// The command in a gap.

/// What is said of a command, rad by the index, of which the samples in `gap` are missing.
fn command(gap: std::ops::Range<usize>, angle: impl Fn(usize) -> f64) -> Option<Invalidity> {
    let mut slots = slots(200, |n, s| s.setpoint = Setpoint::Position(angle(n)));
    gap.for_each(|n| lose(&mut slots, n));
    command_in_gap(&slots, &limits(2000.0).thresholds)
}

#[test]
fn a_command_that_moves_in_a_gap_by_more_than_the_threshold_is_found() {
    for sign in [1.0, -1.0] {
        for (step, expected) in [(1.0e-3, None), (1.1e-3, Some(Invalidity::CommandInGap { at: 101 }))] {
            // A gap of one sample, and of three.
            for start in [98, 100] {
                let found = command(start..101, |n| if n > start { sign * step } else { 0.0 });
                assert_eq!(found, expected, "{step}");
            }
        }
    }
}

#[test]
fn a_jump_between_two_samples_that_came_is_no_jump_in_a_gap() {
    assert_eq!(command(50..52, |n| if n < 100 { 0.0 } else { 1.0 }), None);
}

#[test]
fn a_twentieth_of_the_commands_range_may_move_in_a_gap() {
    // From -1 to 1: a tenth of a radian. Later steps are between samples that came.
    let large = |step: f64| {
        command(99..102, move |n| match n {
            0..100 => 0.0,
            100..150 => step,
            150..160 => -1.0,
            _ => 1.0,
        })
    };
    assert_eq!(large(0.1), None);
    assert_eq!(large(0.1001), Some(Invalidity::CommandInGap { at: 102 }));
    assert_eq!(large(-0.1), None);
    assert_eq!(large(-0.1001), Some(Invalidity::CommandInGap { at: 102 }));
}

#[test]
fn steps_beside_a_gap_explain_as_much_for_each_period_of_it() {
    let gap = Some(Invalidity::CommandInGap { at: 104 });
    for slope in [0.01, -0.01] {
        // Steady motion through the gap and beyond it, or up to its end, or from its begin: four periods.
        let through = |more: f64| command(101..104, move |n| slope * n as f64 + if n < 104 { 0.0 } else { more });
        let until = |more: f64| {
            command(101..104, move |n| {
                slope * (n as f64).min(104.0) + if n < 104 { 0.0 } else { more }
            })
        };
        let from = |more: f64| {
            command(101..104, move |n| {
                slope * (n as f64 - 100.0).max(0.0) + if n < 104 { 0.0 } else { more }
            })
        };
        // The range is 2, 1 and 1 rad, of which a twentieth comes on top.
        let more = slope.signum();
        assert_eq!((through(0.09 * more), through(0.11 * more)), (None, gap), "{slope}");
        assert_eq!((until(0.045 * more), until(0.06 * more)), (None, gap), "{slope}");
        assert_eq!((from(0.045 * more), from(0.06 * more)), (None, gap), "{slope}");
    }
}

#[test]
fn a_refused_setpoint_is_a_gap_in_the_command() {
    let mut slots = slots(50, |n, s| {
        s.setpoint = Setpoint::Position(if n < 20 { 0.0 } else { 0.1 })
    });
    slots[20].refuse(Part::Setpoint, Defect::CommandGlitch);
    let found = command_in_gap(&slots, &limits(2000.0).thresholds);
    assert_eq!(found, Some(Invalidity::CommandInGap { at: 21 }));
    slots[30].refuse(Part::Currents, Defect::Clipped);
    assert_eq!(command_in_gap(&slots[21..], &limits(2000.0).thresholds), None);
}

// The two counters.

#[test]
fn the_counters_may_differ_by_the_largest_play_either_way() {
    let limits = limits(2000.0);
    // Both turn by 300 000 counts of the motor, from anywhere; the output is ahead, then behind.
    let apart = |ahead: i64, behind: i64| {
        let slots = slots(500, |n, s| {
            let turned = 2.0 * n as f64;
            s.output_counts = -777 + turned as i64;
            s.motor_counts = 12_345 + (MOTOR_PER_OUTPUT * turned).round() as i64;
            s.output_counts += if n == 100 { ahead } else { 0 };
            s.output_counts -= if n == 200 { behind } else { 0 };
        });
        counters_disagree(&slots, &limits)
    };
    // Three times a hundred times 10^-4 rad, and eight counts: 103.5 counts.
    assert_eq!(apart(103, 0), None);
    assert_eq!(apart(0, 103), None);
    assert_eq!(apart(51, 52), None);
    for (ahead, behind) in [(104, 0), (0, 104), (52, 52)] {
        match apart(ahead, behind) {
            Some(Invalidity::CountersDisagree { range_rad }) => {
                let expected = 104.0 * core::f64::consts::TAU / 20_000.0;
                // A count of the motor is 10^-6 rad at the output.
                assert!((range_rad - expected).abs() < 2e-6, "{range_rad}");
            }
            other => panic!("{ahead}, {behind}: {other:?}"),
        }
    }
}

#[test]
fn counters_differ_by_exactly_the_play_and_are_compared_where_both_are_good() {
    let mut limits = limits(2000.0);
    limits.play_max_rad = 150.0 * limits.output_lsb;
    let mut slots = slots(20, |n, s| s.output_counts = if n == 10 { 150 } else { 0 });
    assert_eq!(counters_disagree(&slots, &limits), None);
    slots[10].sample.output_counts = 151;
    assert!(counters_disagree(&slots, &limits).is_some());
    for part in [Part::Motor, Part::Output] {
        let mut slots = slots.clone();
        slots[10].refuse(part, Defect::OutputSpike);
        assert_eq!(counters_disagree(&slots, &limits), None);
    }
}

// The start.

/// What is said of 100 samples whose motor swings by the counts up and down before the trigger, and whose command by the angle.
fn start(counts: i64, command_rad: f64) -> Option<Invalidity> {
    let slots = slots(100, |n, s| {
        let sign = [0, 1, -1][n % 3];
        s.motor_counts = 50_000 + if n < 40 { sign * counts } else { 9000 * n as i64 };
        s.setpoint = Setpoint::Position(0.2 + if n < 40 { sign as f64 * command_rad } else { n as f64 });
    });
    start_in_motion(&slots, &limits(2000.0))
}

#[test]
fn command_and_motor_that_both_move_before_the_trigger_are_a_start_in_motion() {
    // The command is held within 10^-5 rad, the motor within 0.1 rad: 1043.04 counts.
    assert_eq!(start(521, 1e-3), None);
    assert_eq!(start(522, 0.4e-5), None);
    match start(522, 0.6e-5) {
        Some(Invalidity::StartInMotion { turned_rad }) => {
            let expected = 1044.0 * core::f64::consts::TAU / 65_536.0;
            assert!((turned_rad - expected).abs() < 1e-12);
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn exactly_the_limits_of_a_start_are_rest() {
    let mut limits = limits(2000.0);
    limits.still_rad = 1000.0 * limits.rotor.motor_lsb;
    let held = limits.thresholds.held(Setpoint::Position(0.0));
    let start = |counts: i64, command: f64, limits: &Limits| {
        let slots = slots(100, |n, s| {
            s.motor_counts = if n == 20 { counts } else { 0 };
            s.setpoint = Setpoint::Position(if n == 20 { command } else { 0.0 });
        });
        start_in_motion(&slots, limits).is_some()
    };
    assert!(start(1001, 2.0 * held, &limits));
    assert!(!start(1000, 2.0 * held, &limits));
    assert!(!start(1001, held, &limits));
}

#[test]
fn what_was_refused_before_the_trigger_is_no_motion() {
    let limits = limits(2000.0);
    let mut slots = slots(100, |n, s| {
        s.motor_counts = if n == 20 { 2000 } else { 0 };
        s.setpoint = Setpoint::Position(if n == 10 { 0.1 } else { 0.0 });
    });
    assert!(start_in_motion(&slots, &limits).is_some());
    let mut refused = slots.clone();
    refused[20].refuse(Part::Motor, Defect::MotorSpike);
    assert_eq!(start_in_motion(&refused, &limits), None);
    slots[10].refuse(Part::Setpoint, Defect::CommandGlitch);
    assert_eq!(start_in_motion(&slots, &limits), None);
}

/// Handicap of a start at which the motor turns by `counts` a sample under this setpoint, rad/s.
fn unsteady(counts: i64, setpoint: Setpoint) -> Option<f64> {
    let slots = slots(100, |n, s| {
        s.motor_counts = -300 + counts * n as i64;
        s.setpoint = setpoint;
    });
    unsteady_start(&slots, &limits(2000.0))
}

#[test]
fn a_motor_that_turns_before_the_trigger_by_a_fifth_of_its_top_speed_is_unsteady() {
    // One count a sample is 0.1917 rad/s at 2 kHz; a fifth of the top speed is 40 rad/s.
    let rad_s = |counts: f64| counts * core::f64::consts::TAU / 65_536.0 * 2000.0;
    for sign in [1, -1] {
        assert_eq!(unsteady(208 * sign, Setpoint::Position(0.0)), None);
        let found = unsteady(209 * sign, Setpoint::Position(0.0)).expect("unsteady");
        assert!((found - rad_s(209.0 * sign as f64)).abs() < 1e-9, "{found}");
    }
}

#[test]
fn in_speed_mode_the_start_is_unsteady_by_its_distance_from_the_setpoint() {
    assert_eq!(unsteady(0, Setpoint::Speed(40.0)), None, "exactly a fifth is not more");
    assert_eq!(unsteady(0, Setpoint::Speed(50.0)), Some(-50.0));
    assert_eq!(unsteady(0, Setpoint::Speed(-50.0)), Some(50.0));
    let counts = (100.0 / (core::f64::consts::TAU / 65_536.0 * 2000.0)) as i64;
    assert_eq!(unsteady(counts, Setpoint::Speed(100.0)), None);
}

#[test]
fn the_speed_before_the_trigger_is_measured_between_the_outermost_good_samples() {
    let limits = limits(2000.0);
    let mut slots = slots(100, |n, s| {
        s.motor_counts = if n < 40 { 100 * n as i64 } else { 1_000_000 }
    });
    for bad in [0, 39] {
        slots[bad].sample.motor_counts = -50_000;
        assert!(unsteady_start(&slots, &limits).is_some());
        slots[bad].refuse(Part::Motor, Defect::MotorSpike);
    }
    assert_eq!(unsteady_start(&slots, &limits), None, "19 rad/s");
}

// Time.

/// Jumps of the clock and the rate by the stamps of `count` samples at 2 kHz, whose stamps are set.
fn clock_of(count: usize, stamp_ns: impl Fn(usize) -> u64) -> (u64, Option<f64>) {
    let mut slots = slots(count, |_, _| ());
    for (n, slot) in slots.iter_mut().enumerate() {
        slot.stamp_ns = stamp_ns(n);
    }
    rate_of(&slots, &limits(2000.0))
}

fn rate_of(slots: &[Slot], limits: &Limits) -> (u64, Option<f64>) {
    let (jumps, invalid) = clock(slots, limits);
    let rate = invalid.map(|invalid| match invalid {
        Invalidity::SampleRate { by_stamps_hz, .. } => by_stamps_hz,
        other => panic!("{other:?}"),
    });
    (jumps, rate)
}

#[test]
fn stamps_that_advance_by_a_tenth_and_50_ms_more_or_less_show_another_rate() {
    // Half a second by the counter, so a tenth of a second by the stamps.
    let at_period = |ns: u64| clock_of(1001, move |n| 7_000_000_000 + ns * n as u64);
    for right in [401_000, 500_000, 599_000] {
        assert_eq!(at_period(right), (0, None), "{right} ns");
    }
    for wrong in [399_000, 601_000] {
        let (jumps, rate) = at_period(wrong);
        assert_eq!(jumps, 0);
        let rate = rate.expect("another rate");
        assert!((rate - 1e9 / wrong as f64).abs() < 1e-3, "{rate} Hz, {wrong} ns");
    }
}

#[test]
fn a_tenth_of_a_second_is_too_short_to_show_a_rate() {
    let (short, long) = (
        clock_of(191, |n| 1_000_000 * n as u64),
        clock_of(211, |n| 1_000_000 * n as u64),
    );
    assert_eq!((short.1, long.1.map(f64::round)), (None, Some(1000.0)));
}

#[test]
fn stamps_that_stand_still_or_go_back_show_no_rate() {
    assert_eq!(clock_of(1001, |_| 5), (0, None));
    assert_eq!(clock_of(1001, |n| 9_000_000_000 - 10_000 * n as u64), (0, None));
}

#[test]
fn a_rate_that_is_confirmed_is_not_doubted() {
    let mut limits = limits(2000.0);
    let mut slots = slots(1001, |_, _| ());
    for (n, slot) in slots.iter_mut().enumerate() {
        slot.stamp_ns = 1_000_000 * n as u64;
    }
    assert!(rate_of(&slots, &limits).1.is_some());
    limits.rate_is_unconfirmed = false;
    assert_eq!(rate_of(&slots, &limits), (0, None));
}

#[test]
fn more_jumps_than_one_in_ten_intervals_leave_no_rate() {
    // The clock jumps by a second; between jumps it runs twice as slowly as the counter.
    let with_jumps = |jumps: u64| {
        clock_of(1001, move |n| {
            1_000_000 * n as u64 + 1_000_000_000 * (n as u64).min(jumps)
        })
    };
    let (jumps, rate) = with_jumps(100);
    assert_eq!((jumps, rate.map(f64::round)), (100, Some(1000.0)));
    assert_eq!(with_jumps(101), (101, None));
}

#[test]
fn a_stamp_is_a_jump_from_50_ms_beside_the_counter() {
    // One interval is half a millisecond long.
    let one = |ns: i64| {
        clock_of(10, move |n| {
            (5_000_000_000 + 500_000 * n as i64 + if n < 5 { 0 } else { ns }) as u64
        })
    };
    assert_eq!([one(49_900_000).0, one(-49_900_000).0], [0, 0]);
    assert_eq!([one(50_100_000).0, one(-50_100_000).0], [1, 1]);
}

#[test]
fn exactly_the_limits_of_the_clock_show_nothing() {
    // One sample in so many came, at 2 kHz or 400 Hz, and its stamps advance by so much: all of these sums are exact.
    let found = |rate: f64, one_in: usize, intervals: usize, ns: u64| {
        let mut slots = slots(intervals * one_in + 1, |_, _| ());
        for n in 1..slots.len() {
            if n % one_in == 0 {
                slots[n].stamp_ns = slots[0].stamp_ns + ns * (n / one_in) as u64;
            } else {
                lose(&mut slots, n);
            }
        }
        rate_of(&slots, &limits(rate))
    };
    // 50 ms beside the counter are no jump.
    assert_eq!(found(2000.0, 1, 1, 50_500_000), (0, None));
    // A tenth of a second is too short to show a rate.
    assert_eq!(found(2000.0, 50, 4, 50_000_000), (0, None));
    // 160 ms by the counter, 66 ms more by the stamps.
    assert_eq!(found(400.0, 4, 16, 14_125_000), (0, None));
    assert!(found(400.0, 4, 16, 14_126_000).1.is_some());
}

#[test]
fn time_goes_on_through_samples_that_did_not_come() {
    let limits = limits(2000.0);
    let mut slots = slots(1001, |_, _| ());
    for n in (1..1000).filter(|n| n % 3 != 0) {
        lose(&mut slots, n);
    }
    assert_eq!(rate_of(&slots, &limits), (0, None));
    // A gap of 200 ms, as the stamps say, too.
    (300..700).for_each(|n| lose(&mut slots, n));
    assert_eq!(rate_of(&slots, &limits), (0, None));
}

// All together.

/// An actuation that nothing is said about: the motor moves from the trigger on.
fn good(n: usize, s: &mut SensedSample) {
    let moved = n.saturating_sub(40);
    s.setpoint = Setpoint::Position(if n < 40 { 0.0 } else { 0.25 });
    s.motor_counts = (200 * moved) as i64;
    s.output_counts = (200.0 * moved as f64 / MOTOR_PER_OUTPUT) as i64;
    let i = 1e-3 * n as f64;
    s.currents = [1.0 + i, -1.0 - 2.0 * i, i];
}

#[test]
fn what_is_missing_refused_and_sent_again_is_counted_each_for_itself() {
    let limits = limits(2000.0);
    let mut all = slots(1001, good);
    for lost in [300, 500] {
        lose(&mut all, lost);
    }
    for refused in [400, 450, 600] {
        all[refused].sample.currents[0] = f64::NAN;
    }
    all[450].sample.motor_counts += 30_000;
    all[700].sample = SensedSample {
        seq: FIRST + 700,
        ..all[699].sample
    };
    let found = examine(&mut all, &limits);
    let expected = Findings {
        lost: 2,
        rejected: 4,
        repeated: 1,
        clock_jumps: 0,
        unsteady_rad_s: None,
        time_jitter: None,
        invalid: None,
    };
    assert_eq!(found, expected);
    assert_eq!(
        found.degradations(true, Some(900)),
        [
            Degradation::Filled { lost: 2, rejected: 4 },
            Degradation::Repeated(1),
            Degradation::AnotherActuation { at: 900 },
        ]
    );
    assert!(
        examine(&mut slots(1001, good), &limits)
            .degradations(false, None)
            .is_empty()
    );
}

#[test]
fn counts_of_instants_that_jitter_are_no_spikes() {
    // A motor that turns by 2000 counts a sample, taken early and late by a fifth of a period in turn: without jitter the bench
    // allows 83 counts.
    let taken = |off: f64| {
        let mut slots = slots(1001, |n, s| {
            good(n, s);
            let t = n as f64 + if n % 2 == 0 { off } else { -off };
            s.motor_counts = (2000.0 * t) as i64;
            s.output_counts = (2000.0 * t / MOTOR_PER_OUTPUT) as i64;
        });
        examine(&mut slots, &limits(2000.0)).rejected
    };
    assert_eq!((taken(0.0), taken(0.2)), (0, 0));
    // A glitch does not show in the median, and stands out.
    let mut slots = slots(1001, good);
    slots[600].sample.motor_counts += 400;
    assert_eq!(examine(&mut slots, &limits(2000.0)).rejected, 1);
}

#[test]
fn samples_numbered_by_time_say_by_how_much_it_jitters() {
    let mut limits = limits(2000.0);
    limits.is_numbered_by_time = true;
    let mut slots = slots(1001, good);
    for slot in slots.iter_mut().skip(1).step_by(2) {
        slot.stamp_ns += 100_000;
    }
    let found = examine(&mut slots, &limits);
    let jitter = found.time_jitter.expect("numbered by time");
    // Half of them are late by a fifth of a period.
    assert!((jitter - 0.1).abs() < 1e-3, "{jitter}");
    assert_eq!(
        found.degradations(false, None),
        [Degradation::TimeJitter { of_period: jitter }]
    );
}

#[test]
fn an_angle_that_seems_to_jump_where_time_jitters_is_put_down_to_it() {
    let mut limits = limits(2000.0);
    limits.is_numbered_by_time = true;
    let found = |late_ns: u64| {
        let mut slots = slots(1001, good);
        for slot in slots.iter_mut().skip(600) {
            slot.sample.motor_counts += 5000;
        }
        for slot in slots.iter_mut().skip(1).step_by(2) {
            slot.stamp_ns += late_ns;
        }
        examine(&mut slots, &limits).invalid
    };
    assert!(
        matches!(found(100_000), Some(Invalidity::CounterJumped { .. })),
        "{:?}",
        found(100_000)
    );
    let jitter = found(200_000);
    assert!(
        matches!(jitter, Some(Invalidity::TimeJitter { of_period }) if (of_period - 0.2).abs() < 1e-3),
        "{jitter:?}"
    );
}

#[test]
fn only_what_follows_from_misplaced_samples_is_put_down_to_jitter_and_only_to_much_of_it() {
    let flawed = |defect| Invalidity::TooManyFlawed {
        defect,
        count: 30,
        longest: 2,
    };
    let counter = Counter::Motor;
    for (why, is_by_places) in [
        (Invalidity::CommandInGap { at: 7 }, true),
        (Invalidity::CounterJumped { counter, at: 7 }, true),
        (flawed(Defect::Missing), true),
        (flawed(Defect::MotorSpike), true),
        (flawed(Defect::OutputSpike), true),
        (flawed(Defect::CurrentSum), false),
        (flawed(Defect::Repeated), false),
        (Invalidity::Stuck(Signal::Motor), false),
        (Invalidity::CountersDisagree { range_rad: 0.5 }, false),
    ] {
        for (jitter, is_much) in [(None, false), (Some(0.15), false), (Some(0.16), true)] {
            let expected = match jitter {
                Some(of_period) if is_by_places && is_much => Invalidity::TimeJitter { of_period },
                _ => why,
            };
            assert_eq!(or_time_jitter(why, jitter), expected, "{why}, {jitter:?}");
        }
    }
}

#[test]
fn of_several_reasons_the_first_in_the_order_of_the_page_is_given() {
    let limits = limits(2000.0);
    type Change = fn(usize, &mut SensedSample);
    let found = |changes: &[Change]| {
        let mut slots = slots(1001, |n, s| {
            good(n, s);
            changes.iter().for_each(|change| change(n, s));
        });
        examine(&mut slots, &limits).invalid
    };
    let in_motion: Change = |n, s| {
        if n < 40 {
            s.setpoint = Setpoint::Position(1e-3 * (n % 2) as f64);
            s.motor_counts = 40 * n as i64;
        } else {
            s.motor_counts += 1600;
        }
    };
    let apart: Change = |n, s| s.output_counts += n as i64 / 8;
    let jump: Change = |n, s| s.motor_counts += if n < 500 { 0 } else { 10_000 };
    let stuck: Change = |n, s| {
        if (600..700).contains(&n) {
            s.currents = [2.0, -1.0, -1.0];
        }
    };
    let flawed: Change = |n, s| {
        if (800..811).contains(&n) {
            s.currents[0] = f64::NAN;
        }
    };
    assert_eq!(found(&[]), None);
    assert!(matches!(found(&[in_motion]), Some(Invalidity::StartInMotion { .. })));
    assert!(matches!(
        found(&[in_motion, apart]),
        Some(Invalidity::CountersDisagree { .. })
    ));
    let counter = Counter::Motor;
    assert_eq!(
        found(&[in_motion, apart, jump]),
        Some(Invalidity::CounterJumped { counter, at: 500 })
    );
    assert_eq!(
        found(&[in_motion, apart, jump, stuck]),
        Some(Invalidity::Stuck(Signal::Currents))
    );
    let (defect, count, longest) = (Defect::NotFinite, 11, 11);
    assert_eq!(
        found(&[in_motion, apart, jump, stuck, flawed]),
        Some(Invalidity::TooManyFlawed { defect, count, longest })
    );
}
