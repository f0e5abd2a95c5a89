//! Delays between attempts at something that failed.

use std::time::Duration;

/// Pauses between attempts: each twice as long as the one before, up to a longest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RetryDelay {
    attempts: u32,
    longest: Duration,
}

impl RetryDelay {
    /// First pause.
    pub const SHORTEST: Duration = Duration::from_millis(50);

    /// Up to a longest pause, which bounds how late it is noticed that an attempt would succeed.
    #[must_use]
    pub const fn up_to(longest: Duration) -> Self {
        Self { attempts: 0, longest }
    }

    /// The next pause; the one after it is longer.
    pub fn next_delay(&mut self) -> Duration {
        let pause = Self::SHORTEST * (1 << self.attempts.min(10));
        self.attempts = self.attempts.saturating_add(1);
        pause.min(self.longest)
    }

    /// After success: begins with the shortest again.
    pub fn reset(&mut self) {
        self.attempts = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_grow_to_a_bound_and_begin_again() {
        let mut pause = RetryDelay::up_to(Duration::from_secs(1));
        let pauses: Vec<_> = (0..7).map(|_| pause.next_delay().as_millis()).collect();
        assert_eq!(pauses, [50, 100, 200, 400, 800, 1000, 1000]);
        for _ in 0..100 {
            assert!(pause.next_delay() <= Duration::from_secs(1));
        }
        pause.reset();
        assert_eq!(pause.next_delay(), RetryDelay::SHORTEST);
    }
}
