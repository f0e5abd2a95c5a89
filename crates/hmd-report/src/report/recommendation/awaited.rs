//! Levels that the newest damages have, and no window gave them: no recording is long enough to reach them, or its configuration was another.

use ema_models::{FaultId, FaultVector};

use super::super::history::{History, Point};
use super::super::rules::{Rules, is_certain, level_of};
use super::super::words::with_capital;
use super::left::Left;

/// The faults whose newest damage has a worse level than their state, in sentences: by the levels of the page, where the files were recorded with
/// others; or as more windows in a row must show it than have; another recording would begin to count again.
pub(super) fn awaited(history: &History, left: &Left, rules: &Rules) -> String {
    let begin = history
        .points
        .iter()
        .rposition(|point| point.begins_recording)
        .unwrap_or(0);
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
        let is_newest = shown.t_start_ns == history.newest.health.t_start_ns;
        let is_awaited = is_newest && is_certain(shown, mode) && level > state;
        let needed = mode.persistence_windows as usize;
        if !is_awaited || needed <= 1 {
            return None;
        }
        let recording = &history.points[begin..];
        let damage = |point: &Point| point.estimate.map(|e| FaultVector::from_array(e.k).damage_of(fault));
        let shows = |point: &&Point| damage(point).is_some_and(|damage| level_of(damage, mode) >= level);
        let windows = recording.iter().rev().take_while(shows).count();
        if windows >= needed {
            return None;
        }
        let counts = format!("{name} counts as {level} once {needed} windows in a row show it, so far {windows}");
        // The windows of the recording before may count with these.
        Some(if begin > 0 && windows == recording.len() {
            format!("{counts}: replay the logs as one.")
        } else {
            format!("{counts}: move the actuator again, and look at this page then.")
        })
    };
    let sentences: Vec<String> = FaultId::ALL.into_iter().filter_map(sentence).collect();
    sentences.join(" ")
}
