//! A counter that is slower than the samples: it stands for several of them, then has moved by all that it turned meanwhile.

use super::quality::{Counter, Defect, Invalidity, Signal};
use super::ring::Slot;

/// Counts by which a counter that is read with each sample does not move after it stood: a slow one moves by one, noise by two.
const MOVED_COUNTS: u64 = 2;

/// Fewest moves that show how long it stands between them, and the share of them that does.
const MOVES_MIN: usize = 6;
const ALIKE_SHARE: f64 = 0.8;

/// Samples for which a counter stands at a time, 2 or more.
fn held_for(slots: &[Slot], counter: Counter) -> Option<usize> {
    let (mut intervals, mut moved_last, mut before) = (Vec::new(), None, None::<(u64, i64)>);
    for slot in slots.iter().filter(|slot| slot.was_received()) {
        let sample = &slot.sample;
        let counts = match counter {
            Counter::Motor => sample.motor_counts,
            Counter::Output => sample.output_counts,
        };
        if let Some((seq, last)) = before
            && counts.abs_diff(last) > MOVED_COUNTS
            && sample.seq.checked_sub(1) == Some(seq)
        {
            let since = moved_last.replace(sample.seq);
            intervals.extend(since.map(|since| sample.seq - since));
        }
        before = Some((sample.seq, counts));
    }
    if intervals.len() < MOVES_MIN {
        return None;
    }
    intervals.sort_unstable();
    let usual = intervals[intervals.len() / 2];
    let alike = intervals
        .iter()
        .filter(|interval| (2.max(usual - 1)..=usual + 1).contains(*interval));
    (usual >= 2 && alike.count() as f64 >= ALIKE_SHARE * intervals.len() as f64).then_some(usual as usize)
}

