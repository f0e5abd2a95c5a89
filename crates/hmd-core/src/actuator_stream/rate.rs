//! The rate of an actuator's samples, from the first of them: by the device's own time where that shows it. It is measured on, so that
//! another device, or another firmware, is found at its own rate.

use crate::sample::SampleRate;
use crate::window::TimedSample;

/// Samples that wait until the sample rate is known.
const RATE_SAMPLES: usize = 16;

/// Samples after which a rate that the device's time does not show is taken as nominal.
const RATE_SAMPLES_MAX: usize = 64;

/// A measured rate this near the nominal one, as a share of it, is the nominal one. The same holds for a measured rate near
/// one of whole control periods.
const RATE_ROUNDING: f64 = 0.002;

/// Standard deviations of the jitter that the rate may be off by.
const JITTER_SIGMAS: f64 = 3.0;

/// Most that a rate may be off by for jitter, as a share.
const JITTER_MAX: f64 = 0.05;

/// Longest sample period that 16 bits of microseconds can show, µs; longer ones are not measured.
const LONGEST_PERIOD_US: u16 = 32_768;

/// Periods between consecutive samples by which a rate that is known is checked.
const CHECKED_PERIODS: usize = RATE_SAMPLES - 1;

/// Share from which on two rates differ, if that is more than both may be off by.
const RATE_CHANGE: f64 = 0.02;

/// What is known of the rate.
#[derive(Debug)]
pub(super) enum RateState {
    /// Samples so far and the periods between them, µs.
    Learning {
        waiting: Vec<TimedSample>,
        periods_us: Vec<u16>,
    },
    Known {
        rate: SampleRate,
        /// Periods since the last check, µs.
        periods_us: Vec<u16>,
        /// The other rate that the last check found.
        other: Option<SampleRate>,
    },
}

/// What a sample did to the sample rate.
pub(super) enum Settled {
    /// The rate is not known yet; the sample waits.
    Not,
    /// The rate was known.
    Before(SampleRate),
    /// The rate is known from this sample on; the samples that waited, this one last.
    Now(SampleRate, Vec<TimedSample>),
    /// The rate has changed some samples ago.
    Changed {
        /// The rate before.
        before: SampleRate,
        /// The rate now.
        now: SampleRate,
    },
}

impl RateState {
    /// Before the first sample.
    pub(super) fn new() -> Self {
        Self::Learning {
            waiting: Vec::with_capacity(RATE_SAMPLES),
            periods_us: Vec::with_capacity(RATE_SAMPLES),
        }
    }

    /// The rate, once it is known.
    pub(super) fn known(&self) -> Option<SampleRate> {
        match self {
            Self::Learning { .. } => None,
            Self::Known { rate, .. } => Some(*rate),
        }
    }

    /// Takes a sample, and its device time since the one before, µs, where no sample is missing between them.
    ///
    /// A known rate gives way to another one once two checks in a row have found that one, each by 15 periods: 48 samples after the
    /// change at the latest, as long as none is lost.
    pub(super) fn push(&mut self, sample: TimedSample, period_us: Option<u16>, nominal_hz: f64) -> Settled {
        let period_us = period_us.filter(|&us| us < LONGEST_PERIOD_US);
        let (waiting, periods_us) = match self {
            Self::Known { .. } => return self.check(period_us, nominal_hz),
            Self::Learning { waiting, periods_us } => (waiting, periods_us),
        };
        periods_us.extend(period_us.filter(|_| !waiting.is_empty()));
        waiting.push(sample);
        let rate = if waiting.len() >= RATE_SAMPLES && periods_us.iter().any(|&period_us| period_us > 0) {
            measured_rate(periods_us, nominal_hz)
        } else if waiting.len() >= RATE_SAMPLES_MAX {
            // No two samples in a row with a period between them.
            SampleRate::nominal(nominal_hz)
        } else {
            return Settled::Not;
        };
        Settled::Now(rate, self.settle(rate))
    }

