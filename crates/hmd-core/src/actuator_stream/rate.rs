//! The rate of an actuator's samples, from the first of them: by the device's own time where that shows it.

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

/// What is known of the rate.
#[derive(Debug)]
pub(super) enum RateState {
    /// Samples so far and the periods between them, µs.
    Learning {
        waiting: Vec<TimedSample>,
        periods_us: Vec<u16>,
    },
    Known(SampleRate),
}

/// What a sample did to the sample rate.
pub(super) enum Settled {
    /// The rate is not known yet; the sample waits.
    Not,
    /// The rate was known.
    Before(SampleRate),
    /// The rate is known from this sample on; the samples that waited, this one last.
    Now(SampleRate, Vec<TimedSample>),
}

impl RateState {
    /// Before the first sample.
    pub(super) fn new() -> Self {
        Self::Learning {
            waiting: Vec::with_capacity(RATE_SAMPLES),
            periods_us: Vec::with_capacity(RATE_SAMPLES),
        }
    }

    /// Takes a sample and the device time since the one before it, µs.
    pub(super) fn push(&mut self, sample: TimedSample, elapsed_us: Option<u16>, nominal_hz: f64) -> Settled {
        let (waiting, periods_us) = match self {
            Self::Known(rate) => return Settled::Before(*rate),
            Self::Learning { waiting, periods_us } => (waiting, periods_us),
        };
        if let (Some(previous), Some(elapsed_us)) = (waiting.last(), elapsed_us) {
            let steps = sample.seq.wrapping_sub(previous.seq);
            if steps == 1 && elapsed_us < LONGEST_PERIOD_US {
                periods_us.push(elapsed_us);
            }
        }
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

    /// Ends the measurement with a rate; the samples that waited, none if the rate was known.
    pub(super) fn settle(&mut self, rate: SampleRate) -> Vec<TimedSample> {
        match self {
            Self::Known(_) => Vec::new(),
            Self::Learning { waiting, .. } => {
                let waiting = std::mem::take(waiting);
                *self = Self::Known(rate);
                waiting
            }
        }
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
}
