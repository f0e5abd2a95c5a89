//! The wrapping sample counter continued: what was lost, and what is a device that began to count anew.
//!
//! The counter has 16 bits. A step forward of up to half its range may be a loss, or a device that restarted: from 40 000 to 0
//! is 25 536 forward. A silence longer than half the range shows a step back. Time decides: a number that the counter stands for is
//! believed where it differs from the number by time by at most [`TOLERANCE_S`], and by what the rate may be off by over that time. Where no
//! number agrees, the device restarted, if it can have counted from zero to here since the sample before; else the receiver's clock jumped, and
//! the counter alone decides.
//! Time is the receive stamp's; as a receiver may have read late and then a lot at once, it is counted from the sample before and from
//! those of the last seconds that came with the least delay.

use crate::sample::SampleRate;

/// Most that a number may be off the number by time, s.
pub(super) const TOLERANCE_S: f64 = 0.5;

/// The same in samples, for high rates.
const TOLERANCE_SAMPLES: f64 = 4096.0;

/// From so many samples on the tolerance no longer tells numbers apart: the silence was too long.
const UNTOLD_SAMPLES: f64 = 8192.0;

/// Share that a rate may be off by which was not measured.
const NOMINAL_UNCERTAINTY: f64 = 0.1;

/// Range of the counter.
const ROUND: i64 = 1 << 16;

/// First number: far from zero, so that stepping back does not saturate; a multiple of 2^16 keeps the low bits.
const ORIGIN: u64 = 1 << 32;

/// Time over which the least delay is looked for, twice, s.
const LEAST_DELAY_S: f64 = 2.0;

/// A sample and when it was received.
#[derive(Clone, Copy, Debug)]
struct Received {
    number: u64,
    stamp_ns: u64,
}

/// What a sample is to the one before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Numbered {
    /// Its number.
    pub(super) number: u64,
    /// Samples missing before it.
    pub(super) lost: u64,
    /// The counter began anew, or went back: the number is less than the one before, and nothing is missing.
    pub(super) is_restart: bool,
}

/// The numbers of one actuator's samples.
#[derive(Debug, Default)]
pub(super) struct Numbering {
    last: Option<Received>,
    /// Samples with the least delay: since `block_began`, and in the block of time before.
    least_delayed: [Option<Received>; 2],
    block_began: u64,
}

impl Numbering {
    /// What comes is of another recording.
    pub(super) fn begin(&mut self) {
        *self = Self::default();
    }

    /// The sample rate is another one: what it said of delays is void.
    pub(super) fn forget_delays(&mut self) {
        self.least_delayed = [None; 2];
    }

    /// The number of a sample with this counter. `rate` is that by which stamps tell the number: `None` where it is not known yet, or
    /// where stamps give the counter.
    pub(super) fn next(&mut self, counter: u16, stamp_ns: u64, rate: Option<SampleRate>) -> Numbered {
        let Some(last) = self.last else {
            let number = ORIGIN + u64::from(counter);
            self.last = Some(Received { number, stamp_ns });
            return Numbered {
                number,
                lost: 0,
                is_restart: false,
            };
        };
        let step = i64::from(counter.wrapping_sub(last.number as u16) as i16);
        let rate = rate.filter(|_| step != 1 && self.has_advanced(stamp_ns));
        let by_time = rate.map(|rate| (self.step_by_time(counter, stamp_ns, &rate, last), rate));
        let step = match by_time {
            Some((Some(by_time), _)) => by_time,
            Some((None, rate)) if step > 0 && may_be_restart(counter, stamp_ns, &rate, last) => step - ROUND,
            _ => step,
        };
        let numbered = Numbered {
            number: last.number.saturating_add_signed(step),
            lost: step.saturating_sub(1).max(0).cast_unsigned(),
            is_restart: step < 0,
        };
        if numbered.is_restart {
            self.forget_delays();
        }
        self.last = Some(Received {
            number: numbered.number,
            stamp_ns,
        });
        numbered
    }

    /// Takes note of the delay of the newest sample, at this rate.
    pub(super) fn note_delay(&mut self, rate: &SampleRate) {
        let Some(newest) = self.last else { return };
        if newest.number.saturating_sub(self.block_began) as f64 > LEAST_DELAY_S * rate.hz {
            self.least_delayed[1] = self.least_delayed[0].take();
        }
        let [current, _] = &mut self.least_delayed;
        match current {
            None => (*current, self.block_began) = (Some(newest), newest.number),
            Some(least) if number_by_time(least, newest.stamp_ns, rate) <= newest.number as f64 => *least = newest,
            Some(_) => {}
        }
    }

    /// Whether stamps advance at all.
    fn has_advanced(&self, stamp_ns: u64) -> bool {
        let known = self.last.iter().chain(self.least_delayed.iter().flatten());
        known.into_iter().any(|received| received.stamp_ns < stamp_ns)
    }

    /// The step forward from the last sample that counter and time agree on.
    fn step_by_time(&self, counter: u16, stamp_ns: u64, rate: &SampleRate, last: Received) -> Option<i64> {
        let known = std::iter::once(&last).chain(self.least_delayed.iter().flatten());
        known.into_iter().find_map(|received| {
            let by_time = number_by_time(received, stamp_ns, rate);
            let tolerance = tolerance(by_time - received.number as f64, rate);
            let rounds = ((by_time - f64::from(counter)) / ROUND as f64).round();
            let number = rounds * ROUND as f64 + f64::from(counter);
            let agrees = tolerance <= UNTOLD_SAMPLES && (number - by_time).abs() <= tolerance;
            (agrees && number > last.number as f64).then_some((number - last.number as f64) as i64)
        })
    }
}

