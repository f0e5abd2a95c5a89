//! How much an actuator is used: hours, cycles and work, and at what rate.

use std::iter;

use serde::{Deserialize, Serialize};

use super::law::Clock;

/// Use since the part was new.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Odometer {
    /// Operating hours.
    pub hours: f64,
    /// Actuations.
    pub cycles: f64,
    /// Work done, J.
    pub work_j: f64,
}

impl Odometer {
    /// What has been added since an earlier reading.
    #[must_use]
    pub fn since(&self, earlier: &Self) -> Self {
        Self {
            hours: self.hours - earlier.hours,
            cycles: self.cycles - earlier.cycles,
            work_j: self.work_j - earlier.work_j,
        }
    }

    /// Whether hours have passed since an earlier reading, and nothing has gone back.
    pub fn is_after(&self, earlier: &Self) -> bool {
        let passed = self.since(earlier);
        passed.hours > 0.0 && passed.hours.is_finite() && passed.cycles >= 0.0 && passed.work_j >= 0.0
    }

    /// The reading on one clock.
    #[must_use]
    pub fn by_clock(&self, clock: Clock) -> f64 {
        match clock {
            Clock::Hours => self.hours,
            Clock::Work => self.work_j,
        }
    }
}

/// Readings kept. When they are full, half of them are dropped.
const READINGS: usize = 64;

/// Share of the hours so far that counts as now.
const RECENT: f64 = 0.05;

/// Fewest bursts of actuations over which their rate is taken, where there were so many.
const BURSTS: usize = 2;

/// Use an hour within a burst, at least so many times the usual…
const WITHIN_BURST: f64 = 1.5;

/// …which is that of the recent hours, and at least of so many times the longest step.
const USUAL_STEPS: f64 = 4.0;

/// Pieces of the past whose work rates are compared.
const QUARTERS: usize = 4;

/// Change of the work rate from quarter to quarter that is reckoned with beforehand, as a logarithm…
const USUAL_CHANGE: f64 = 0.4;

/// …and the number of such changes that this is worth.
const USUAL_CHANGES: f64 = 2.0;

/// Readings of the odometer of one actuator, of bounded number.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Usage {
    readings: Vec<Odometer>,
    /// Sum of the squared hours between readings, whether kept or not.
    squared_steps: f64,
}

/// Rate of use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UseRate {
    /// Cycles per hour.
    pub cycles_per_hour: f64,
    /// Work, J per hour.
    pub work_j_per_hour: f64,
    /// Length of the step between two windows, as seen from any hour: `Σ h² / Σ h`.
    pub step_hours: f64,
    /// Standard deviation of the logarithm of the mean work rate, over a time to come that is as long as `observed_h`.
    pub log_sigma: f64,
    /// Hours over which the use was watched, h.
    pub observed_h: f64,
}

impl Usage {
    /// Whether the readings are possible; a damaged file may hold any numbers.
    pub(super) fn is_possible(&self) -> bool {
        self.readings.len() <= READINGS
    }

    /// Takes a reading; one that is not later than the one before is passed over.
    pub fn update(&mut self, at: Odometer) {
        if let Some(last) = self.readings.last() {
            if !at.is_after(last) {
                return;
            }
            self.squared_steps += (at.hours - last.hours).powi(2);
        }
        if self.readings.len() == READINGS {
            self.keep_half();
        }
        self.readings.push(at);
    }

    /// Drops half of the readings, one at a time that has the shortest step before it: those within a burst go before its beginning. The first
    /// stays, and the newest, from which the next step is measured.
    fn keep_half(&mut self) {
        while self.readings.len() > READINGS / 2 {
            let step = |n: usize| self.readings[n].hours - self.readings[n - 1].hours;
            let shortest = (1..self.readings.len() - 1).min_by(|a, b| step(*a).total_cmp(&step(*b)));
            let Some(dropped) = shortest else { return };
            self.readings.remove(dropped);
        }
    }

    /// The newest reading.
    #[must_use]
    pub fn now(&self) -> Odometer {
        self.readings.last().copied().unwrap_or_default()
    }

