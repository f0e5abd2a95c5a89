//! What the daemon reads of time.

use std::time::{Duration, Instant};

use hmd_core::deadline::Clock;
use hmd_storage::clock::now_ns;

/// The clocks of a host: one that never goes back, and the wall clock.
pub trait HostClock: Clock + Sync {
    /// The clock that never goes back.
    fn instant(&self) -> Instant {
        Instant::now()
    }

    /// UTC by the wall clock, which may step, ns.
    fn utc_ns(&self) -> u64 {
        now_ns()
    }
}

/// The computer's own clocks.
pub(super) struct SteadyClock(pub(super) Instant);

impl Clock for SteadyClock {
    fn now(&self) -> Duration {
        self.0.elapsed()
    }
}

impl HostClock for SteadyClock {}
