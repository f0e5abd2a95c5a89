//! What was lost since the last tick, in words.

use std::collections::BTreeMap;
use std::mem;

use ema_wire::{DeframerStats, FrameError};
use hmd_core::counted::counted;
use hmd_core::frame::BusNames;
use hmd_core::pipeline::Pipeline;
use hmd_ingest::feed::LiveLoss;

/// Counts since the last tick, and counters as they stood then.
#[derive(Default)]
pub(super) struct FreshLosses {
    /// Frames by bus and kind.
    frames: BTreeMap<(u16, LiveLoss), u64>,
    /// Windows dropped.
    windows: u64,
    /// Counters of each serial line, as reported.
    reported: BTreeMap<u16, DeframerStats>,
    /// Samples of each actuator lost, and its frames out of order, as reported.
    lost: BTreeMap<String, [u64; 2]>,
}

impl FreshLosses {
    pub(super) fn add_frames(&mut self, bus: u16, loss: LiveLoss, frames: u64) {
        *self.frames.entry((bus, loss)).or_default() += frames;
    }

    /// Counts a dropped window.
    pub(super) fn add_window(&mut self) {
        self.windows += 1;
    }

    /// Windows dropped since the last time; [`take_messages`](Self::take_messages) does not tell of them again.
    pub(super) fn take_windows(&mut self) -> u64 {
        mem::take(&mut self.windows)
    }

    /// One line for each bus or actuator and kind.
    pub(super) fn take_messages(&mut self, pipeline: &Pipeline, names: &BusNames) -> Vec<String> {
        let mut messages = Vec::new();
        for ((bus, loss), frames) in mem::take(&mut self.frames) {
            let name = names.name(bus).unwrap_or_default();
            messages.push(format!("{name}: {} lost: {loss}", counted(frames, "frame", "frames")));
        }
        for (bus, stats) in pipeline.serial() {
            let reported = self.reported.insert(bus, stats).unwrap_or_default();
            if let Some(unreadable) = unreadable_since(reported, stats) {
                let name = names.name(bus).unwrap_or_default();
                messages.push(format!("{name}: {unreadable}"));
            }
        }
        // An actuator may be seen on several buses under one name.
        let mut losses: BTreeMap<String, [u64; 2]> = BTreeMap::new();
        for (name, lost) in pipeline.lost_samples() {
            losses.entry(name.to_owned()).or_default()[0] += lost;
        }
        for (name, late) in pipeline.late() {
            losses.entry(name.to_owned()).or_default()[1] += late;
        }
        for (name, [lost, late]) in losses {
            let before = self.lost.insert(name.clone(), [lost, late]).unwrap_or_default();
            let (lost, late) = (lost.saturating_sub(before[0]), late.saturating_sub(before[1]));
            if lost > 0 {
                messages.push(format!("{name}: {} lost", counted(lost, "sample", "samples")));
            }
            if late > 0 {
                let frames = counted(late, "frame", "frames");
                messages.push(format!("{name}: {frames} out of order, not used"));
            }
        }
        let windows = self.take_windows();
        if windows > 0 {
            let windows = counted(windows, "window", "windows");
            messages.push(format!("{windows} dropped: identification does not keep up"));
        }
        messages
    }
}

/// The frames of a serial line that could not be read since then, by cause; `None` if there are none.
fn unreadable_since(then: DeframerStats, now: DeframerStats) -> Option<String> {
    let fresh = FrameError::ALL.map(|fault| (now.dropped_for(fault) - then.dropped_for(fault), fault));
    let parts: Vec<String> = fresh
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, fault)| format!("{count} {fault}"))
        .collect();
    let frames: u64 = fresh.iter().map(|(count, _)| count).sum();
    (frames > 0).then(|| format!("{} lost: {}", counted(frames, "frame", "frames"), parts.join(", ")))
}
