//! Currents that no converter reads, samples sent again, and signals that stand still.

use super::super::bench_slots::{flawed_in, limits, lose, slots};
use super::*;

fn defect_of(currents: [f64; 3]) -> Option<Defect> {
    current_defect(currents, &limits(2000.0))
}

#[test]
fn currents_are_refused_from_one_and_a_half_steps_below_full_scale() {
    // 16 A and 4096 steps: all of these are exact in binary.
    let step = 2.0_f64.powi(-7);
    for (largest, expected) in [
        (16.0 - 1.5 * step, None),
        (16.0 - step, Some(Defect::Clipped)),
        (16.0, Some(Defect::Clipped)),
        (16.0 + 1.5 * step, Some(Defect::Clipped)),
        (16.0 + 2.0 * step, Some(Defect::BeyondScale)),
    ] {
        for sign in [1.0, -1.0] {
            let half = -0.5 * sign * largest;
            for currents in [
                [sign * largest, half, half],
                [half, sign * largest, half],
                [half, half, sign * largest],
            ] {
                assert_eq!(defect_of(currents), expected, "{currents:?}");
            }
        }
    }
}

#[test]
fn a_quadrature_current_at_the_end_of_its_field_is_clipped_at_any_rotor_angle() {
    let limits = Limits {
        quadrature_max_a: Some(9.997),
        ..limits(2000.0)
    };
    for angle in [0.0_f64, 0.4, 2.0, 5.0] {
        let of = |quadrature: f64| {
            let phase = |n: f64| -quadrature * (angle - n * core::f64::consts::TAU / 3.0).sin();
            current_defect([0.0, 1.0, 2.0].map(phase), &limits)
        };
        assert_eq!(of(9.99), None, "{angle}");
        assert_eq!(
            (of(10.0), of(-10.0)),
            (Some(Defect::Clipped), Some(Defect::Clipped)),
            "{angle}"
        );
    }
}

#[test]
fn the_sum_of_the_currents_may_be_half_an_ampere_either_way() {
    for sign in [1.0, -1.0] {
        assert_eq!(defect_of([sign * 5.0, sign * -4.75, sign * 0.25]), None);
        assert_eq!(
            defect_of([sign * 5.0, sign * -4.75, sign * 0.26]),
            Some(Defect::CurrentSum)
        );
    }
}

#[test]
fn a_current_that_is_no_number_is_told_from_one_beyond_scale() {
    for current in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(defect_of([0.0, current, 0.0]), Some(Defect::NotFinite));
    }
}

#[test]
fn refused_currents_leave_the_counters_good() {
    let mut slots = slots(5, |n, s| s.currents[1] = if n == 3 { 9.0 } else { 0.0 });
    refuse_currents(&mut slots, &limits(2000.0));
    assert_eq!(flawed_in(&slots, Part::Currents), [3]);
    for part in [Part::Motor, Part::Output, Part::Setpoint] {
        assert!(flawed_in(&slots, part).is_empty());
    }
}

/// Eight samples of a motor that turns by `counts` a sample, in which each of `again` holds what the one before held.
fn sent_again(counts: i64, again: &[usize]) -> Vec<Slot> {
    slots(8, |n, s| {
        let held = if again.contains(&n) { n - 1 } else { n };
        s.motor_counts = counts * held as i64;
        s.currents = [0.1 * held as f64, -0.1 * held as f64, 0.0];
    })
}

fn repeated(mut slots: Vec<Slot>, limits: &Limits) -> Vec<usize> {
    refuse_repeated(&mut slots, limits);
    let found = flawed_in(&slots, Part::Currents);
    for part in [Part::Motor, Part::Output, Part::Setpoint] {
        assert_eq!(flawed_in(&slots, part), found, "all of the sample is refused");
    }
    assert!(found.iter().all(|&n| slots[n].first_defect() == Some(Defect::Repeated)));
    found
}

#[test]
fn a_sample_sent_again_while_the_motor_turned_is_refused_whole() {
    let limits = limits(2000.0);
    // 1 mrad of the motor is 10.4 counts.
    for (counts, expected) in [(10, &[][..]), (11, &[4][..]), (-11, &[4][..])] {
        assert_eq!(repeated(sent_again(counts, &[4]), &limits), expected, "{counts}");
    }
    // Neighbours on both sides show the motion, which the first two and the last have not.
    for (at, expected) in [(1, &[][..]), (2, &[2][..]), (6, &[6][..]), (7, &[][..])] {
        assert_eq!(repeated(sent_again(100, &[at]), &limits), expected, "{at}");
    }
    assert_eq!(repeated(sent_again(100, &[3, 5]), &limits), [3, 5]);
}

