//! Elapsed hours by the stamps of windows, where the wall clock steps.
//!
//! A battery that fails sets a clock back by years until somebody sets it; a wrong entry sets it ahead. Neither is time that passed.

use serde::{Deserialize, Serialize};

use super::UnitHistory;
use crate::rul::Prognosis;
use crate::sensor_health::SensorHealth;

/// A stamp that lies so far before the newest one, ns, shows that a clock was wrong. A smaller step back may be followed by one forth again.
const CLOCK_STEP_NS: u64 = 24 * 3_600_000_000_000;

/// A pause so many times as long as any before may be a step of the clock.
const LONG_PAUSE: u64 = 10;

/// Windows after a long pause until it counts as one.
const DOUBTED_WINDOWS: u32 = 24;

/// What is known of the clock.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub(super) struct ClockSteps {
    /// Longest pause between two windows that is not doubted, ns.
    longest_pause_ns: u64,
    /// The clock was set back, and has not come to where it was.
    behind: Option<Behind>,
    /// The clock may be ahead since a long pause.
    ahead: Option<Box<BeforePause>>,
}

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Behind {
    /// Stamp of the newest window before, UTC ns.
    newest_ns: u64,
    /// Hours counted since.
    counted_h: f64,
}

/// What was known before a long pause.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct BeforePause {
    last_ns: u64,
    pause_ns: u64,
    /// Windows since.
    windows: u32,
    hours: f64,
    prognosis: Prognosis,
    sensors: SensorHealth,
}

impl ClockSteps {
    pub(super) fn is_possible(&self) -> bool {
        self.behind
            .is_none_or(|behind| behind.counted_h.is_finite() && behind.counted_h >= 0.0)
            && self.ahead.as_ref().is_none_or(|before| {
                before.hours >= 0.0 && before.prognosis.is_possible() && before.sensors.is_possible()
            })
    }

    /// Forgets what was known before a long pause.
    pub(super) fn forget_before_pause(&mut self) {
        self.ahead = None;
    }

    /// The same with these damages at the end of life.
    pub(super) fn with_end_of_life(mut self, end_of_life: [f64; ema_models::FaultId::COUNT]) -> Self {
        if let Some(before) = self.ahead.take() {
            let prognosis = before.prognosis.with_end_of_life(end_of_life);
            self.ahead = Some(Box::new(BeforePause { prognosis, ..*before }));
        }
        self
    }
}

impl UnitHistory {
    /// Hours by the stamps from the window before to one of `now_ns`, UTC ns. What a clock that stepped back and forth again has passed is
    /// counted once. Where a clock comes back to soon after a pause that was longer than any other, it was ahead since: the hours, and what
    /// was learnt over them, are those of before.
    pub(super) fn elapsed_h(&mut self, now_ns: u64) -> f64 {
        let Some(last_ns) = self.last.map(|last| last.t_start_ns) else {
            return 0.0;
        };
        // A clock that was set meanwhile tells nothing of the time between.
        if is_set(last_ns) != is_set(now_ns) {
            return 0.0;
        }
        if steps_back(last_ns, now_ns) {
            return self.elapsed_behind_h(last_ns, now_ns);
        }
        let pause_ns = now_ns.saturating_sub(last_ns);
        if let Some(behind) = self.clock.behind.take_if(|behind| behind.newest_ns <= now_ns) {
            self.clock.ahead = None;
            return (hours(now_ns - behind.newest_ns) - behind.counted_h).max(0.0);
        }
        if let Some(behind) = &mut self.clock.behind {
            behind.counted_h += hours(pause_ns);
        }
        // A second pause of that length shows that such pauses occur.
        let doubted_ns = self.clock.ahead.as_ref().map_or(0, |before| before.pause_ns);
        self.clock.longest_pause_ns = self.clock.longest_pause_ns.max(pause_ns.min(doubted_ns));
        if pause_ns >= CLOCK_STEP_NS && pause_ns / LONG_PAUSE > self.clock.longest_pause_ns {
            self.clock.ahead = Some(Box::new(BeforePause {
                last_ns,
                pause_ns,
                windows: 0,
                hours: self.used.hours,
                prognosis: self.prognosis.clone(),
                sensors: self.sensors.clone(),
            }));
        } else {
            self.clock.longest_pause_ns = self.clock.longest_pause_ns.max(pause_ns);
        }
        if let Some(before) = &mut self.clock.ahead {
            before.windows += 1;
            if before.windows > DOUBTED_WINDOWS {
                self.clock.longest_pause_ns = self.clock.longest_pause_ns.max(before.pause_ns);
                self.clock.ahead = None;
            }
        }
        hours(pause_ns)
    }

    /// The same of a stamp so far before the newest one that a clock was wrong.
    fn elapsed_behind_h(&mut self, last_ns: u64, now_ns: u64) -> f64 {
        let step_h = hours(last_ns - now_ns);
        if let Some(before) = self.clock.ahead.take_if(|before| before.last_ns <= now_ns) {
            self.notices.push(format!(
                "the clock is {step_h:.0} h behind the newest window: it was ahead; elapsed hours and forecasts go on from {} windows before",
                before.windows
            ));
            self.used.hours = before.hours;
            self.prognosis = before.prognosis;
            self.sensors = before.sensors;
            return hours(now_ns - before.last_ns);
        }
        self.notices.push(format!(
            "the clock is {step_h:.0} h behind the newest window: elapsed hours count from here on, nothing for the step, nor for that \
             back to where it was"
        ));
        self.clock.behind.get_or_insert(Behind {
            newest_ns: last_ns,
            counted_h: 0.0,
        });
        0.0
    }

    /// The newest stamp after a window: a clock that is not set yet will be, and one that stepped back a little may step forth again, but a
    /// stamp far in the future would end the counting.
    pub(super) fn newest_stamp(&self, now_ns: u64) -> u64 {
        let newest_ns = self.last.map_or(0, |last| last.t_start_ns);
        if steps_back(newest_ns, now_ns) && is_set(newest_ns) == is_set(now_ns) {
            now_ns
        } else {
            newest_ns.max(now_ns)
        }
    }
}

fn hours(ns: u64) -> f64 {
    ns as f64 / 3600e9
}

fn steps_back(newest_ns: u64, now_ns: u64) -> bool {
    newest_ns.saturating_sub(now_ns) >= CLOCK_STEP_NS
}

/// Whether a clock shows a time since 2000: one without a battery begins in 1970.
pub(super) fn is_set(stamp_ns: u64) -> bool {
    stamp_ns >= 946_684_800_000_000_000
}
