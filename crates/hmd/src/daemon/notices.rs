//! Rate limit of repeated notices: a flapping link or a noisy line must not fill the log.

use std::collections::BTreeMap;

use hmd_core::outbox::Notice;
use hmd_core::record::LogLevel;

/// Notices of one kind published within [`PERIOD_NS`]; further ones are counted, and the count is published at its end.
const PUBLISHED_MAX: u64 = 10;

/// From the first notice of a kind, ns.
const PERIOD_NS: u64 = 60_000_000_000;

/// Kinds at a time; any further ones count as one.
const KINDS: usize = 256;

/// Notices published lately, by kind.
#[derive(Debug, Default)]
pub(super) struct Notices(BTreeMap<String, Kind>);

#[derive(Debug)]
struct Kind {
    since_ns: u64,
    published: u64,
    held: u64,
    /// The last one that was held back.
    last: Option<(String, LogLevel)>,
}

impl Notices {
    /// Whether to publish this notice; otherwise it is counted.
    pub(super) fn admit(&mut self, notice: &Notice, level: LogLevel) -> bool {
        let mut key = kind_of(&notice.message);
        if self.0.len() >= KINDS && !self.0.contains_key(&key) {
            key.clear();
        }
        let kind = self.0.entry(key).or_insert(Kind {
            since_ns: notice.stamp_ns,
            published: 0,
            held: 0,
            last: None,
        });
        if kind.published < PUBLISHED_MAX {
            kind.published += 1;
            return true;
        }
        kind.held += 1;
        kind.last = Some((notice.message.clone(), level));
        false
    }

    /// Summaries of the kinds whose period is over at this time. A clock that was set back holds none back for ever.
    pub(super) fn summaries(&mut self, stamp_ns: u64) -> Vec<(Notice, LogLevel)> {
        self.remove_over(stamp_ns, |kind| stamp_ns.abs_diff(kind.since_ns) >= PERIOD_NS)
    }

    /// Summaries of all kinds, at the end of a run.
    pub(super) fn last_summaries(&mut self, stamp_ns: u64) -> Vec<(Notice, LogLevel)> {
        self.remove_over(stamp_ns, |_| true)
    }

    fn remove_over(&mut self, stamp_ns: u64, over: impl Fn(&Kind) -> bool) -> Vec<(Notice, LogLevel)> {
        let mut due = Vec::new();
        self.0.retain(|_, kind| {
            let over = over(kind);
            if over && let Some((last, level)) = kind.last.take() {
                let message = format!("{last} (the last of {} not reported)", kind.held);
                due.push((Notice { stamp_ns, message }, level));
            }
            !over
        });
        due
    }
}

/// What is alike in notices that differ only in their numbers. They begin with whom they are about, whose digits count.
fn kind_of(message: &str) -> String {
    let (whom, what) = message.split_once(": ").unwrap_or((message, ""));
    // One frame and several are one kind: the plural's s does not count.
    let what = what.chars().filter(|c| !c.is_ascii_digit() && *c != 's');
    whom.chars().chain([':']).chain(what).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn notice(second: u64, message: &str) -> Notice {
        Notice {
            stamp_ns: second * 1_000_000_000,
            message: message.to_owned(),
        }
    }

    #[test]
    fn notices_of_a_noisy_line_are_limited_to_ten_a_minute_apart_from_other_lines() {
        let mut notices = Notices::default();
        let published = (0..40)
            .filter(|n| {
                let message = format!("uart1: {n} frames lost: {n} wrong CRC");
                notices.admit(&notice(*n, &message), LogLevel::Error)
            })
            .count();
        assert_eq!(published, 10);
        assert!(notices.admit(&notice(41, "uart2: 3 frames lost: 3 wrong CRC"), LogLevel::Error));
        assert_eq!(notices.summaries(59_000_000_000), []);
        let (summary, level) = notices.summaries(60_000_000_000).remove(0);
        assert_eq!(
            summary.message,
            "uart1: 39 frames lost: 39 wrong CRC (the last of 30 not reported)"
        );
        assert_eq!(level, LogLevel::Error);
        assert!(
            notices.admit(&notice(61, "uart1: 1 frame lost: 1 wrong CRC"), LogLevel::Error),
            "anew"
        );
    }

    #[test]
    fn kinds_are_bounded() {
        let mut notices = Notices::default();
        for n in 0..2000 {
            let whom = format!("bus{n}: up");
            let published = notices.admit(&notice(0, &whom), LogLevel::Info);
            assert_eq!(published, n < KINDS as u64 + PUBLISHED_MAX, "{n}");
        }
        assert_eq!(notices.0.len(), KINDS + 1);
        assert_eq!(notices.last_summaries(1).len(), 1);
        assert!(notices.0.is_empty());
    }
}
