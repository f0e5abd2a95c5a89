//! Frames to windows for all actuators, with a count of everything on the way: the CPU-light half of the chain.
//!
//! Live and replay both drive this one, then hand its windows to the [`Assessor`](crate::assess::Assessor); so the same frames
//! give the same windows, in the same order.

use std::sync::Arc;

use ema_wire::{DeframerStats, FrameError};

use crate::actuator_stream::StreamCounts;
use crate::assess::WindowCounts;
use crate::bus_state::BusStates;
use crate::config::Config;
use crate::demux::{Demux, FrameCounts};
use crate::frame::{BusNames, RawFrame};
use crate::history::RunEnd;
use crate::outbox::{Notice, WindowJob};
use crate::record::{InterfaceStatus, Status};
use crate::talker::Talker;

/// Losses that the pipeline itself cannot see; sources and callers count them.
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
    /// Windows not assessed.
    pub windows: u64,
}

/// From frames to windows, for all actuators of a configuration.
#[derive(Debug)]
pub struct Pipeline {
    /// `None` captures alone.
    demux: Option<Demux>,
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
            demux: Some(Demux::new(config)),
            ..Self::capture()
        }
    }

    /// Counts the frames of a capture, and monitors no actuator.
    #[must_use]
    pub fn capture() -> Self {
        Self {
            demux: None,
            captured: FrameCounts::default(),
            states: BusStates::default(),
            notices: Vec::new(),
            last_stamp_ns: 0,
            losses: Losses::default(),
        }
    }

    /// Takes one frame. The windows that it ends wait for [`Pipeline::take_windows`].
    pub fn push(&mut self, frame: &RawFrame, names: &BusNames) {
        self.last_stamp_ns = self.last_stamp_ns.max(frame.stamp_ns);
        if let Some(state) = self.states.push(frame) {
            self.notices.push(Notice {
                stamp_ns: frame.stamp_ns,
                message: format!("{}: bus {state}", names.name(frame.bus).unwrap_or_default()),
            });
        }
        match &mut self.demux {
            Some(demux) => demux.push(frame, names),
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
    pub fn finish(&mut self) {
        if let Some(demux) = &mut self.demux {
            demux.finish();
        }
    }

    /// The frames that come are of another recording: what lies between is not missing. To be called after
    /// [`Pipeline::finish`].
    pub fn begin_recording(&mut self) {
        if let Some(demux) = &mut self.demux {
            demux.begin_recording();
        }
    }

    /// The frames that come are of another log, which may be of another time: where nothing counts the samples, what lies between is not
    /// missing. To be called after [`Pipeline::finish`].
    pub fn begin_log(&mut self) {
        if let Some(demux) = &mut self.demux {
            demux.begin_log();
        }
    }

    /// Windows ended since the last call; an empty list takes no memory.
    pub fn take_windows(&mut self) -> Vec<WindowJob> {
        self.demux.as_mut().map(Demux::take_windows).unwrap_or_default()
    }

    /// Notices since the last call.
    pub fn take_notices(&mut self) -> Vec<Notice> {
        let mut notices = std::mem::take(&mut self.notices);
        notices.extend(self.demux.iter_mut().flat_map(Demux::take_notices));
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
        self.demux.as_ref().map_or(self.captured, Demux::counts)
    }

    /// Error states of the buses.
    #[must_use]
    pub fn states(&self) -> &BusStates {
        &self.states
    }

    /// What came of the frames of each serial line, by its index.
    pub fn serial(&self) -> impl Iterator<Item = (u16, DeframerStats)> {
        self.demux.iter().flat_map(Demux::serial)
    }

    /// Those who talk on a bus, by its index, and of whom nothing is used.
    pub fn talkers(&self) -> impl Iterator<Item = (u16, Talker)> {
        self.demux.iter().flat_map(Demux::talkers)
    }

    /// Names of the actuators seen, with their samples lost so far.
    pub fn lost_samples(&self) -> impl Iterator<Item = (&str, u64)> {
        let of = self.demux.iter().flat_map(Demux::actuators);
        of.map(|(name, _, counts)| (name, counts.lost))
    }

    /// Names of the actuators seen, with their frames so far that came after a newer sample had begun.
    pub fn late(&self) -> impl Iterator<Item = (&str, u64)> {
        self.demux.iter().flat_map(Demux::late)
    }

    /// Names of the actuators seen, with their complete samples so far.
    pub fn samples(&self) -> impl Iterator<Item = (&str, u64)> {
        let of = self.demux.iter().flat_map(Demux::actuators);
        of.map(|(name, samples, _)| (name, samples))
    }

    /// Names of the actuators seen, with what they have shown in this recording.
    pub fn run_ends(&self) -> impl Iterator<Item = (&str, RunEnd)> {
        self.demux.iter().flat_map(Demux::run_ends)
    }

    /// Actuators seen.
    #[must_use]
    pub fn actuators(&self) -> u64 {
        self.demux.iter().flat_map(Demux::actuators).count() as u64
    }

    /// The counters of a run, with those of its assessor.
    #[must_use]
    pub fn status(&self, names: &BusNames, windows: WindowCounts) -> Status {
        let (frames, losses) = (self.frames(), &self.losses);
        let unreadable = |fault| self.serial().map(|(_, stats)| stats.dropped_for(fault)).sum();
        let (mut samples, mut streams) = (0, StreamCounts::default());
        for (_, delivered, of) in self.demux.iter().flat_map(Demux::actuators) {
            samples += delivered;
            streams.lost += of.lost;
            streams.restarts += of.restarts;
            streams.rate_changes += of.rate_changes;
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
            lost_samples: streams.lost,
            device_restarts: streams.restarts,
            rate_changes: streams.rate_changes,
            lost_malformed: frames.malformed,
            lost_windows: losses.windows,
            lost_late: self.late().map(|(_, late)| late).sum::<u64>() + losses.overlapping,
            windows_ok: windows.ok,
            windows_degraded: windows.degraded,
            windows_invalid: windows.invalid,
            windows_unmodelled: windows.unmodelled,
            interfaces: names
                .iter()
                .zip(0..)
                .map(|(name, bus)| InterfaceStatus {
                    interface: name.to_owned(),
                    bus_state: self.states.state_of(bus).to_string(),
                    ..InterfaceStatus::default()
                })
                .collect(),
            ..Status::default()
        }
    }
}