    /// Rates of late; `None` before there are two readings.
    ///
    /// Actuations often come in bursts, as before and after a flight. Up to the first actuation of a burst there is one pause more than there
    /// are bursts, which would make the rate too small, so that it is taken from the beginning of a burst to that of a later one. A burst that
    /// goes on counts once it has more than its share of use.
    #[must_use]
    pub fn rate(&self) -> Option<UseRate> {
        let (last, earlier) = self.readings.split_last()?;
        let all = last.since(earlier.first()?);
        let (bursts, newest, whole) = self.whole_bursts(RECENT * all.hours)?;
        let going_on = last.since(&newest);
        let with_it_h = whole.hours + going_on.hours.max(whole.hours / bursts);
        let rate = |whole_use: f64, going_on: f64| (whole_use / whole.hours).max((whole_use + going_on) / with_it_h);
        Some(UseRate {
            cycles_per_hour: rate(whole.cycles, going_on.cycles),
            work_j_per_hour: rate(whole.work_j, going_on.work_j),
            step_hours: self.squared_steps / all.hours,
            log_sigma: self.log_sigma(),
            observed_h: all.hours,
        })
    }

    /// Number of bursts, the beginning of the newest, and the use between the beginning of the first and that: over at least these hours and
    /// [`BURSTS`] bursts, or as many as there are. Within a burst there is more use an hour than is usual, so that steady use is all beginnings.
    fn whole_bursts(&self, recent_h: f64) -> Option<(f64, Odometer, Odometer)> {
        let (first, later) = self.readings.split_first()?;
        let steps = || later.iter().zip(&self.readings).map(|(to, from)| (*to, to.since(from)));
        let of_last = |hours: f64| {
            steps()
                .filter(move |(to, _)| to.hours >= self.now().hours - hours)
                .map(|(_, step)| step)
        };
        let longest_h = of_last(recent_h).fold(0.0, |longest: f64, step| longest.max(step.hours));
        let usual = of_last(recent_h.max(USUAL_STEPS * longest_h));
        let [cycles, hours] = usual.fold([0.0; 2], |sum, step| [sum[0] + step.cycles, sum[1] + step.hours]);
        let begins = |(_, step): &(Odometer, Odometer)| step.cycles * hours <= WITHIN_BURST * cycles * step.hours;
        let begun: Vec<Odometer> = iter::once(*first)
            .chain(steps().filter(begins).map(|(to, _)| to))
            .collect();
        let (newest, earlier) = begun.split_last()?;
        let is_recent = |from: &Odometer| newest.hours - from.hours >= recent_h;
        let latest_from = earlier.len().saturating_sub(BURSTS);
        let from = (0..=latest_from)
            .rev()
            .find(|n| is_recent(&begun[*n]))
            .unwrap_or_default();
        (from < earlier.len()).then(|| ((earlier.len() - from) as f64, *newest, newest.since(&begun[from])))
    }

    /// Spread of the work rate to come, from its steps between quarters of the past, as of a random walk: the mean over
    /// n quarters to come has the variance n/3 of a step.
    fn log_sigma(&self) -> f64 {
        let (first, hours) = (self.readings[0].hours, self.now().hours - self.readings[0].hours);
        let work_at = |quarter: usize| self.work_at(first + hours * quarter as f64 / QUARTERS as f64);
        let logs: Vec<f64> = (0..QUARTERS)
            .map(|quarter| work_at(quarter + 1) - work_at(quarter))
            .filter(|work| *work > 0.0)
            .map(f64::ln)
            .collect();
        let seen: f64 = logs.windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum();
        let count = logs.len().saturating_sub(1) as f64;
        let step = (seen + USUAL_CHANGES * USUAL_CHANGE * USUAL_CHANGE) / (count + USUAL_CHANGES);
        (step * QUARTERS as f64 / 3.0).sqrt()
    }

