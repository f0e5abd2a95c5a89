//! Dates, deadlines and stamps.

use crate::{MANY, for_any};
use hmd_core::deadline::{Pace, end_of_turn};
use hmd_core::timestamp::{compact_minute, minute, parsed};
use std::time::Duration;

/// Every stamp has a date, which is read as the stamp's minute.
///
/// Any 64-bit stamp.
#[test]
fn dates_come_back() {
    for_any!(MANY, |stamp_ns: u64| {
        let date = minute(stamp_ns).replace(' ', "T");
        let read = parsed(&format!("{date}Z")).unwrap();
        assert_eq!(read, stamp_ns - stamp_ns % 60_000_000_000, "{date}");
        assert_eq!(compact_minute(stamp_ns), format!("{}Z", date.replace(['-', ':'], "")));
    });
}

/// Any text is a time or refused.
///
/// Up to 40 bytes.
#[test]
fn any_text_is_a_time_or_refused() {
    for_any!(MANY, crate::bytes(40), |text: Vec<u8>| {
        let _ = parsed(&String::from_utf8_lossy(&text));
    });
}

/// A turn ends by its own deadline, and leaves each window that waits its share of the time.
///
/// Up to 16 windows, times within 2^32 µs.
#[test]
fn turns_leave_time_for_those_that_wait() {
    for_any!(MANY, |input: (u32, u32, [u32; 16], u8, u16)| {
        let (now, due, others, waiting, between) = input;
        let time = |us: u32| Duration::from_micros(us.into());
        let others: Vec<_> = others[..usize::from(waiting % 17)].iter().map(|us| time(*us)).collect();
        let mut pace = Pace::default();
        pace.note_between(Duration::from_micros(between.into()));
        let (now, due) = (time(now), time(due));
        let end = end_of_turn(now, due, others.iter().copied(), &pace);
        assert!(end <= due);
        for (n, other) in (2u32..).zip(&others) {
            assert!(end <= now + other.saturating_sub(now) / n, "{n} turns, {other:?}");
        }
        // The time between windows takes at most half of a share.
        let least = (2u32..)
            .zip(&others)
            .map(|(n, other)| now + other.saturating_sub(now) / n / 2);
        assert!(end >= least.min().unwrap_or(due).min(due));
    });
}