/// What makes a window invalid, or the counter that is slower than the samples where that is what it looks like.
pub(super) fn or_held(slots: &[Slot], why: Invalidity) -> Invalidity {
    let suspected: &[Counter] = match why {
        Invalidity::CounterJumped {
            counter: Counter::Motor,
            ..
        }
        | Invalidity::Stuck(Signal::Motor)
        | Invalidity::TooManyFlawed {
            defect: Defect::MotorSpike,
            ..
        } => &[Counter::Motor],
        Invalidity::CounterJumped {
            counter: Counter::Output,
            ..
        }
        | Invalidity::Stuck(Signal::Output)
        | Invalidity::TooManyFlawed {
            defect: Defect::OutputSpike,
            ..
        } => &[Counter::Output],
        // An angle that lags by what it stands.
        Invalidity::CountersDisagree { .. } => &[Counter::Motor, Counter::Output],
        _ => &[],
    };
    let mut held = suspected
        .iter()
        .filter_map(|&counter| Some((counter, held_for(slots, counter)?)));
    held.next()
        .map_or(why, |(counter, samples)| Invalidity::Held { counter, samples })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::window::bench_slots::slots;

    /// Of a motor that accelerates, with an encoder that is read with every so many samples.
    fn held(every: usize) -> Option<usize> {
        let window = slots(400, |n, sample| {
            let read = n - n % every;
            sample.motor_counts = 100 * n as i64;
            sample.output_counts = (read * read / 40) as i64;
        });
        let jump = Invalidity::CounterJumped {
            counter: Counter::Output,
            at: 80,
        };
        match or_held(&window, jump) {
            Invalidity::Held {
                counter: Counter::Output,
                samples,
            } => Some(samples),
            _ => None,
        }
    }

    #[test]
    fn an_angle_that_stands_for_several_samples_at_a_time_is_held() {
        assert_eq!(held(10), Some(10));
        assert_eq!(held(40), Some(40));
        assert_eq!(held(2), Some(2));
    }

    #[test]
    fn an_angle_of_every_sample_is_not_held() {
        assert_eq!(held(1), None);
    }

    /// Samples of an encoder that moves by `counts` at these places.
    fn moving_at(moves: &[usize], counts: i64) -> Vec<Slot> {
        slots(400, |n, sample| {
            sample.output_counts = counts * moves.iter().filter(|&&at| at <= n).count() as i64;
        })
    }

    /// So many moves, ten samples apart.
    fn tenths(moves: usize) -> Vec<usize> {
        (1..=moves).map(|n| 10 * n).collect()
    }

    #[test]
    fn seven_moves_of_more_than_two_counts_show_that_a_counter_stands_between_them() {
        let of = |moves: usize, counts| held_for(&moving_at(&tenths(moves), counts), Counter::Output);
        for sign in [1, -1] {
            assert_eq!(of(7, 3 * sign), Some(10));
            assert_eq!(of(7, 2 * sign), None, "noise");
            assert_eq!(of(6, 3 * sign), None);
        }
    }

    #[test]
    fn four_in_five_intervals_are_as_long_as_the_usual_one_to_a_sample() {
        let of = |intervals: [usize; 10]| {
            let moves = intervals.iter().scan(5, |at, interval| {
                *at += interval;
                Some(*at)
            });
            let moves: Vec<usize> = [5].into_iter().chain(moves).collect();
            held_for(&moving_at(&moves, 9), Counter::Output)
        };
        assert_eq!(of([10, 10, 10, 10, 9, 11, 10, 10, 30, 3]), Some(10));
        assert_eq!(of([10, 10, 10, 10, 9, 12, 10, 10, 30, 3]), None);
        assert_eq!(of([10, 10, 10, 10, 8, 11, 10, 10, 30, 3]), None);
        // A counter that moves with each sample does not stand.
        assert_eq!(of([2, 2, 2, 2, 2, 2, 3, 3, 1, 1]), Some(2));
        assert_eq!(of([2, 2, 2, 2, 2, 3, 3, 1, 1, 1]), None);
        assert_eq!(of([1, 1, 1, 1, 1, 1, 2, 2, 2, 2]), None);
    }

    #[test]
    fn a_move_behind_a_sample_that_did_not_come_has_no_place() {
        let mut window = moving_at(&tenths(7), 9);
        assert_eq!(held_for(&window, Counter::Output), Some(10));
        crate::window::bench_slots::lose(&mut window, 39);
        assert_eq!(held_for(&window, Counter::Output), None, "five intervals are left");
    }

    #[test]
    fn only_the_counter_that_a_reason_is_about_can_be_what_is_held() {
        let flawed = |defect| Invalidity::TooManyFlawed {
            defect,
            count: 30,
            longest: 2,
        };
        let jumped = |counter| Invalidity::CounterJumped { counter, at: 80 };
        let disagree = Invalidity::CountersDisagree { range_rad: 0.5 };
        let (motor, output) = (Counter::Motor, Counter::Output);
        for (why, suspected) in [
            (jumped(motor), &[motor][..]),
            (Invalidity::Stuck(Signal::Motor), &[motor]),
            (flawed(Defect::MotorSpike), &[motor]),
            (jumped(output), &[output]),
            (Invalidity::Stuck(Signal::Output), &[output]),
            (flawed(Defect::OutputSpike), &[output]),
            (disagree, &[motor, output]),
            (flawed(Defect::Missing), &[]),
            (Invalidity::Stuck(Signal::Currents), &[]),
            (Invalidity::ModeChanged, &[]),
        ] {
            for counter in [motor, output] {
                let window = slots(400, |n, sample| match counter {
                    Counter::Motor => sample.motor_counts = 90 * (n / 10) as i64,
                    Counter::Output => sample.output_counts = 90 * (n / 10) as i64,
                });
                let expected = if suspected.contains(&counter) {
                    Invalidity::Held { counter, samples: 10 }
                } else {
                    why
                };
                assert_eq!(or_held(&window, why), expected, "{why}, {counter:?}");
            }
        }
    }
}
