//! Jumps of the wall clock against the clock that never goes back: somebody set it, or the computer slept.

use std::time::Duration;

use super::host_clock::HostClock;

/// Least jump that is told, s; beside it a share of the time gone by, by which a clock that is slewed may be off.
const JUMP_S: f64 = 0.1;
const SLEWED_SHARE: f64 = 0.1;

/// Longest time in which both clocks are read, so that a thread that had to wait in between sees no jump.
const READ_WITHIN: Duration = Duration::from_millis(5);

/// Both clocks when they were looked at last.
#[derive(Debug, Default)]
pub(super) struct WallClock(Option<(Duration, u64)>);

impl WallClock {
    /// Looks at both clocks; a sentence where the wall clock jumped since the last time.
    pub(super) fn jump(&mut self, clock: &impl HostClock) -> Option<String> {
        let (steady, utc_ns) = (clock.now(), clock.utc_ns());
        if clock.now().saturating_sub(steady) > READ_WITHIN {
            return None;
        }
        let (steady_before, utc_before_ns) = self.0.replace((steady, utc_ns))?;
        let passed_s = steady.saturating_sub(steady_before).as_secs_f64();
        let by_s = (i128::from(utc_ns) - i128::from(utc_before_ns)) as f64 / 1e9 - passed_s;
        if by_s.abs() <= JUMP_S + SLEWED_SHARE * passed_s {
            return None;
        }
        let direction = if by_s > 0.0 { "forward" } else { "back" };
        Some(format!("wall clock: it jumped {direction} by {:.1} s", by_s.abs()))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use hmd_core::deadline::Clock;

    use super::*;

    /// Clocks that a test sets, ms; a read of the first takes some time.
    #[derive(Default)]
    struct Clocks(Mutex<[u64; 3]>);

    impl Clocks {
        fn get(&self) -> [u64; 3] {
            *self.0.lock().expect("no test ends in it")
        }

        fn set(&self, clocks: [u64; 3]) {
            *self.0.lock().expect("no test ends in it") = clocks;
        }
    }

    impl Clock for Clocks {
        fn now(&self) -> Duration {
            let [steady, utc, read] = self.get();
            self.set([steady + read, utc, read]);
            Duration::from_millis(steady)
        }
    }

    impl HostClock for Clocks {
        fn utc_ns(&self) -> u64 {
            self.get()[1] * 1_000_000
        }
    }

    #[test]
    fn a_jump_is_told_once_and_no_slewing_or_waiting_is_one() {
        let (clocks, mut wall) = (Clocks::default(), WallClock::default());
        let mut at = |steady_ms, utc_ms, read_ms| {
            clocks.set([steady_ms, utc_ms, read_ms]);
            wall.jump(&clocks)
        };
        assert_eq!(at(0, 50_000, 0), None);
        assert_eq!(at(1_000, 51_000, 0), None);
        assert_eq!(at(2_000, 52_150, 0), None, "slewed");
        let hour = Some("wall clock: it jumped forward by 3600.0 s".to_owned());
        assert_eq!(at(3_000, 3_653_150, 0), hour);
        assert_eq!(at(4_000, 3_654_150, 0), None, "told once");
        let back = Some("wall clock: it jumped back by 3650.1 s".to_owned());
        assert_eq!(at(5_000, 5_050, 0), back);
        assert_eq!(at(6_000, 6_850, 700), None, "the thread waited between both");
        assert_eq!(at(7_000, 7_050, 0), None);
        assert_eq!(at(60_000, 61_000, 0), None, "slewed for a long time");
    }
}
