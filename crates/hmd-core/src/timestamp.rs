//! Dates of stamps; no time zones, no clock.

const SECOND_NS: u64 = 1_000_000_000;
const DAY_S: u64 = 86_400;

/// A stamp as `2023-11-14 22:13` (UTC).
#[must_use]
pub fn minute(stamp_ns: u64) -> String {
    let (year, month, day, hour, minute) = parts(stamp_ns);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}")
}

/// The same as `20231114T2213Z`, for lines where every character counts.
#[must_use]
pub fn compact_minute(stamp_ns: u64) -> String {
    let (year, month, day, hour, minute) = parts(stamp_ns);
    format!("{year:04}{month:02}{day:02}T{hour:02}{minute:02}Z")
}

/// Year, month, day, hour, minute. 64 bits of nanoseconds end in the year 2554.
fn parts(stamp_ns: u64) -> (u64, u64, u64, u64, u64) {
    let seconds = stamp_ns / SECOND_NS;
    let (mut day, second) = (seconds / DAY_S, seconds % DAY_S);
    let mut year = 1970;
    while day >= year_days(year) {
        day -= year_days(year);
        year += 1;
    }
    let mut month = 1;
    while day >= month_days(year, month) {
        day -= month_days(year, month);
        month += 1;
    }
    (year, month, day + 1, second / 3600, second / 60 % 60)
}

fn is_leap(year: u64) -> bool {
    year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400))
}

fn year_days(year: u64) -> u64 {
    if is_leap(year) { 366 } else { 365 }
}

fn month_days(year: u64, month: u64) -> u64 {
    match month {
        2 if is_leap(year) => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    }
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
            assert_eq!(minute(seconds * SECOND_NS), expected);
        }
        assert_eq!(compact_minute(1_700_000_000 * SECOND_NS), "20231114T2213Z");
        assert!(minute(u64::MAX).starts_with("2554-07-21"));
    }
}