    /// Compares a rate that is known with newer periods.
    fn check(&mut self, period_us: Option<u16>, nominal_hz: f64) -> Settled {
        let Self::Known {
            rate,
            periods_us,
            other,
        } = self
        else {
            return Settled::Not;
        };
        let before = *rate;
        periods_us.extend(period_us);
        if periods_us.len() < CHECKED_PERIODS {
            return Settled::Before(before);
        }
        let found = measured_rate(periods_us, nominal_hz);
        periods_us.clear();
        // A time that stands still shows no rate.
        let found = Some(found).filter(|found| found.is_measured && found.differs_from(&before));
        match (found, *other) {
            (Some(now), Some(expected)) if !now.differs_from(&expected) => {
                (*rate, *other) = (now, None);
                Settled::Changed { before, now }
            }
            _ => {
                *other = found;
                Settled::Before(before)
            }
        }
    }

    /// Ends the measurement with a rate; the samples that waited, none if the rate was known.
    pub(super) fn settle(&mut self, rate: SampleRate) -> Vec<TimedSample> {
        match self {
            Self::Known { .. } => Vec::new(),
            Self::Learning { waiting, periods_us } => {
                let (waiting, mut periods_us) = (std::mem::take(waiting), std::mem::take(periods_us));
                periods_us.clear();
                *self = Self::Known {
                    rate,
                    periods_us,
                    other: None,
                };
                waiting
            }
        }
    }
}

impl SampleRate {
    /// Whether it is another one, beyond what both may be off by.
    fn differs_from(&self, other: &Self) -> bool {
        let share = RATE_CHANGE.max(self.uncertainty + other.uncertainty);
        (self.hz - other.hz).abs() > share * self.hz.max(other.hz)
    }
}

/// The rate by the periods that the device's time shows, µs: the mean of those near their median, so that neither one bad
/// stamp nor the steps of a coarse clock decide. Within a clock's rounding of the nominal rate it is the nominal rate; a
/// clock that stands still from one sample to the next is too coarse to show any.
fn measured_rate(periods_us: &mut [u16], nominal_hz: f64) -> SampleRate {
    periods_us.sort_unstable();
    if periods_us[0] == 0 {
        return SampleRate::nominal(nominal_hz);
    }
    let median = f64::from(periods_us[periods_us.len() / 2]);
    let near = periods_us
        .iter()
        .map(|&us| f64::from(us))
        .filter(|us| (0.4 * median..=2.5 * median).contains(us));
    let (count, sum) = near
        .clone()
        .fold((0.0, 0.0), |(count, sum), us| (count + 1.0, sum + us));
    let hz = 1e6 * count / sum;
    // The clock's own step, where it shows: the mean is off by at most one step in all the time summed up.
    let step = near.clone().fold(0, |step, us| gcd(step, us as u16));
    let coarse = near.clone().any(|us| us as u16 != step);
    let by_step = if coarse { f64::from(step) / sum } else { 0.0 };
    // Periods further apart than one step: stamps jitter. What is off in one period is made good in the next, so that the first and
    // the last stamp decide.
    let (least, most) = near
        .clone()
        .fold((f64::MAX, 0.0_f64), |(least, most), us| (least.min(us), most.max(us)));
    let mean = sum / count;
    let scatter = (near.map(|us| (us - mean).powi(2)).sum::<f64>() / count).sqrt();
    let by_jitter = if most - least > f64::from(step) {
        (JITTER_SIGMAS * scatter / sum).min(JITTER_MAX)
    } else {
        0.0
    };
    let uncertainty = RATE_ROUNDING.max(by_step).max(by_jitter);
    let is_nominal = (hz - nominal_hz).abs() <= uncertainty * nominal_hz;
    SampleRate {
        hz: if is_nominal { nominal_hz } else { hz },
        uncertainty,
        is_measured: true,
    }
}

