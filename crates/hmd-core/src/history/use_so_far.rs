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

impl Measured {
    /// Work of so many actuations that were not measured: the mean of those that were, J.
    fn work_of(&self, cycles: f64) -> f64 {
        if self.cycles > 0.0 {
            cycles * self.work_j / self.cycles
        } else {
            0.0
        }
    }
}

/// What a run has shown of an actuator when it ends.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RunEnd {
    /// Number of the next window, which did not come.
    pub next_window: u64,
    /// Time of operation, s.
    pub operated_s: f64,
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
    /// The same for a unit that came at `begun_ns`, before its first window `now`: what passed before belongs to another unit. Operation and
    /// dropped windows between two windows of a run are proportional to the time between; before the first of a run, both to its time of
    /// operation, as without a pause: what an earlier run had after `begun_ns` is of the unit before. A stamp after that window was of a
    /// wrong clock.
    fn of_new_unit(self, begun_ns: u64, now: &Self) -> Self {
        let own_ns = now.t_start_ns.saturating_sub(begun_ns) as f64;
        let operated_s = self.operated_until(now);
        let windows = now.number().saturating_sub(self.next_window);
        let is_first_of_run = self.next_window == 0;
        let passed_ns = if is_first_of_run || self.t_start_ns > now.t_start_ns {
            1e9 * operated_s
        } else {
            (now.t_start_ns - self.t_start_ns) as f64
        };
        let share = if own_ns < passed_ns { own_ns / passed_ns } else { 1.0 };
        let t_start_ns = if self.t_start_ns > now.t_start_ns {
            begun_ns
        } else {
            self.t_start_ns.max(begun_ns)
        };
        Self {
            t_start_ns,
            next_window: now.number() - (share * windows as f64).round() as u64,
            operating_s: now.operating_s - share * operated_s,
        }
    }

    /// Number of the window.
    fn number(&self) -> u64 {
        self.next_window.saturating_sub(1)
    }

    /// Time of operation since this window at a later one, s. A source that began anew counts from 0.
    fn operated_until(&self, now: &Self) -> f64 {
        if now.operating_s >= self.operating_s {
            now.operating_s - self.operating_s
        } else {
            now.operating_s
        }
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

impl UnitHistory {
    /// Counts hours, cycles and work.
    pub(super) fn count(&mut self, job: &WindowJob, fit: &Fit, hours_of: HoursOf) {
        let now = Last {
            t_start_ns: job.window.t_start_ns,
            next_window: job.window.number.saturating_add(1),
            operating_s: job.operating_s,
        };
        // The reset of the unit is noted until its first window was taken.
        if self.replaced.split(',').any(|what| what == "unit") {
            self.last = self.last.map(|last| last.of_new_unit(self.begun_ns, &now));
        }
        let hours = match (hours_of, self.last) {
            (HoursOf::Operating, Some(last)) => last.operated_until(&now) / 3600.0,
            (HoursOf::Operating, None) => now.operating_s / 3600.0,
            (HoursOf::Elapsed, _) => self.elapsed_h(now.t_start_ns),
        };
        // Windows that were dropped for want of time were actuations too.
        let expected = self.last.map_or(0, |last| last.next_window);
        let dropped = now.number().saturating_sub(expected) as f64;
        let cycles = dropped + 1.0;
        let mut unmeasured = cycles;
        let mut work_j = 0.0;
        if let Some(measured) = work_j_of(job, fit) {
            self.measured.work_j += measured;
            self.measured.cycles += 1.0;
            unmeasured -= 1.0;
            work_j = measured;
        }
        work_j += self.measured.work_of(unmeasured);
        self.used = Odometer {
            hours: self.used.hours + hours,
            cycles: self.used.cycles + cycles,
            work_j: self.used.work_j + work_j,
        };
        let t_start_ns = self.newest_stamp(now.t_start_ns);
        self.last = Some(Last { t_start_ns, ..now });
    }

    /// Counts the time of operation, s, that its run has shown since the last window, and the windows since then, which were dropped for want of
    /// time. Without any window there is no unit yet that they are of.
    pub(super) fn count_rest(&mut self, rest: RunEnd) {
        let Some(last) = &mut self.last else { return };
        let dropped = rest.next_window.saturating_sub(last.next_window) as f64;
        self.used.cycles += dropped;
        self.used.work_j += self.measured.work_of(dropped);
        last.next_window = last.next_window.max(rest.next_window);
        if self.hours_of == Some(HoursOf::Operating) {
            let rest_s = (rest.operated_s - last.operating_s).max(0.0);
            self.used.hours += rest_s / 3600.0;
            last.operating_s += rest_s;
        }
    }
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
