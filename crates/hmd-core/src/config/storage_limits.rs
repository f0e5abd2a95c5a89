//! How much a store may take.

use std::time::Duration;

use serde::Serialize;

/// Limits of a store.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Limits {
    /// Size at which a segment is closed, bytes.
    pub segment_bytes: u64,
    /// Age at which a segment is closed.
    pub segment_age: Duration,
    /// Most bytes of all segments together.
    pub budget_bytes: u64,
    /// Bytes of the file system that others shall find free.
    pub free_bytes_min: u64,
}

/// Bytes of a mebibyte.
const MIB: u64 = 1 << 20;

impl Limits {
    /// Limits in the units of the configuration.
    #[must_use]
    pub fn new(segment_mib: u32, segment_age_s: u32, budget_mib: u32, free_mib_min: u32) -> Self {
        Self {
            segment_bytes: u64::from(segment_mib) * MIB,
            segment_age: Duration::from_secs(u64::from(segment_age_s)),
            budget_bytes: u64::from(budget_mib) * MIB,
            free_bytes_min: u64::from(free_mib_min) * MIB,
        }
    }
}
