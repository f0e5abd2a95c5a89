//! The use of a unit so far: hours, cycles and work, window by window.

use ema_identify::Fit;
use serde::{Deserialize, Serialize};

use super::UnitHistory;
use crate::config::HoursOf;
use crate::outbox::WindowJob;
use crate::rul::Odometer;

/// Work that was measured.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Measured {
    work_j: f64,
    cycles: f64,
}

/// The window before.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Last {
    /// Start of the newest window, UTC ns.
    pub(super) t_start_ns: u64,
    /// Number of its run's next window. The name in files is older.
    #[serde(rename = "window")]
    next_window: u64,
    /// Time of operation that its run has counted, s.
    operating_s: f64,
}

impl Last {
    /// The same for a unit that came at `begun_ns`, before the window at `now_ns`: what passed before belongs to another unit. A stamp after
    /// that window was of a wrong clock.
    pub(super) fn of_new_unit(self, begun_ns: u64, now_ns: u64) -> Self {
        let t_start_ns = if self.t_start_ns > now_ns {
            begun_ns
        } else {
            self.t_start_ns.max(begun_ns)
        };
        Self { t_start_ns, ..self }
    }

    /// The same before the first window of another run, which counts windows and time of operation from 0.
    pub(super) fn before_run(self) -> Self {
        Self {
            next_window: 0,
            operating_s: 0.0,
            ..self
        }
    }
}

/// A stamp that lies so far before the newest one, ns, shows that a clock was wrong. A smaller step back may be followed by one forth again.
const CLOCK_STEP_NS: u64 = 24 * 3_600_000_000_000;

impl UnitHistory {
    /// Counts hours, cycles and work.
    pub(super) fn count(&mut self, job: &WindowJob, fit: &Fit, hours_of: HoursOf) {
        let now = Last {
            t_start_ns: job.window.t_start_ns,
            next_window: job.window.number.saturating_add(1),
            operating_s: job.operating_s,
        };
        let hours = match (hours_of, self.last) {
            // A source that began anew counts from 0.
            (HoursOf::Operating, Some(last)) if now.operating_s >= last.operating_s => {
                (now.operating_s - last.operating_s) / 3600.0
            }
            (HoursOf::Operating, _) => now.operating_s / 3600.0,
            // A clock that was set meanwhile tells nothing of the time between.
            (HoursOf::Elapsed, Some(last)) if is_set(last.t_start_ns) == is_set(now.t_start_ns) => {
                now.t_start_ns.saturating_sub(last.t_start_ns) as f64 / 3600e9
            }
            (HoursOf::Elapsed, _) => 0.0,
        };
        // Windows that were dropped for want of time were actuations too.
        let expected = self.last.map_or(0, |last| last.next_window);
        let dropped = job.window.number.saturating_sub(expected) as f64;
        let cycles = dropped + 1.0;
        let mut unmeasured = cycles;
        let mut work_j = 0.0;
        if let Some(measured) = work_j_of(job, fit) {
            self.measured.work_j += measured;
            self.measured.cycles += 1.0;
            unmeasured -= 1.0;
            work_j = measured;
        }
        if self.measured.cycles > 0.0 {
            work_j += unmeasured * self.measured.work_j / self.measured.cycles;
        }
        self.used = Odometer {
            hours: self.used.hours + hours,
            cycles: self.used.cycles + cycles,
            work_j: self.used.work_j + work_j,
        };
        let t_start_ns = self.newest_stamp(now.t_start_ns, hours_of);
        self.last = Some(Last { t_start_ns, ..now });
    }

    /// Counts the time of operation, s, that its run has shown since the last window. Without any window there is no unit yet that it is of.
    pub(super) fn count_rest(&mut self, operated_s: f64) {
        if let (Some(HoursOf::Operating), Some(last)) = (self.hours_of, &mut self.last) {
            let rest_s = (operated_s - last.operating_s).max(0.0);
            self.used.hours += rest_s / 3600.0;
            last.operating_s += rest_s;
        }
    }

    /// The newest stamp after a window: what a clock that steps back and forth again has passed is counted once, but a stamp far in the
    /// future would end the counting.
    fn newest_stamp(&mut self, now_ns: u64, hours_of: HoursOf) -> u64 {
        let newest_ns = self.last.map_or(0, |last| last.t_start_ns);
        let back_ns = newest_ns.saturating_sub(now_ns);
        // A clock that is not set yet will be.
        if back_ns < CLOCK_STEP_NS || is_set(newest_ns) != is_set(now_ns) {
            return newest_ns.max(now_ns);
        }
        if hours_of == HoursOf::Elapsed {
            self.notices.push(format!(
                "the clock is {:.0} h behind the newest window: elapsed hours count from here on, nothing for the step",
                back_ns as f64 / 3600e9
            ));
        }
        now_ns
    }
}

/// Whether a clock shows a time since 2000: one without a battery begins in 1970.
fn is_set(stamp_ns: u64) -> bool {
    stamp_ns >= 946_684_800_000_000_000
}

/// Work of the motor in a window, `Σ |k_t i_q ω| Δt`, J; `None` where the window was not identified.
fn work_j_of(job: &WindowJob, fit: &Fit) -> Option<f64> {
    if fit.i_q_measured.is_empty() {
        return None;
    }
    let k_t = job.params.motor.torque_gain();
    let power = fit
        .i_q_measured
        .iter()
        .zip(&fit.omega_measured)
        .map(|(i_q, omega)| f64::from((i_q * omega).abs()));
    Some(k_t * power.sum::<f64>() / job.params.sensors.sample_rate).filter(|work| work.is_finite())
}
