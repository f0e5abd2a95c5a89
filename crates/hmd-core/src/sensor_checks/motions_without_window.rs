//! Motion without a window, where nothing is commanded and motion itself begins one.
//!
//! Such a window begins where the motor stood. One that creeps until its actuation begins, as behind worn gears or with a weak controller,
//! gives none: each motion that begins so is counted here, and said.

use std::collections::VecDeque;

use ema_models::{ActuatorParams, SensedSample};

use super::moved::{MotionLimits, Moved};
use crate::counted::counted;

/// Travel within half the rest from which on the motor no longer creeps: in thresholds of the trigger, and in counts. That which begins a
/// window.
const FAST_THRESHOLDS: f64 = 0.1;
const FAST_COUNTS: f64 = 6.0;

/// Halves of the rest without that travel after which a motion is over, and another may begin: an oscillation turns back sooner.
const OVER: usize = 10;

/// Watches the samples of one actuator that lie in no window.
#[derive(Clone, Debug)]
pub struct MotionsWithoutWindow {
    limits: MotionLimits,
    fast_rad: f64,
    rest_ms: f64,
    /// Motor counts over half the rest, the oldest first.
    counts: VecDeque<i64>,
    half: usize,
    last_seq: Option<u64>,
    /// Samples since the motor was fast, or in a window.
    slow: usize,
    /// The motion that goes on.
    motion: Option<Moved>,
    number: u64,
}

impl MotionsWithoutWindow {
    /// For an actuator whose windows begin where it stood for half of `rest_ms` and then moves, with a threshold of `trigger_rad`.
    #[must_use]
    pub fn new(params: &ActuatorParams, trigger_rad: f64, rest_ms: f64) -> Self {
        let limits = MotionLimits::new(params, trigger_rad);
        let half = (0.5e-3 * rest_ms * params.sensors.sample_rate).ceil().max(1.0) as usize;
        Self {
            limits,
            fast_rad: (FAST_THRESHOLDS * trigger_rad).max(FAST_COUNTS * limits.rad_per_motor_count()),
            rest_ms,
            counts: VecDeque::with_capacity(half + 1),
            half,
            last_seq: None,
            slow: 0,
            motion: None,
            number: 0,
        }
    }

    /// Takes a sample; the sentence where it ends the first motion without a window.
    pub fn push(&mut self, seq: u64, sample: &SensedSample, is_in_window: bool) -> Option<String> {
        let last = self.last_seq.replace(seq);
        if last.is_none_or(|last| last.wrapping_add(1) != seq) {
            // What lies between is not known: a motion ends with what was seen of it, and another one begins after a rest.
            self.counts.clear();
            self.counts.push_back(sample.motor_counts);
            self.slow = 0;
            return self.end_motion();
        }
        if self.counts.len() > self.half {
            self.counts.pop_front();
        }
        self.counts.push_back(sample.motor_counts);
        if is_in_window {
            // The motion that began the window has hardly any travel yet.
            self.slow = 0;
            return self.end_motion();
        }
        let from = *self.counts.front().filter(|_| self.counts.len() > self.half)?;
        let travel_rad = from.abs_diff(sample.motor_counts) as f64 * self.limits.rad_per_motor_count();
        let is_fast = travel_rad > self.fast_rad;
        let slow_before = self.slow;
        self.slow = if is_fast { 0 } else { self.slow + 1 };
        let over = OVER * self.half;
        match &mut self.motion {
            // One that goes on behind a window is part of it.
            None if is_fast && slow_before >= over => self.motion = Some(Moved::since(from, self.limits)),
            None => {}
            Some(_) if self.slow > over => return self.end_motion(),
            Some(motion) => motion.push(sample),
        }
        None
    }

    /// End of the traffic: how many motions there were, where that was not said yet.
    pub fn finish(&mut self) -> Option<String> {
        let first = self.end_motion();
        let number = std::mem::take(&mut self.number);
        self.counts.clear();
        (self.last_seq, self.slow) = (None, 0);
        if number < 2 {
            return first;
        }
        let motions = counted(number, "motion", "motions");
        Some(format!("{motions} without a window: {}", self.why()))
    }

