//! The cheap half of the chain with its books: frames to windows, and a count of everything on the way.
//!
//! Live and replay both drive this one, then hand its windows to the [`Assessor`](crate::assess::Assessor); so the same frames
//! give the same windows, in the same order.

use std::sync::Arc;

use ema_wire::{DeframerStats, FrameError};

use crate::assess::WindowCounts;
use crate::bus_state::BusStates;
use crate::config::Config;
use crate::demux::{FrameCounts, Front, Notice, WindowJob};
use crate::frame::{BusNames, RawFrame};
use crate::record::Status;

/// What was lost around the frames themselves. Counted by whoever sees it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Losses {
    /// Lines of a text log, or frames that no bus carries, that could not be read; those of serial lines are counted
    /// with the frames.
    pub unreadable: u64,
    /// Frames in damaged or missing parts of a recorded file.
    pub damaged: u64,
    /// Frames dropped by the receive queue of a socket.
    pub socket_queue: u64,
    /// Frames of a log that are not later than those of the logs before.
    pub overlapping: u64,
    /// Windows not judged.
    pub windows: u64,
}

/// From frames to windows, for all actuators of a configuration.
#[derive(Debug)]
pub struct Pipeline {
    /// `None` captures alone.
    front: Option<Front>,
    captured: FrameCounts,
    states: BusStates,
    notices: Vec<Notice>,
    last_stamp_ns: u64,
    /// What was lost around the frames.
    pub losses: Losses,
}

impl Pipeline {
    /// For the actuators of a configuration.
    #[must_use]
    pub fn new(config: Arc<Config>) -> Self {
        Self {
            front: Some(Front::new(config)),
            ..Self::capture()
        }
    }

    /// Keeps the books of a capture, and watches nothing.
    #[must_use]
    pub fn capture() -> Self {
        Self {
            front: None,
            captured: FrameCounts::default(),
            states: BusStates::default(),
            notices: Vec::new(),
            last_stamp_ns: 0,
            losses: Losses::default(),
        }
    }

    /// Takes one frame and appends the windows that it ends.
    pub fn push(&mut self, frame: &RawFrame, names: &BusNames, ended: &mut Vec<WindowJob>) {
        self.last_stamp_ns = self.last_stamp_ns.max(frame.stamp_ns);
        if let Some(state) = self.states.push(frame) {
            self.notices.push(Notice {
                stamp_ns: frame.stamp_ns,
                message: format!("{}: bus {state}", names.name(frame.bus).unwrap_or_default()),
            });
        }
        match &mut self.front {
            Some(front) => front.push(frame, names, ended),
            None => {
                self.captured.received += 1;
                if frame.is_error() {
                    self.captured.error += 1;
                } else {
                    self.captured.filtered += 1;
                }
            }
        }
    }

    /// End of the traffic: ends every open window.
    pub fn finish(&mut self, ended: &mut Vec<WindowJob>) {
        if let Some(front) = &mut self.front {
            front.finish(ended);
        }
    }

    /// Notices since the last call.
    pub fn take_notices(&mut self) -> Vec<Notice> {
        let mut notices = std::mem::take(&mut self.notices);
        notices.extend(self.front.iter_mut().flat_map(Front::take_notices));
        notices
    }

    /// Newest stamp of any frame, ns.
    #[must_use]
    pub fn last_stamp_ns(&self) -> u64 {
        self.last_stamp_ns
    }

    /// Frames by what became of them.
    #[must_use]
    pub fn frames(&self) -> FrameCounts {
        self.front.as_ref().map_or(self.captured, Front::counts)
    }

    /// Error states of the buses.
    #[must_use]
    pub fn states(&self) -> &BusStates {
        &self.states
    }

    /// What came of the frames of each serial line, by its index.
    pub fn serial(&self) -> impl Iterator<Item = (u16, DeframerStats)> {
        self.front.iter().flat_map(Front::serial)
    }

    /// Names of the actuators seen, with their complete samples so far.
    pub fn samples(&self) -> impl Iterator<Item = (&str, u64)> {
        let of = self.front.iter().flat_map(Front::actuators);
        of.map(|(name, samples, _)| (name, samples))
    }

    /// Actuators seen.
    #[must_use]
    pub fn actuators(&self) -> u64 {
        self.front.iter().flat_map(Front::actuators).count() as u64
    }

    /// The counters of a run, with those of its judge.
    #[must_use]
    pub fn status(&self, names: &BusNames, windows: WindowCounts) -> Status {
        let (frames, losses) = (self.frames(), &self.losses);
        let unreadable = |fault| self.serial().map(|(_, stats)| stats.dropped_for(fault)).sum();
        let (mut samples, mut missing) = (0, 0);
        for (_, delivered, lost) in self.front.iter().flat_map(Front::actuators) {
            samples += delivered;
            missing += lost;
        }
        Status {
            frames_received: frames.received,
            frames_decoded: frames.decoded,
            frames_filtered: frames.filtered,
            frames_error: frames.error,
            samples,
            lost_unreadable: losses.unreadable + frames.unreadable,
            unreadable_too_long: unreadable(FrameError::TooLong),
            unreadable_cobs: unreadable(FrameError::Cobs),
            unreadable_crc: unreadable(FrameError::Crc),
            unreadable_version: unreadable(FrameError::Version),
            unreadable_decode: unreadable(FrameError::Decode),
            lost_damaged: losses.damaged,
            lost_socket_queue: losses.socket_queue,
            lost_samples: missing,
            lost_malformed: frames.malformed,
            lost_windows: losses.windows,
            lost_late: self.front.as_ref().map_or(0, Front::late) + losses.overlapping,
            windows_ok: windows.ok,
            windows_degraded: windows.degraded,
            windows_invalid: windows.invalid,
            windows_unmodelled: windows.unmodelled,
            interface: names.iter().map(str::to_owned).collect(),
            bus_state: (0..names.len())
                .map(|bus| self.states.of(bus as u16).to_string())
                .collect(),
            ..Status::default()
        }
    }
}