    /// Work done by a time between the first and the newest reading.
    fn work_at(&self, hours: f64) -> f64 {
        let after = self.readings.partition_point(|r| r.hours < hours);
        let (a, b) = match (after.checked_sub(1), self.readings.get(after)) {
            (Some(before), Some(after)) => (self.readings[before], *after),
            (None, Some(first)) => return first.work_j,
            (_, None) => return self.now().work_j,
        };
        a.work_j + (b.work_j - a.work_j) * (hours - a.hours) / (b.hours - a.hours)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(hours: f64, per_hour: f64) -> Odometer {
        Odometer {
            hours,
            cycles: per_hour * hours,
            work_j: 50.0 * per_hour * hours,
        }
    }

    #[test]
    fn steady_use_has_its_rate_and_its_steps() {
        let mut usage = Usage::default();
        for n in 0..1000 {
            usage.update(at(f64::from(n) * 2.0, 10.0));
        }
        assert!(usage.readings.len() <= READINGS);
        let rate = usage.rate().expect("two readings");
        assert!((rate.cycles_per_hour - 10.0).abs() < 1e-9);
        assert!((rate.work_j_per_hour - 500.0).abs() < 1e-9);
        assert!((rate.step_hours - 2.0).abs() < 1e-9);
        assert!(
            rate.log_sigma < 0.3,
            "steady use is believed after a while: {}",
            rate.log_sigma
        );
        assert_eq!(usage.now(), at(1998.0, 10.0));
    }

    #[test]
    fn a_change_of_use_counts_soon_and_widens_what_comes() {
        let mut usage = Usage::default();
        let mut now = Odometer::default();
        for n in 0..200 {
            let per_hour = if n < 150 { 10.0 } else { 20.0 };
            now = Odometer {
                hours: now.hours + 1.0,
                cycles: now.cycles + per_hour,
                work_j: now.work_j + per_hour,
            };
            usage.update(now);
        }
        let rate = usage.rate().expect("two readings");
        assert!((rate.cycles_per_hour - 20.0).abs() < 1e-9);
        assert!(rate.log_sigma > 0.3, "{}", rate.log_sigma);
    }

    #[test]
    fn use_in_bursts_has_one_rate_within_a_burst_and_between() {
        for per_day in [1_u32, 2, 3, 4, 7] {
            let mut usage = Usage::default();
            let mut cycles = 0.0;
            for (day, n) in (0..60).flat_map(|day| (0..per_day).map(move |n| (day, n))) {
                cycles += 1.0;
                usage.update(Odometer {
                    hours: 24.0 * f64::from(day) + f64::from(n) / 3600.0,
                    cycles,
                    work_j: 50.0 * cycles,
                });
                if day >= 10 {
                    let rate = usage.rate().expect("two readings");
                    let ratio = 24.0 * rate.cycles_per_hour / f64::from(per_day);
                    assert!((ratio - 1.0).abs() < 1e-6, "{per_day} a day, {n} of day {day}: {ratio}");
                    assert!((rate.work_j_per_hour / rate.cycles_per_hour - 50.0).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn a_long_run_after_a_pause_counts_before_it_ends() {
        let mut usage = Usage::default();
        let at = |hours: f64, cycles: f64| Odometer {
            hours,
            cycles,
            work_j: cycles,
        };
        usage.update(at(0.0, 1.0));
        for n in 0..200 {
            usage.update(at(240.0 + f64::from(n) / 60.0, 2.0 + f64::from(n)));
        }
        let rate = usage.rate().expect("two readings");
        assert!(rate.cycles_per_hour > 0.4, "{}", rate.cycles_per_hour);
    }

    #[test]
    fn a_reading_that_goes_back_is_ignored() {
        let mut usage = Usage::default();
        assert_eq!(usage.rate(), None);
        usage.update(at(10.0, 1.0));
        assert_eq!(usage.rate(), None);
        usage.update(at(5.0, 1.0));
        usage.update(at(f64::NAN, 1.0));
        usage.update(at(f64::INFINITY, 1.0));
        assert_eq!(usage.now(), at(10.0, 1.0));
    }
}
