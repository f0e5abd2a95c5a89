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
}