/// Samples that a number may be off by which time tells over so many samples.
fn tolerance(passed: f64, rate: &SampleRate) -> f64 {
    let uncertainty = if rate.is_measured {
        rate.uncertainty
    } else {
        NOMINAL_UNCERTAINTY
    };
    (TOLERANCE_S * rate.hz).min(TOLERANCE_SAMPLES) + uncertainty * passed.abs()
}

/// Whether a device that began at zero after the last sample can have counted to here.
fn may_be_restart(counter: u16, stamp_ns: u64, rate: &SampleRate, last: Received) -> bool {
    let passed = (number_by_time(&last, stamp_ns, rate) - last.number as f64).max(0.0);
    f64::from(counter) <= passed + tolerance(passed, rate)
}

/// The number that a sample of this stamp has if it came with the delay of another.
fn number_by_time(other: &Received, stamp_ns: u64, rate: &SampleRate) -> f64 {
    let elapsed_ns = (i128::from(stamp_ns) - i128::from(other.stamp_ns)) as f64;
    other.number as f64 + 1e-9 * elapsed_ns * rate.hz
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE: SampleRate = SampleRate {
        hz: 2000.0,
        uncertainty: 0.002,
        is_measured: true,
    };

    const PERIOD_NS: u64 = 500_000;

    /// A device at 2 kHz that has sent 10 000 samples up to this number, the last of them at this time.
    fn after(number: u64) -> (Numbering, u64) {
        let mut numbering = Numbering::default();
        let began_ns = 1_700_000_000_000_000_000;
        for n in 0..=10_000 {
            let counter = (number + n + 6 * (1 << 16) - 10_000) as u16;
            numbering.next(counter, began_ns + n * PERIOD_NS, Some(RATE));
            numbering.note_delay(&RATE);
        }
        (numbering, began_ns + 10_000 * PERIOD_NS)
    }

    /// Samples lost and whether the device restarted, where this counter follows `number` so many seconds later.
    fn found(number: u64, counter: u16, later_s: f64) -> (u64, bool) {
        let (mut numbering, then_ns) = after(number);
        let before = numbering.last.map_or(0, |last| last.number);
        let found = numbering.next(counter, then_ns + (1e9 * later_s) as u64, Some(RATE));
        assert_eq!(found.number as u16, counter);
        assert_eq!(found.number < before, found.is_restart);
        (found.lost, found.is_restart)
    }

    #[test]
    fn a_restart_is_no_loss_wherever_the_counter_was() {
        for number in [1, 1_000, 32_767, 32_768, 40_000, 60_000] {
            assert_eq!(found(number, 0, 1.2), (0, true), "{number}");
        }
        assert_eq!(found(40_000, 3, 5.0), (0, true));
    }

    #[test]
    fn what_is_lost_is_counted_over_a_wrap_and_over_more_than_the_counter_shows() {
        assert_eq!(found(40_000, 40_001, 0.0005), (0, false));
        assert_eq!(found(40_000, 40_011, 0.0055), (10, false));
        assert_eq!(found(65_530, 4, 0.005), (9, false));
        assert_eq!(found(40_000, 0, 12.768), (25_535, false));
        // 20 s and 50 s: once beyond half the range of the counter, once beyond the range.
        assert_eq!(found(1_000, 41_000, 20.0), (39_999, false));
        assert_eq!(found(1_000, (101_000_u64 % 65_536) as u16, 50.0), (99_999, false));
        // Clocks that differ by a tenth of a percent.
        assert_eq!(found(1_000, 41_000, 20.02), (39_999, false));
        // After a night nobody knows.
        assert_eq!(found(1_000, 1_234, 30_000.0), (0, true));
    }

    #[test]
    fn a_clock_that_jumps_makes_no_restart() {
        // 3.3 s are lost, and the receiver's clock jumped by 0.8 s back or by 4 s forward in them.
        for later_s in [2.5, 7.3] {
            assert_eq!(found(20_000, 26_600, later_s), (6_599, false));
        }
    }

    #[test]
    fn a_receiver_that_stalls_makes_no_restart() {
        // 3 s late: the samples that the queue held come at once, then those after what it could not hold.
        let (mut numbering, then_ns) = after(10_000);
        let late_ns = then_ns + 3_000_000_000;
        for n in 1..=1_000 {
            let found = numbering.next(10_000 + n, late_ns, Some(RATE));
            assert_eq!((found.lost, found.is_restart), (0, false));
            numbering.note_delay(&RATE);
        }
        let found = numbering.next(16_000, late_ns, Some(RATE));
        assert_eq!((found.lost, found.is_restart), (4_999, false));
    }

    #[test]
    fn without_time_the_counter_alone_decides() {
        for rate in [None, Some(RATE)] {
            let mut numbering = Numbering::default();
            let found = [100, 5_100, 5_000].map(|counter| {
                let found = numbering.next(counter, 0, rate);
                (found.lost, found.is_restart)
            });
            assert_eq!(found, [(0, false), (4_999, false), (0, true)]);
        }
    }
}
