//! A sample in whatever form a recorder keeps it.

use ema_models::SensedSample;

/// A recorded sample in whatever form its owner keeps it.
pub trait RecordedSample: Copy {
    /// The sample in SI units, as the sample number `seq` of its window. Counters do not wrap within a window.
    fn sensed(&self, seq: u64) -> SensedSample;
}

impl RecordedSample for SensedSample {
    fn sensed(&self, seq: u64) -> SensedSample {
        Self { seq, ..*self }
    }
}
