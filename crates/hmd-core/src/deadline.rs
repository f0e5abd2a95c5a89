//! A deadline for each window: how many monitor runs the time that is left allows.
//!
//! In: a [`Clock`], and for each window the end of its turn ([`end_of_turn`]). Out: grants ([`Allowance`]) by the time that runs took
//! so far on this computer ([`Pace`]), so that an assessment ends before its time instead of after it. Only a live run has one:
//! a replay repeats its grants, and needs no clock.

use std::time::Duration;

use ema_identify::effort::{Allowance, Effort, Request, Stage};

use crate::config::Config;

/// Time since any fixed instant; never goes back.
pub trait Clock {
    /// The time now.
    fn now(&self) -> Duration;

    /// Monitor runs were done; only a simulated clock goes on by that.
    fn worked(&self, _runs: u64) {}
}

/// The work that the assessment of one window may take.
pub struct TimeLimit<'a> {
    /// The deadline that bounds it, ms; of no meaning where everything is granted.
    pub deadline_ms: u32,
    /// Grants monitor runs.
    pub effort: Effort<'a>,
}

impl TimeLimit<'_> {
    /// As much as the search wants.
    #[must_use]
    pub fn none() -> Self {
        Self {
            deadline_ms: 0,
            effort: Effort::unlimited(),
        }
    }
}

/// How long things take on this computer; learnt from window to window. Longer times count at once, shorter ones by and by.
#[derive(Clone, Debug)]
pub struct Pace {
    /// Time of one run for each second of the window, by stage, s.
    run_s: [f64; Stage::COUNT],
    /// Time from the last run to the end of the assessment, s.
    rest_s: f64,
    /// Time from the end of an assessment to the beginning of the next, at most, s.
    between_s: f64,
}

/// Before anything was measured.
const RUN_S: [f64; Stage::COUNT] = [2e-4, 2e-4, 1e-2];
const REST_S: f64 = 5e-4;

/// Share of the difference by which a shorter time counts.
const FALL: f64 = 1.0 / 8.0;

/// The same where nothing was measured because no run was granted; else one disturbance would refuse all later windows.
const FALL_REFUSED: f64 = 1.0 / 128.0;

impl Default for Pace {
    fn default() -> Self {
        Self {
            run_s: RUN_S,
            rest_s: REST_S,
            between_s: 0.0,
        }
    }
}

fn follow(time: &mut f64, measured: f64) {
    *time = if measured > *time {
        measured
    } else {
        *time + FALL * (measured - *time)
    };
}

impl Pace {
    /// Time that passed between the end of an assessment and the beginning of the next, both being due.
    pub fn note_between(&mut self, took: Duration) {
        follow(&mut self.between_s, took.as_secs_f64());
    }
}

/// End of the turn of a window that is due at `due`, while others wait that are due at `others`, in their order: it leaves each
/// of them the same time, and the time between two windows. What a window leaves over is shared by the later ones.
#[must_use]
pub fn end_of_turn(now: Duration, due: Duration, others: impl IntoIterator<Item = Duration>, pace: &Pace) -> Duration {
    let shares = others.into_iter().zip(2u32..).map(|(due, turns)| {
        let share = due.saturating_sub(now) / turns;
        let between = Duration::from_secs_f64(pace.between_s).min(share / 2);
        now + share - between
    });
    shares.fold(due, Duration::min)
}

/// Turns of the windows of a live run, one after another.
pub struct Turns<'a, C> {
    clock: &'a C,
    deadline_ms: Option<u32>,
    pace: Pace,
    /// End of the last turn.
    ended: Option<Duration>,
}

impl<'a, C: Clock> Turns<'a, C> {
    /// With the deadline of a configuration, if it has one.
    pub fn new(config: &Config, clock: &'a C) -> Self {
        Self {
            clock,
            deadline_ms: config.identification().deadline_ms,
            pace: Pace::default(),
            ended: None,
        }
    }

    /// Whether each window has a turn of its own, by its deadline.
    #[must_use]
    pub fn are_limited(&self) -> bool {
        self.deadline_ms.is_some()
    }

    /// Measures how long the runs of a rehearsal take.
    pub fn measure<T>(&mut self, rehearse: impl FnOnce(&Effort<'_>) -> T) -> Option<T> {
        self.deadline_ms?;
        let mut deadline = Deadline::new(self.clock, Duration::MAX, &mut self.pace);
        Some(rehearse(&Effort::within(&mut deadline)))
    }

    /// Work between two windows has ended that is no part of either.
    pub fn resume(&mut self) {
        self.ended = None;
    }

    /// Assesses a window whose last sample arrived at `arrived`, while others wait that arrived at `waiting`, in their order.
    pub fn take<T>(
        &mut self,
        arrived: Duration,
        waiting: impl FnOnce() -> Vec<Duration>,
        assess: impl FnOnce(&TimeLimit<'_>) -> T,
    ) -> T {
        let Some(deadline_ms) = self.deadline_ms else {
            return assess(&TimeLimit::none());
        };
        let allowed = Duration::from_millis(deadline_ms.into());
        let now = self.clock.now();
        if let Some(ended) = self.ended.filter(|&ended| arrived <= ended) {
            self.pace.note_between(now - ended);
        }
        let others = waiting().into_iter().map(|arrived| arrived + allowed);
        let end = end_of_turn(now, arrived + allowed, others, &self.pace);
        let mut deadline = Deadline::new(self.clock, end, &mut self.pace);
        let done = assess(&TimeLimit {
            deadline_ms,
            effort: Effort::within(&mut deadline),
        });
        deadline.finish();
        self.ended = Some(self.clock.now());
        done
    }
}

/// Grants what the time until the end of a window's turn allows.
pub struct Deadline<'a, C> {
    clock: &'a C,
    end: Duration,
    pace: &'a mut Pace,
    /// When the last stage was granted or ended.
    last: Duration,
    refused: Option<Stage>,
}

impl<'a, C: Clock> Deadline<'a, C> {
    /// For an assessment that begins now.
    pub fn new(clock: &'a C, end: Duration, pace: &'a mut Pace) -> Self {
        Self {
            clock,
            end,
            pace,
            last: clock.now(),
            refused: None,
        }
    }

