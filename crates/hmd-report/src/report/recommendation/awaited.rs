//! Levels that the newest damages have, and no window gave them: no recording is long enough to reach them, or its configuration was another.

use ema_models::FaultId;

use super::super::history::History;
use super::super::rules::{Rules, is_certain, level_of};
use super::super::words::with_capital;
use super::left::Left;

/// The faults whose newest damage has a worse level than their state, in sentences: by the levels of the page, where the files were recorded with
/// others; or as more windows in a row must show it than the newest recording has, and another recording would begin to count again.
pub(super) fn awaited(history: &History, left: &Left, rules: &Rules) -> String {
    let begin = history
        .points
        .iter()
        .rposition(|point| point.begins_recording)
        .unwrap_or(0);
    let recording = history.points[begin..].iter();
    let windows = recording.filter(|point| point.estimate.is_some()).count();
    let sentence = |fault: FaultId| {
        let shown = history.newest.shown.of(fault)?;
        let (name, state) = (with_capital(fault.plain_name()), left.states[fault.index()]);
        if history.is_replaced_since(fault) {
            return None;
        }
        if let Some(level) = rules.level_above(fault, shown, state) {
            return Some(format!(
                "{name} is at {level} by the levels of this page, but the files were recorded with others: replay the logs with this configuration."
            ));
        }
        let mode = rules.of_windows(fault)?;
        let level = level_of(shown.damage, mode);
        let is_awaited = is_certain(shown, mode) && level > state;
        let needed = mode.persistence_windows;
        (is_awaited && needed > 1 && windows < needed as usize).then(|| {
            format!(
                "{name} counts as {level} once {needed} windows in a row show it, and the newest recording has {windows}: replay the logs as one."
            )
        })
    };
    let sentences: Vec<String> = FaultId::ALL.into_iter().filter_map(sentence).collect();
    sentences.join(" ")
}
