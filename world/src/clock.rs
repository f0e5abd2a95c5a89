//! The clocks of the simulated host.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

use hmd::daemon::HostClock;
use hmd_core::deadline::Clock;

/// UTC at the beginning: 2023-11-14 22:13:20, ns.
pub const EPOCH_NS: u64 = 1_700_000_000_000_000_000;

/// Time goes on only where the world says so; all clones are one clock.
#[derive(Clone, Debug)]
pub struct WorldClock {
    /// Any instant: only differences matter.
    start: Instant,
    since_start_ns: Arc<AtomicU64>,
    /// How far the wall clock was set, ns.
    set_by_ns: Arc<AtomicI64>,
}

impl WorldClock {
    /// At the beginning.
    #[must_use]
    pub fn new() -> Self {
        Self {
            start: Instant::now(),
            since_start_ns: Arc::default(),
            set_by_ns: Arc::default(),
        }
    }

    /// Time passes.
    pub fn advance(&self, time: Duration) {
        self.since_start_ns.fetch_add(time.as_nanos() as u64, Relaxed);
    }

    /// Someone sets the wall clock.
    pub fn step(&self, by_ns: i64) {
        self.set_by_ns.fetch_add(by_ns, Relaxed);
    }

    /// The wall clock at a time since the beginning, as it is set now, ns.
    #[must_use]
    pub fn utc_at(&self, time: Duration) -> u64 {
        (EPOCH_NS + time.as_nanos() as u64).saturating_add_signed(self.set_by_ns.load(Relaxed))
    }
}

impl Default for WorldClock {
    fn default() -> Self {
        Self::new()
    }
}

impl Clock for WorldClock {
    fn now(&self) -> Duration {
        Duration::from_nanos(self.since_start_ns.load(Relaxed))
    }
}

impl HostClock for WorldClock {
    fn instant(&self) -> Instant {
        self.start + self.now()
    }

    fn utc_ns(&self) -> u64 {
        self.utc_at(self.now())
    }
}