#[test]
fn of_a_coarse_resolver_more_than_four_counts_show_motion() {
    let mut limits = limits(2000.0);
    limits.rotor.motor_lsb = 0.01;
    for (counts, expected) in [(4, &[][..]), (5, &[4][..])] {
        assert_eq!(repeated(sent_again(counts, &[4]), &limits), expected, "{counts}");
    }
    // On both sides.
    for (before, after, expected) in [(4, 5, &[][..]), (5, 4, &[][..]), (5, 5, &[4][..])] {
        let slots = slots(8, |n, s| {
            s.motor_counts = if n < 3 {
                0
            } else {
                before + if n > 4 { after } else { 0 }
            }
        });
        assert_eq!(repeated(slots, &limits), expected, "{before} before, {after} after");
    }
}

#[test]
fn what_changed_or_stood_or_has_lost_neighbours_is_not_sent_again() {
    let limits = limits(2000.0);
    let mut changed = sent_again(100, &[4]);
    changed[4].sample.currents[2] = 1e-3;
    assert!(repeated(changed, &limits).is_empty(), "another current");
    let mut turned = sent_again(100, &[4]);
    turned[4].sample.motor_counts += 1;
    assert!(repeated(turned, &limits).is_empty(), "another count");
    // The motor stops with the sample before, or starts with the one after.
    let stops = slots(8, |n, s| s.motor_counts = 100 * (n as i64).min(3));
    assert!(repeated(stops, &limits).is_empty());
    let starts = slots(8, |n, s| s.motor_counts = 100 * (n as i64 - 4).max(0));
    assert!(repeated(starts, &limits).is_empty());
    for lost in 2..6 {
        let mut slots = sent_again(100, &[4]);
        lose(&mut slots, lost);
        refuse_repeated(&mut slots, &limits);
        assert_eq!(flawed_in(&slots, Part::Currents), [lost]);
    }
}

/// Limits with angles that are exact in binary: a count of either counter is 2^-12 rad, the gear 64 to 1, and the play 100
/// counts of the output.
fn exact() -> Limits {
    let mut limits = limits(2000.0);
    limits.rotor.motor_lsb = 2.0_f64.powi(-12);
    limits.output_lsb = 2.0_f64.powi(-12);
    limits.gear_ratio = 64.0;
    limits.play_max_rad = 100.0 * 2.0_f64.powi(-12);
    limits
}

/// Currents that change with every sample.
fn changing(n: usize) -> [f64; 3] {
    let i = 0.01 * n as f64;
    [i, -2.0 * i, i]
}

/// Sixty samples with signals of the index, as far as they do not stand still from 10 on for `standing` samples.
fn standing(standing: usize, change: impl Fn(usize, usize, &mut SensedSample)) -> Vec<Slot> {
    slots(60, |n, s| {
        let held = if (10..10 + standing).contains(&n) { 10 } else { n };
        change(n, held, s);
    })
}

#[test]
fn currents_are_stuck_after_20_ms_and_a_quarter_radian_of_the_motor() {
    // Within 40 samples the motor turns by this many counts, and then no further; 1024 are a quarter of a radian.
    let found = |still: usize, turned: i64| {
        let slots = standing(still, |n, held, s| {
            s.currents = changing(held);
            s.motor_counts = if n < 49 { 0 } else { turned };
            s.output_counts = n as i64 % 2;
        });
        stuck(&slots, &exact())
    };
    for (still, turned, expected) in [
        (39, 9000, None),
        (40, 1024, None),
        (40, 1025, Some(Signal::Currents)),
        (40, -1025, Some(Signal::Currents)),
    ] {
        assert_eq!(found(still, turned), expected, "{still} samples, {turned} counts");
    }
}

#[test]
fn a_quadrature_current_alone_is_stuck_after_200_ms() {
    let limits = Limits {
        is_quadrature_alone: true,
        ..exact()
    };
    for (still, expected) in [(399, None), (400, Some(Signal::Currents))] {
        let slots = slots(500, |n, s| {
            // The phases of 0 A have either sign.
            let rest = if n % 2 == 0 { 0.0 } else { -0.0 };
            s.currents = if (10..10 + still).contains(&n) {
                [0.0, rest, -rest]
            } else {
                changing(n)
            };
            s.motor_counts = 100 * n as i64;
            s.output_counts = n as i64 % 2;
        });
        assert_eq!(stuck(&slots, &limits), expected, "{still} samples");
        assert!(!one_current_stuck(&slots, &limits), "{still} samples");
    }
}

#[test]
fn the_resolver_is_stuck_while_the_output_leaves_the_play() {
    let found = |still: usize, moved: i64| {
        let slots = standing(still, |n, held, s| {
            s.currents = changing(n);
            s.motor_counts = held as i64;
            s.output_counts = if n < 49 { n as i64 % 2 } else { moved };
        });
        stuck(&slots, &exact())
    };
    for (still, moved, expected) in [
        (39, 900, None),
        (40, 100, None),
        (40, 101, Some(Signal::Motor)),
        (40, -101, Some(Signal::Motor)),
    ] {
        assert_eq!(found(still, moved), expected, "{still} samples, {moved} counts");
    }
}

