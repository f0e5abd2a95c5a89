//! Dates of stamps; no time zones, no clock.

use jiff::Timestamp;

/// A stamp as `2023-11-14 22:13` (UTC).
#[must_use]
pub fn minute(stamp_ns: u64) -> String {
    utc(stamp_ns).strftime("%Y-%m-%d %H:%M").to_string()
}

/// The same as `20231114T2213Z`, for lines where every character counts.
#[must_use]
pub fn compact_minute(stamp_ns: u64) -> String {
    utc(stamp_ns).strftime("%Y%m%dT%H%MZ").to_string()
}

/// UTC ns of a time with its offset from UTC, as `2023-11-14T22:13Z` or `2023-11-14 23:13:20+01:00`; `None` for other text and
/// before 1970.
#[must_use]
pub fn parsed(text: &str) -> Option<u64> {
    let instant: Timestamp = text.parse().ok()?;
    instant.as_nanosecond().try_into().ok()
}

fn utc(stamp_ns: u64) -> Timestamp {
    Timestamp::from_nanosecond(stamp_ns.into()).expect("64 bits of nanoseconds end in the year 2554")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_instants() {
        for (seconds, expected) in [
            (0, "1970-01-01 00:00"),
            (951_782_399, "2000-02-28 23:59"),
            (951_782_400, "2000-02-29 00:00"),
            (1_700_000_000, "2023-11-14 22:13"),
            (4_107_542_399, "2100-02-28 23:59"),
            (4_107_542_400, "2100-03-01 00:00"),
        ] {
            assert_eq!(minute(seconds * 1_000_000_000), expected);
        }
        assert_eq!(compact_minute(1_700_000_000_000_000_000), "20231114T2213Z");
        let ns = Some(1_700_000_000_000_000_000 - 20_000_000_000);
        assert_eq!(parsed("2023-11-14T22:13Z"), ns);
        assert_eq!(parsed("2023-11-14 23:13:00+01:00"), ns);
        assert_eq!(
            [parsed("2023-11-14"), parsed("1969-12-31T23:59Z"), parsed("yesterday")],
            [None; 3]
        );
        assert!(minute(u64::MAX).starts_with("2554-07-21"));
    }
}
