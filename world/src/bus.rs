//! A bus: what becomes of the frames on it, and what of them is given to the program.

use std::time::Duration;

use hmd_core::frame::{FrameFlags, RawFrame};
use hmd_ingest::feed::{Input, LiveLoss};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::plan::{BUSES, DEVICES};

/// Length of a shortened frame, bytes.
const SHORT: usize = 3;
/// Identifier of a device that nobody watches.
const FOREIGN: u32 = 0x7FE;

/// What was given to one run of the program.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Given {
    /// Frames.
    pub frames: u64,
    /// Of them those that are shorter than their kind.
    pub malformed: u64,
    /// Frames with another bit, which may make them impossible.
    pub flipped: u64,
    /// Of them error frames.
    pub errors: u64,
    /// Frames that the kernel dropped and counted.
    pub overflown: u64,
    /// Samples sent from the first whole one of their actuator to the last; frames of those between may be missing.
    pub samples: u64,
    /// Samples whose frames all came as they were sent.
    pub whole: u64,
    /// Times that an actuator began anew.
    pub resets: u64,
    /// The actuators whose counter went back, or may seem to: they began anew, a bit of a frame changed, or the wall clock stepped in a
    /// silence behind which nothing tells that they did not begin anew.
    pub counts_back: [bool; BUSES as usize * DEVICES as usize],
}

impl Given {
    /// Gives an input to the program, and counts it.
    pub(crate) fn give(&mut self, input: Input, inputs: &mut Vec<Input>) {
        match &input {
            Input::Frame(frame) => {
                self.frames += 1;
                self.errors += u64::from(frame.is_error());
                let is_short = frame.data().len() == SHORT && frame.id() != FOREIGN;
                self.malformed += u64::from(is_short);
            }
            Input::Lost { frames, .. } => self.overflown += frames,
            Input::Link { .. } | Input::Unwatched { .. } | Input::Tick { .. } => {}
        }
        inputs.push(input);
    }
}

/// State of a bus: how many of its next frames are disturbed, by the kind of disturbance.
#[derive(Clone, Copy, Default)]
pub(crate) struct Bus {
    /// Time until which it brings nothing; zero if it works.
    pub(crate) silent: Duration,
    /// Its link is down, and is told to be up again at the end of the silence.
    pub(crate) link_down: bool,
    /// Frames that get lost.
    pub(crate) drop: u32,
    /// Frames that the kernel drops.
    pub(crate) overflow: u32,
    /// Frames that the kernel dropped and has not yet told of.
    overflown: u64,
    /// Frames in which a bit changes.
    pub(crate) flip: u32,
    /// Frames that lose their end.
    pub(crate) shorten: u32,
    /// Frames of a device that nobody watches, to come.
    pub(crate) foreign: u32,
    /// Frames that come twice.
    pub(crate) repeat: u32,
    /// Samples whose first two frames change places.
    pub(crate) swap: u32,
    /// Time until which frames are read late.
    pub(crate) jitter: Duration,
    /// Stamp of its last frame, ns.
    pub(crate) last_stamp: u64,
    /// When it brought a frame last.
    pub(crate) heard: Duration,
}

impl Bus {
    /// Carries the frames of a sample, sent at `sampled` on the bus of this number, to the program. Whether they all arrive as they were
    /// sent.
    pub(crate) fn carry(
        &mut self,
        (number, sampled): (u16, Duration),
        frames: &mut [RawFrame],
        rng: &mut ChaCha8Rng,
        given: &mut Given,
        inputs: &mut Vec<Input>,
    ) -> bool {
        let spoilt = |bus: &Self| bus.drop + bus.overflow + bus.flip + bus.shorten;
        let spoilt_before = spoilt(self);
        if self.swap > 0 && frames.len() > 1 {
            self.swap -= 1;
            frames.swap(0, 1);
        }
        for frame in frames {
            let mut frame = frame.with_bus(number);
            if sampled < self.jitter {
                frame.stamp_ns += rng.random_range(0..4_000_000);
            }
            frame.stamp_ns = frame.stamp_ns.max(self.last_stamp);
            self.last_stamp = frame.stamp_ns;
            if self.drop > 0 {
                self.drop -= 1;
                continue;
            }
            if self.overflow > 0 {
                self.overflow -= 1;
                self.overflown += 1;
                continue;
            }
            if self.overflown > 0 {
                // As the kernel tells it: with the next frame that it has room for.
                let lost = Input::Lost {
                    bus: number,
                    loss: LiveLoss::SocketQueue,
                    frames: std::mem::take(&mut self.overflown),
                };
                given.give(lost, inputs);
            }
            let stamp_ns = frame.stamp_ns;
            let made = |id, data: &[u8]| RawFrame::new(stamp_ns, number, id, FrameFlags::NONE, data);
            let is_sample = frame.data().len() == 8;
            if self.flip > 0 && is_sample {
                self.flip -= 1;
                let mut data = frame.data().to_vec();
                data[rng.random_range(0..8)] ^= 1 << rng.random_range(0..8);
                frame = made(frame.id(), &data).unwrap_or(frame);
                given.flipped += 1;
            } else if self.shorten > 0 && is_sample {
                self.shorten -= 1;
                frame = made(frame.id(), &frame.data()[..SHORT]).unwrap_or(frame);
            }
            if self.foreign > 0 {
                self.foreign -= 1;
                if let Ok(foreign) = made(FOREIGN, &[1, 2, 3]) {
                    given.give(Input::Frame(foreign), inputs);
                }
            }
            given.give(Input::Frame(frame), inputs);
            self.heard = sampled;
            if self.repeat > 0 {
                self.repeat -= 1;
                given.give(Input::Frame(frame), inputs);
            }
        }
        spoilt(self) == spoilt_before
    }
}