    /// The assessment has ended.
    pub fn finish(self) {
        let took = self.clock.now().saturating_sub(self.last);
        follow(&mut self.pace.rest_s, took.as_secs_f64());
        if let Some(stage) = self.refused {
            self.pace.run_s[stage as usize] *= 1.0 - FALL_REFUSED;
        }
    }
}

impl<C: Clock> Allowance for Deadline<'_, C> {
    fn grant(&mut self, request: &Request) -> u64 {
        let now = self.clock.now();
        let left = self.end.as_secs_f64() - now.as_secs_f64() - self.pace.rest_s;
        let time_of = |stage: Stage, runs: u64| self.pace.run_s[stage as usize] * request.window_s * runs as f64;
        let free = left - time_of(Stage::Conclusion, request.reserved);
        // A cast from what is negative or no number is zero.
        let runs = ((free / time_of(request.stage, 1)) as u64).min(request.runs);
        if runs == 0 && request.runs > 0 {
            self.refused = Some(request.stage);
        } else {
            self.last = now;
        }
        runs
    }

    fn ran(&mut self, stage: Stage, window_s: f64, runs: u64) {
        self.clock.worked(runs);
        let now = self.clock.now();
        let took = now.saturating_sub(std::mem::replace(&mut self.last, now));
        if runs > 0 && window_s > 0.0 {
            let measured = took.as_secs_f64() / (runs as f64 * window_s);
            follow(&mut self.pace.run_s[stage as usize], measured);
            self.refused = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    struct Simulated(Cell<Duration>);

    impl Clock for Simulated {
        fn now(&self) -> Duration {
            self.0.get()
        }
    }

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn waiting_windows_share_the_time_until_each_is_due() {
        let pace = Pace::default();
        let turn = |now: u32, due: u32, others: &[u32]| {
            end_of_turn(now * MS, due * MS, others.iter().map(|&other| other * MS), &pace)
        };
        assert_eq!(turn(0, 100, &[]), 100 * MS);
        assert_eq!(turn(0, 100, &[100, 100, 100]), 25 * MS);
        // The second leaves less than the first has by itself, the third does not matter.
        assert_eq!(turn(0, 100, &[120, 900]), 60 * MS);
        assert_eq!(turn(200, 100, &[150]), 100 * MS, "late already");
        let mut slow = Pace::default();
        slow.note_between(2 * MS);
        assert_eq!(end_of_turn(Duration::ZERO, 100 * MS, [100 * MS], &slow), 48 * MS);
    }

    #[test]
    fn as_many_runs_are_granted_as_the_time_left_allows() {
        let clock = Simulated(Cell::new(Duration::ZERO));
        let mut pace = Pace {
            rest_s: 0.0,
            ..Pace::default()
        };
        let mut deadline = Deadline::new(&clock, 10 * MS, &mut pace);
        let request = |runs, reserved| Request {
            stage: Stage::Search,
            window_s: 0.5,
            runs,
            reserved,
        };
        // One run takes 100 µs here.
        clock.0.set(2 * MS);
        deadline.ran(Stage::Search, 0.5, 20);
        deadline.ran(Stage::Conclusion, 0.5, 0);
        deadline.pace.run_s = [2e-4, 2e-4, 1e-2];
        assert_eq!(deadline.grant(&request(50, 0)), 50);
        assert!((79..=80).contains(&deadline.grant(&request(500, 0))));
        assert!((49..=50).contains(&deadline.grant(&request(500, 30))));
        clock.0.set(11 * MS);
        assert_eq!(deadline.grant(&request(500, 0)), 0);
        deadline.finish();
        assert!(pace.run_s[0] < 2e-4, "a refusal is tried again later");
        assert!((pace.rest_s - 9e-3).abs() < 1e-9);
    }

    #[test]
    fn a_longer_time_counts_at_once_and_a_shorter_one_by_and_by() {
        let mut time = 1.0;
        follow(&mut time, 3.0);
        assert!((time - 3.0).abs() < 1e-12);
        follow(&mut time, 1.0);
        assert!((time - 2.75).abs() < 1e-12);
    }
}
