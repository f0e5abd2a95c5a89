//! Recordings whose clock may have been wrong, so that their order, that of their stamps, is.

use super::zone::Zone;

/// Why a recording may stand at the wrong time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ClockDoubt {
    /// Its newest window is after the present.
    Ahead {
        /// Name of the file.
        file: String,
        /// Start of that window, UTC ns.
        t_ns: u64,
    },
    /// Its windows step back, or far ahead.
    Step {
        /// Name of the file.
        file: String,
        /// Starts of the windows before and after the step, UTC ns.
        t_ns: [u64; 2],
    },
    /// It is far from the recording before it.
    Far {
        /// Names of the files of both, the earlier one first.
        files: [String; 2],
        /// Days between them.
        days: u64,
    },
}

/// When the windows of a recording began.
#[derive(Debug)]
pub(super) struct Dated<'a> {
    /// Name of the file.
    pub(super) file: &'a String,
    /// Starts of its windows in their order, UTC ns.
    pub(super) times_ns: Vec<u64>,
}

impl Dated<'_> {
    /// First and last start, UTC ns.
    fn period_ns(&self) -> Option<[u64; 2]> {
        Some([*self.times_ns.iter().min()?, *self.times_ns.iter().max()?])
    }
}

/// Days between two recordings from which on one of them may have had a wrong clock.
const FAR_DAYS: u64 = 365;

/// Nanoseconds of a day.
const NS_PER_DAY: u64 = 86_400_000_000_000;

/// Nanoseconds by which windows of a recording step back that may have had a wrong clock.
const STEP_BACK_NS: u64 = NS_PER_DAY;

/// The first step of the windows of a recording that tells of a wrong clock.
fn first_step(recording: &Dated<'_>) -> Option<ClockDoubt> {
    let mut steps = recording.times_ns.windows(2).map(|pair| [pair[0], pair[1]]);
    let is_wrong = |&[before, after]: &[u64; 2]| {
        before.saturating_sub(after) >= STEP_BACK_NS || after.saturating_sub(before) >= FAR_DAYS * NS_PER_DAY
    };
    let t_ns = steps.find(is_wrong)?;
    let file = recording.file.clone();
    Some(ClockDoubt::Step { file, t_ns })
}

/// Recordings in the order of their stamps that stand after the present, UTC ns, or far from the one before, and those whose windows step.
pub(super) fn clock_doubts(recordings: &[Dated<'_>], now_ns: u64) -> Vec<ClockDoubt> {
    let dated = recordings
        .iter()
        .filter_map(|recording| Some((recording.file, recording.period_ns()?)));
    let mut dated: Vec<(&String, [u64; 2])> = dated.collect();
    let ahead = dated.iter().filter(|(_, [_, last])| *last > now_ns);
    let mut doubts: Vec<ClockDoubt> = ahead
        .map(|&(file, [_, t_ns])| ClockDoubt::Ahead {
            file: file.clone(),
            t_ns,
        })
        .collect();
    doubts.extend(recordings.iter().filter_map(first_step));
    dated.sort_by_key(|(_, period)| *period);
    // The latest end so far.
    let mut before: Option<(&String, u64)> = None;
    for (file, [first, last]) in dated {
        if let Some((file_before, end)) = before {
            let days = first.saturating_sub(end) / NS_PER_DAY;
            if days >= FAR_DAYS {
                doubts.push(ClockDoubt::Far {
                    files: [file_before.clone(), file.clone()],
                    days,
                });
            }
        }
        before = Some((file, last)).into_iter().chain(before).max_by_key(|(_, end)| *end);
    }
    doubts
}

/// Most recordings that are named whose clock may be wrong.
const DOUBTS_MAX: usize = 3;

/// Which recordings may stand at the wrong time, in sentences.
pub(super) fn clock_sentence(doubts: &[ClockDoubt], zone: &Zone) -> Option<String> {
    let doubt = |doubt: &ClockDoubt| match doubt {
        ClockDoubt::Step {
            file,
            t_ns: [before, after],
        } => format!(
            "{file} steps from {} to {}, and hours and dates of a forecast may be wrong by that",
            zone.minute(*before),
            zone.minute(*after)
        ),
        ClockDoubt::Ahead { file, t_ns } => format!("{file} ends {}, after the present", zone.minute(*t_ns)),
        ClockDoubt::Far { files: [a, b], days } => format!("{days} days lie between {a} and {b}"),
    };
    let doubts: Vec<String> = doubts.iter().take(DOUBTS_MAX).map(doubt).collect();
    (!doubts.is_empty()).then(|| {
        format!(
            "Recordings stand in the order of their time stamps: {}. Where a clock was wrong, newer windows stand before others.",
            doubts.join("; ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recordings_that_may_have_a_wrong_clock_are_named() {
        let doubts = |recordings: &[(&str, &[u64])], today: u64| {
            let files: Vec<String> = recordings.iter().map(|(file, _)| (*file).to_owned()).collect();
            let dated = files.iter().zip(recordings).map(|(file, (_, days))| Dated {
                file,
                times_ns: days.iter().map(|day| day * NS_PER_DAY).collect(),
            });
            clock_doubts(&dated.collect::<Vec<_>>(), today * NS_PER_DAY)
        };
        let far = |files: [&str; 2], days: u64| ClockDoubt::Far {
            files: files.map(str::to_owned),
            days,
        };
        let step = ClockDoubt::Step {
            file: "s".to_owned(),
            t_ns: [120, 20].map(|day| day * NS_PER_DAY),
        };
        assert_eq!(doubts(&[("s", &[100, 120, 20, 122])], 2000), [step]);
        let in_order: [(&str, &[u64]); 3] = [("a", &[1000, 1010]), ("c", &[1005, 1020]), ("d", &[1300, 1301])];
        assert_eq!(doubts(&in_order, 2000), []);
        let ahead = ClockDoubt::Ahead {
            file: "b".to_owned(),
            t_ns: 2901 * NS_PER_DAY,
        };
        let with = |days: &'static [u64]| in_order.into_iter().chain([("b", days)]).collect::<Vec<_>>();
        assert_eq!(doubts(&with(&[2900, 2901]), 2000), [ahead, far(["d", "b"], 1599)]);
        assert_eq!(doubts(&with(&[0, 1]), 2000), [far(["b", "a"], 999)]);
    }
}
