//! Times for a reader: local time with UTC beside it.

use hmd_core::timestamp;
use jiff::Timestamp;
use jiff::tz::TimeZone;

/// The time zone of whoever reads a page.
#[derive(Clone, Debug)]
pub struct Zone(TimeZone);

impl Zone {
    /// UTC.
    #[must_use]
    pub fn utc() -> Self {
        Self(TimeZone::UTC)
    }

    /// The zone of this computer, by `TZ` or the system's setting; UTC where none is set.
    #[must_use]
    pub fn of_this_computer() -> Self {
        Self(TimeZone::try_system().unwrap_or(TimeZone::UTC))
    }

    /// The zone of a name such as `Europe/Berlin`; `None` where this computer does not know it.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        TimeZone::get(name).ok().map(Self)
    }

    /// A stamp as `2023-11-14 23:13 CET (22:13 UTC)`, or `2023-11-14 22:13 UTC`. UTC's date is added where it is another.
    pub(super) fn minute(&self, stamp_ns: u64) -> String {
        let utc = timestamp::minute(stamp_ns);
        let Ok(instant) = Timestamp::from_nanosecond(stamp_ns.into()) else {
            return format!("{utc} UTC");
        };
        let local = instant.to_zoned(self.0.clone());
        if local.offset().seconds() == 0 {
            return format!("{utc} UTC");
        }
        let there = local.strftime("%Y-%m-%d %H:%M %Z").to_string();
        let same_day = there.get(..10) == utc.get(..10);
        let utc = if same_day { utc.get(11..).unwrap_or(&utc) } else { &utc };
        format!("{there} ({utc} UTC)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAMP_NS: u64 = 1_700_000_000_000_000_000;

    #[test]
    fn utc_stands_beside_another_zone() {
        assert_eq!(Zone::utc().minute(STAMP_NS), "2023-11-14 22:13 UTC");
        let zone = |hours| Zone(TimeZone::fixed(jiff::tz::Offset::constant(hours)));
        assert_eq!(zone(1).minute(STAMP_NS), "2023-11-14 23:13 +01 (22:13 UTC)");
        assert_eq!(zone(2).minute(STAMP_NS), "2023-11-15 00:13 +02 (2023-11-14 22:13 UTC)");
        assert!(Zone::named("Nowhere/None").is_none());
    }
}