    fn end_motion(&mut self) -> Option<String> {
        let travel = self.motion.take().filter(Moved::is_motion)?.travel_rad();
        self.number += 1;
        (self.number == 1).then(|| format!("no window, while the output turned by {travel:.3} rad: {}", self.why()))
    }

    fn why(&self) -> String {
        let half = self.rest_ms / 2.0;
        format!("without set point one begins where the motor stood for {half} ms, and it did not")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ema_models::Setpoint;

    /// What is said of the counts of the motor at these samples, 1 ms apart, under this current; a window is open from `window` on for 480 ms.
    fn said(counts: impl Fn(u64) -> i64, current: f64, window: Option<u64>) -> Vec<String> {
        said_of((0..2000).map(|seq| (seq, counts(seq))), current, window)
    }

    /// The same of these samples alone.
    fn said_of(samples: impl Iterator<Item = (u64, i64)>, current: f64, window: Option<u64>) -> Vec<String> {
        let mut params = ActuatorParams::bench();
        params.sensors.sample_rate = 1000.0;
        let mut motions = MotionsWithoutWindow::new(&params, 1e-3, 20.0);
        let mut said = Vec::new();
        for (seq, motor_counts) in samples {
            let sample = SensedSample {
                seq,
                currents: [current, -current, 0.0],
                motor_counts,
                output_counts: 0,
                setpoint: Setpoint::Idle,
            };
            let is_in_window = window.is_some_and(|from| (from..from + 480).contains(&seq));
            said.extend(motions.push(seq, &sample, is_in_window));
        }
        said.extend(motions.finish());
        said
    }

    /// A creep of 5 counts in 1 ms, and from here on 500 ms of 500.
    fn creeps_and_moves(seq: u64, from: u64) -> i64 {
        (5 * seq + 495 * seq.saturating_sub(from).min(500)).cast_signed()
    }

    #[test]
    fn motion_that_a_creep_goes_before_is_said_once_and_counted() {
        let one = said(|seq| creeps_and_moves(seq, 500), 2.0, None);
        assert_eq!(one.len(), 1, "{one:?}");
        assert!(
            one[0].starts_with("no window, while the output turned by 0.2") && one[0].ends_with("and it did not"),
            "{one:?}"
        );
        let back_and_forth = |seq: u64| match seq {
            500..1500 => 2500 + 500 * ((seq - 500) % 200).min(200 - (seq - 500) % 200),
            _ => 5 * seq.min(500),
        };
        let back_and_forth = said(|seq| back_and_forth(seq).cast_signed(), 2.0, None);
        assert_eq!(back_and_forth.len(), 1, "{back_and_forth:?}");
        let two = said(
            |seq| creeps_and_moves(seq, 200) + creeps_and_moves(seq, 1200),
            2.0,
            None,
        );
        assert_eq!(two.len(), 2, "{two:?}");
        assert!(two[1].starts_with("2 motions without a window: "), "{two:?}");
    }

    #[test]
    fn a_motion_with_a_lost_sample_is_said_and_counted_once() {
        let counts = |seq| creeps_and_moves(seq, 200) + creeps_and_moves(seq, 1200);
        let samples = (0..2000).filter(|seq| ![400, 600, 1500].contains(seq));
        let two = said_of(samples.map(|seq| (seq, counts(seq))), 2.0, None);
        assert_eq!(two.len(), 2, "{two:?}");
        assert!(
            two[0].starts_with("no window, while") && two[1].starts_with("2 motions"),
            "{two:?}"
        );
    }

    #[test]
    fn creep_motion_in_a_window_and_what_goes_on_behind_it_is_none() {
        let none: [String; 0] = [];
        assert_eq!(said(|seq| 5 * seq.cast_signed(), 2.0, None), none, "a creep");
        assert_eq!(
            said(|seq| creeps_and_moves(seq, 500), 0.01, None),
            none,
            "turned by something else"
        );
        assert_eq!(said(|seq| creeps_and_moves(seq, 500), 2.0, Some(505)), none);
        assert_eq!(
            said(|seq| creeps_and_moves(seq, 500), 2.0, Some(300)),
            none,
            "it goes on"
        );
    }
}
