//! What a deadline left of the identification of a window.

use super::schema::message;
use ema_identify::effort::ShortGrant;

message! {
    /// A request for monitor runs that was not granted in whole.
    pub struct Grant {
        /// Number of the request in the assessment of the window, from 0.
        request: u64 = 1 uint64;
        /// Monitor runs granted.
        runs: u64 = 2 uint64;
    }
}

message! {
    /// A window for whose whole identification the deadline left no time. Replay grants as much again, and so ends in the same
    /// estimate.
    pub struct Shortened {
        /// Actuator name, as in the topic.
        actuator: String = 1 string;
        /// Number of the window, assessed or not, from 0.
        window: u64 = 2 uint64;
        /// Start of the window, UTC ns.
        t_start_ns: u64 = 3 uint64;
        /// The deadline, ms after the arrival of the window's last sample.
        deadline_ms: u32 = 4 uint32;
        /// Monitor runs that the estimate had; 0 without one.
        evaluations: u64 = 5 uint64;
        /// Requests that were not granted in whole; all others were.
        grants: Vec<Grant> = 6 message repeated Grant;
    }
}

super::impl_record!(Shortened, |shortened| format!("/{}/shortened", shortened.actuator));

impl Shortened {
    pub(crate) fn set_grants(&mut self, short: &[ShortGrant]) {
        let grant = |&ShortGrant { request, runs }: &ShortGrant| Grant { request, runs };
        self.grants = short.iter().map(grant).collect();
    }

    /// The requests that were not granted in whole.
    #[must_use]
    pub fn short_grants(&self) -> Vec<ShortGrant> {
        let short = |&Grant { request, runs }: &Grant| ShortGrant { request, runs };
        self.grants.iter().map(short).collect()
    }
}
