//! Levels that no recording is long enough to reach.

use ema_models::FaultId;

use super::super::history::History;
use super::super::rules::{Rules, level_of};
use super::super::words::with_capital;
use super::left::Left;

/// The faults whose newest damage has a worse level than their state, which more windows in a row must show than the newest recording has, in
/// sentences: another recording would begin to count again.
pub(super) fn awaited(history: &History, left: &Left, rules: &Rules) -> String {
    let begin = history
        .points
        .iter()
        .rposition(|point| point.begins_recording)
        .unwrap_or(0);
    let recording = history.points[begin..].iter();
    let windows = recording.filter(|point| point.estimate.is_some()).count();
    let sentence = |fault: FaultId| {
        let mode = rules.of_windows(fault)?;
        let shown = history.newest.shown.of(fault)?;
        let is_certain = shown
            .sigma
            .is_none_or(|sigma| shown.damage >= mode.significance_sigmas * sigma);
        let level = level_of(shown.damage, mode);
        let is_awaited = is_certain && level > left.states[fault.index()] && !history.is_replaced_since(fault);
        let needed = mode.persistence_windows;
        (is_awaited && needed > 1 && windows < needed as usize).then(|| {
            format!(
                "{} counts as {level} once {needed} windows in a row show it, and the newest recording has {windows}: replay the logs as one.",
                with_capital(fault.plain_name())
            )
        })
    };
    let sentences: Vec<String> = FaultId::ALL.into_iter().filter_map(sentence).collect();
    sentences.join(" ")
}
