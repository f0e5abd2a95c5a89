//! Notices to operator and records.

use super::{DaemonError, Observer, Shared};
use hmd_core::outbox::Notice;
use hmd_core::record::LogLevel;

/// Tells it, unless there were many of its kind lately.
pub(super) fn publish_rate_limited(
    notice: &Notice,
    level: LogLevel,
    shared: &mut Shared,
    observer: &impl Observer,
) -> Result<(), DaemonError> {
    if shared.notices.admit(notice, level) {
        publish(notice, level, shared, observer)?;
    }
    Ok(())
}

/// Tells how many of each kind were held back, at the end.
pub(super) fn publish_last_summaries(
    stamp_ns: u64,
    shared: &mut Shared,
    observer: &impl Observer,
) -> Result<(), DaemonError> {
    for (notice, level) in shared.notices.last_summaries(stamp_ns) {
        publish(&notice, level, shared, observer)?;
    }
    Ok(())
}

/// Publishes a notice to operator and records.
pub(super) fn publish(
    notice: &Notice,
    level: LogLevel,
    shared: &mut Shared,
    observer: &impl Observer,
) -> Result<(), DaemonError> {
    observer.notice_with_level(level, &notice.message);
    if let Some(recorder) = &mut shared.recorder {
        recorder.write_notice(notice, level)?;
    }
    Ok(())
}
