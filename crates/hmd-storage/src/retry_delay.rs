//! Delays between attempts at something that failed.

use std::time::Duration;

/// Pauses between attempts: each twice as long as the one before, up to [`RetryDelay::LONGEST`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RetryDelay {
    attempts: u32,
}

impl RetryDelay {
    /// First pause.
    pub const SHORTEST: Duration = Duration::from_millis(50);
    /// Longest pause, which bounds how late a source notices that its link is back.
    pub const LONGEST: Duration = Duration::from_secs(1);

    /// The next pause; the one after it is longer.
    pub fn next_delay(&mut self) -> Duration {
        let pause = Self::SHORTEST * (1 << self.attempts.min(10));
        self.attempts = self.attempts.saturating_add(1);
        pause.min(Self::LONGEST)
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
        let mut pause = RetryDelay::default();
        let pauses: Vec<_> = (0..7).map(|_| pause.next_delay().as_millis()).collect();
        assert_eq!(pauses, [50, 100, 200, 400, 800, 1000, 1000]);
        for _ in 0..100 {
            assert!(pause.next_delay() <= RetryDelay::LONGEST);
        }
        pause.reset();
        assert_eq!(pause.next_delay(), RetryDelay::SHORTEST);
    }
}
