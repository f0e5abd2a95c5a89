//! A point in time on the command line.

use hmd_core::timestamp;

/// 2000-01-01, UTC ns: what is before it is no time of use, but a number of seconds or milliseconds.
const EARLIEST_NS: u64 = 946_684_800_000_000_000;

/// UTC ns of a time with its offset, or of a number of nanoseconds.
pub(super) fn instant(text: &str) -> Result<u64, String> {
    let expected = || format!("expected a time from 2000 on as 2026-11-20T14:00Z, or UTC ns, found {text:?}");
    // Other programs count nanoseconds in 63 bits.
    let in_range = |ns: &u64| *ns >= EARLIEST_NS && i64::try_from(*ns).is_ok();
    if text.bytes().all(|byte| byte.is_ascii_digit()) {
        return text.parse().ok().filter(in_range).ok_or_else(expected);
    }
    timestamp::parsed(text).filter(in_range).ok_or_else(expected)
}
