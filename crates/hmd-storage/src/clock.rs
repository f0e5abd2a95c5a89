//! The clock of the host, for those who may read it.

use std::time::{SystemTime, UNIX_EPOCH};

/// UTC by the host's clock, ns.
#[must_use]
pub fn now_ns() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)
}