#[test]
fn the_encoder_is_stuck_while_the_motor_turns_by_the_play_behind_the_gear() {
    let found = |still: usize, turned: i64| {
        let slots = standing(still, |n, held, s| {
            s.currents = changing(n);
            s.motor_counts = if n < 49 { n as i64 % 2 } else { turned };
            s.output_counts = held as i64;
        });
        stuck(&slots, &exact())
    };
    for (still, turned, expected) in [
        (39, 9000, None),
        (40, 6400, None),
        (40, 6401, Some(Signal::Output)),
        (40, -6401, Some(Signal::Output)),
    ] {
        assert_eq!(found(still, turned), expected, "{still} samples, {turned} counts");
    }
}

#[test]
fn samples_that_cannot_be_used_neither_prove_nor_end_that_a_signal_stands() {
    type Change = fn(usize, &mut SensedSample);
    let cases: [(Signal, [Part; 2], Change); 3] = [
        (Signal::Currents, [Part::Currents, Part::Motor], |n, s| {
            s.currents = [1.0, -1.0, 0.0];
            s.motor_counts = 200 * n as i64;
            s.output_counts = n as i64;
        }),
        (Signal::Motor, [Part::Motor, Part::Output], |n, s| {
            s.currents = changing(n);
            s.output_counts = 200 * n as i64;
        }),
        (Signal::Output, [Part::Motor, Part::Output], |n, s| {
            s.currents = changing(n);
            s.motor_counts = 200 * n as i64;
        }),
    ];
    for (signal, parts, change) in cases {
        for part in parts {
            // Of 42 samples, two are left out: 40 are enough, 39 are not.
            for (count, expected) in [(42, Some(signal)), (41, None)] {
                let mut slots = slots(count, change);
                for refused in [20, 30] {
                    slots[refused].sample.currents = [3.0, -3.0, 0.0];
                    slots[refused].sample.motor_counts = 5_000_000;
                    slots[refused].sample.output_counts = -5_000_000;
                    slots[refused].refuse(part, Defect::MotorSpike);
                }
                assert_eq!(stuck(&slots, &exact()), expected, "{signal} without {part:?}, {count}");
            }
        }
    }
}

#[test]
fn one_current_is_stuck_while_another_changes_and_the_motor_turns() {
    let found = |phase: usize, still: usize, turned: i64, others_change: bool| {
        let slots = standing(still, |n, held, s| {
            s.currents = changing(if others_change { n } else { held });
            s.currents[phase] = changing(held)[phase];
            s.motor_counts = 5000 + if n < 49 { 0 } else { turned };
        });
        one_current_stuck(&slots, &exact())
    };
    for phase in 0..3 {
        assert!(found(phase, 40, 1025, true), "{phase}");
        assert!(found(phase, 40, -1025, true), "{phase}");
        assert!(!found(phase, 39, 1025, true), "{phase}: shorter");
        assert!(!found(phase, 40, 1024, true), "{phase}: the motor turned less");
        assert!(!found(phase, 40, 1025, false), "{phase}: all of them stand");
    }
    // At the end of the converter's range it is refused as that.
    let limits = exact();
    let slots = standing(40, |n, _, s| {
        s.currents = changing(n);
        s.currents[0] = limits.full_scale_a;
        s.motor_counts = 5000 + if n < 49 { 0 } else { 1025 };
    });
    assert!(!one_current_stuck(&slots, &limits));
}

#[test]
fn one_stuck_current_is_found_though_its_samples_were_refused_but_not_by_what_never_came() {
    let turning = |n: usize, s: &mut SensedSample| {
        s.currents = changing(n + 1);
        s.currents[0] = 1.0;
        s.motor_counts = 200 * n as i64;
    };
    let mut all = slots(40, turning);
    for slot in &mut all {
        slot.refuse(Part::Currents, Defect::CurrentSum);
    }
    assert!(one_current_stuck(&all, &exact()));
    for lacks in [Part::Motor, Part::Currents] {
        let mut slots = all.clone();
        if lacks == Part::Motor {
            slots[20].refuse(Part::Motor, Defect::MotorSpike);
        } else {
            lose(&mut slots, 20);
        }
        assert!(!one_current_stuck(&slots, &exact()), "39 samples without {lacks:?}");
    }
    // A current that is no number is not stuck at it.
    let nan = slots(60, |n, s| {
        turning(n, s);
        s.currents[0] = f64::NAN;
    });
    assert!(!one_current_stuck(&nan, &exact()));
}

#[test]
fn an_actuator_at_rest_is_not_stuck_wherever_it_stands() {
    for turns in [-1000, 0, 1000] {
        let slots = slots(100, |_, s| {
            s.motor_counts = 65_536 * turns;
            s.output_counts = 200 * turns;
        });
        assert_eq!(stuck(&slots, &limits(2000.0)), None, "{turns} turns of the motor");
    }
}
