//! Dates of the head, without a zone.

use jiff::civil::DateTime;
use jiff::tz::Offset;

/// English and German, which Vector's tools write; of each the first three letters.
const MONTHS: [&[&str]; 12] = [
    &["jan"],
    &["feb"],
    &["mar", "mär"],
    &["apr"],
    &["may", "mai"],
    &["jun"],
    &["jul"],
    &["aug"],
    &["sep"],
    &["oct", "okt"],
    &["nov"],
    &["dec", "dez"],
];

/// `Tue Nov 14 10:13:20.000 pm 2023` as ns since 1970, as if it were UTC.
pub(super) fn date_ns(text: &[u8]) -> Option<u64> {
    let text = String::from_utf8_lossy(text).to_lowercase();
    let words: Vec<&str> = text.split_whitespace().take(7).collect();
    let (month, day, time, half, year) = match words.as_slice() {
        [_, month, day, time, half, year] => (month, day, time, Some(*half), year),
        [_, month, day, time, year] => (month, day, time, None, year),
        _ => return None,
    };
    let month = MONTHS
        .iter()
        .position(|names| names.iter().any(|name| month.starts_with(name)))?;
    let (time, fraction) = time.split_once('.').unwrap_or((time, "0"));
    let mut parts = time.split(':').map(str::parse::<i8>);
    let mut part = || parts.next()?.ok();
    let [hour, minute, second] = [part()?, part()?, part()?];
    let hour = match half {
        Some("am") => hour % 12,
        Some("pm") => hour % 12 + 12,
        Some(_) => return None,
        None => hour,
    };
    // Three digits are milliseconds; fewer are, too: python-can leaves out their zeros. Six are microseconds.
    let unit_ns = match fraction.len() {
        1..=3 => 1_000_000,
        6 => 1_000,
        _ => return None,
    };
    let ns = fraction.parse::<i32>().ok()?.checked_mul(unit_ns)?;
    let (year, day) = (year.parse().ok()?, day.parse().ok()?);
    let civil = DateTime::new(year, i8::try_from(month).ok()? + 1, day, hour, minute, second, ns).ok()?;
    u64::try_from(Offset::UTC.to_timestamp(civil).ok()?.as_nanosecond()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_read_as_they_are_written() {
        let expected = Some(1_700_000_000_007_000_000);
        for text in [
            "Tue Nov 14 22:13:20.007 2023",
            "Tue Nov 14 22:13:20.7 2023",
            "Tue Nov 14 10:13:20.007 pm 2023",
            "Die Nov 14 10:13:20.007000 PM 2023",
        ] {
            assert_eq!(date_ns(text.as_bytes()), expected, "{text}");
        }
        assert_eq!(
            date_ns("Don Mär 1 12:00:00 am 1970".as_bytes()),
            Some(59 * 86_400_000_000_000)
        );
        for text in [
            "",
            "Tue Nov 31 22:13:20 2023",
            "Tue Nov 14 2023",
            "a b c d e f g",
            "x Nov 1 1:1:1 2",
        ] {
            assert_eq!(date_ns(text.as_bytes()), None, "{text}");
        }
    }
}