/// Greatest common divisor; of 0 and a number the number.
fn gcd(a: u16, b: u16) -> u16 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ema_models::{SensedSample, Setpoint};

    /// The rate by a device clock of so many microseconds, sampled at `hz`, where 400 Hz are expected.
    fn rate(hz: f64, lsb_us: f64) -> SampleRate {
        let count = |n: usize| (((n as f64 * 1e6 / hz) / lsb_us).floor() * lsb_us) as u16;
        let mut periods: Vec<u16> = (1..RATE_SAMPLES).map(|n| count(n) - count(n - 1)).collect();
        measured_rate(&mut periods, 400.0)
    }

    #[test]
    fn a_coarse_device_clock_shows_the_nominal_rate() {
        for lsb_us in [1.0, 16.0, 32.0, 64.0, 100.0, 500.0, 1000.0] {
            assert_eq!(rate(400.0, lsb_us).hz.to_bits(), 400f64.to_bits(), "{lsb_us}");
        }
        let too_coarse = rate(400.0, 4000.0);
        assert!(!too_coarse.is_measured);
        assert_eq!(too_coarse.hz.to_bits(), 400f64.to_bits());
        // Jitter does not make the clock coarse: a step of 1 µs.
        let mut jitter: Vec<u16> = (0..15).map(|n| 2490 + 3 * (n % 3)).collect();
        assert!((measured_rate(&mut jitter, 402.0).hz - 401.1).abs() < 0.1);
        // Stamps off by 50 µs (rms) of 1 ms: the nominal rate may be it, a rate far off is not.
        let stamp = |n: u32| 1000 * n + [20, 90, 0, 110, 45, 30, 130, 60, 10, 75][n as usize % 10];
        let mut jitter: Vec<u16> = (1..RATE_SAMPLES as u32)
            .map(|n| (stamp(n) - stamp(n - 1)) as u16)
            .collect();
        let found = measured_rate(&mut jitter, 1000.0);
        assert!(
            (found.hz - 1000.0).abs() < f64::EPSILON && found.uncertainty > 0.005,
            "{found:?}"
        );
        assert!((measured_rate(&mut jitter, 1100.0).hz - 1000.0).abs() < 20.0);
        // Another rate is no rounding.
        assert!((rate(402.3, 1.0).hz - 402.3).abs() < 0.1);
        assert!((rate(625.0, 100.0).hz - 625.0).abs() < 6.0);
    }

    const AT_REST: TimedSample = TimedSample {
        seq: 0,
        stamp_ns: 0,
        sensed: SensedSample {
            seq: 0,
            currents: [0.0; 3],
            motor_counts: 0,
            output_counts: 0,
            setpoint: Setpoint::Idle,
        },
    };

    /// What becomes of a stream at 2 kHz from whose 100th sample on these are the periods, µs: the samples until a change, and the rate.
    fn changed(periods_us: impl IntoIterator<Item = u16>) -> Option<(usize, f64)> {
        let mut state = RateState::new();
        let mut push = |period_us| state.push(AT_REST, Some(period_us), 2000.0);
        for _ in 0..100 {
            assert!(!matches!(push(500), Settled::Changed { .. }));
        }
        let changed = |(n, us)| match push(us) {
            Settled::Changed { now, .. } => Some((n + 1, now.hz)),
            _ => None,
        };
        periods_us.into_iter().enumerate().find_map(changed)
    }

    #[test]
    fn another_rate_is_found_within_48_samples() {
        for us in [2500, 1000, 400, 520] {
            let (samples, hz) = changed([us; 60]).expect("a change");
            assert!(
                samples <= 48 && (hz - 1e6 / f64::from(us)).abs() < 1.0,
                "{samples}: {hz}"
            );
        }
    }

    #[test]
    fn neither_jitter_nor_a_slow_clock_nor_one_that_stands_still_is_another_rate() {
        assert_eq!(changed([500; 1000]), None);
        assert_eq!(changed([0; 1000]), None);
        // 1 % off; steps of a clock of 1 ms and of 400 µs; jitter of 40 µs (rms); a stall and what it held back.
        assert_eq!(changed([505; 1000]), None);
        assert_eq!(changed((0..1000).map(|n| 1000 * (n % 2))), None);
        assert_eq!(changed((0..1000).map(|n| if n % 4 == 3 { 800 } else { 400 })), None);
        assert_eq!(changed((0..1000).map(|n| [450, 550, 470, 530, 440, 560][n % 6])), None);
        assert_eq!(changed((0..1000).map(|n| if n < 20 { 20 } else { 500 })), None);
    }
}
