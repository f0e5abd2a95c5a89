//! A link that is bad on purpose: seeded, and reproducible by the seed alone.

use ema_wire::Message;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::device::Timed;
use crate::frames::{CanFrame, SerialFrame};
use crate::stuck::Stuck;

/// What a link does to frames, and a sensor to its values. Probabilities are 0 to 1, for each frame by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkFaults {
    /// A frame is lost.
    pub drop: f64,
    /// A frame arrives twice.
    pub duplicate: f64,
    /// A frame arrives after the one that follows it.
    pub reorder: f64,
    /// A bit of a frame arrives wrong; what comes of that depends on the link ([`LinkFrame::flipped`]).
    pub flip: f64,
    /// A signal gets stuck at a sample, for up to 8 of them ([`Stuck`]).
    pub stuck: f64,
    /// Each frame is late by up to this, µs; those behind it wait.
    pub delay_us: u64,
    /// The device's clock is fast by this, parts per million: it sends all the sooner.
    pub drift_ppm: f64,
}

impl LinkFaults {
    /// A perfect link.
    pub const NONE: Self = Self {
        drop: 0.0,
        duplicate: 0.0,
        reorder: 0.0,
        flip: 0.0,
        stuck: 0.0,
        delay_us: 0,
        drift_ppm: 0.0,
    };

    /// The worst mix under which nothing may be taken for a fault of the actuator.
    pub const WORST: Self = Self {
        drop: 0.01,
        flip: 0.01,
        stuck: 0.001,
        drift_ppm: 100.0,
        ..Self::NONE
    };

    /// The packets as a device with sensors that get stuck would send them.
    pub fn stick<I>(&self, packets: I, seed: u64) -> Stuck<I> {
        // Another stream than the link's.
        Stuck::new(packets, self.stuck, !seed)
    }
}

/// A frame that a flipped bit can hit.
pub trait LinkFrame: Copy {
    /// The frame with one bit flipped, as it would arrive.
    #[must_use]
    fn flipped(self, rng: &mut ChaCha8Rng) -> Self;
}

impl LinkFrame for SerialFrame {
    /// Any bit, that of the closing zero included.
    fn flipped(mut self, rng: &mut ChaCha8Rng) -> Self {
        let bit = rng.random_range(0..8 * self.len.max(1));
        self.bytes[bit / 8] ^= 1 << (bit % 8);
        self
    }
}

impl LinkFrame for CanFrame {
    /// The controllers see almost every flip, and an error frame stands in place of the frame. Half of the flips in
    /// measured values are taken to have happened before the checksum was made, in the device: there a current is wrong
    /// by at least 1 A, or a counter by at least 50 counts. (Smaller ones cannot be told from the sensors' own errors.)
    fn flipped(mut self, rng: &mut ChaCha8Rng) -> Self {
        let unseen = rng.random_bool(0.5);
        let choice = rng.random_range(0.0..1.0);
        let Self::Data { message, data, .. } = &mut self else {
            return self;
        };
        let bits: &[core::ops::Range<usize>] = match message {
            Message::Currents => &CURRENT_BITS,
            Message::Position => &COUNT_BITS,
            _ => &[],
        };
        let chosen = (choice * bits.iter().map(ExactSizeIterator::len).sum::<usize>() as f64) as usize;
        match bits.iter().cloned().flatten().nth(chosen) {
            Some(bit) if unseen => {
                data[bit / 8] ^= 1 << (bit % 8);
                self
            }
            _ => Self::Error,
        }
    }
}

/// Bits of a currents frame worth 1.024 A and more, of each phase.
const CURRENT_BITS: [core::ops::Range<usize>; 3] = [10..16, 26..32, 42..48];
/// Bits of a position frame worth 64 counts and more, of resolver and encoder.
const COUNT_BITS: [core::ops::Range<usize>; 2] = [6..32, 38..56];

/// The frames that arrive, in the order in which they arrive.
#[derive(Clone, Debug)]
pub struct Link<I, F> {
    frames: I,
    faults: LinkFaults,
    rng: ChaCha8Rng,
    /// A frame that lets the next one pass.
    overtaken: Option<(Timed<F>, bool)>,
    /// Arrived, and not yet taken: at most a pair of frames, each twice.
    arrived: heapless::Deque<Timed<F>, 4>,
    last_us: u64,
}

impl<I, F> Link<I, F> {
    /// Frames through a link with these faults.
    pub fn new(frames: I, faults: LinkFaults, seed: u64) -> Self {
        Self {
            frames,
            faults,
            rng: ChaCha8Rng::seed_from_u64(seed),
            overtaken: None,
            arrived: heapless::Deque::new(),
            last_us: 0,
        }
    }

    /// Whether something of this probability happens. Always one draw, so that one fault does not move the others.
    fn chance(&mut self, probability: f64) -> bool {
        self.rng.random_range(0.0..1.0) < probability
    }
}

impl<I: Iterator<Item = Timed<F>>, F: LinkFrame> Link<I, F> {
    fn pass(&mut self, sent: Timed<F>) {
        let LinkFaults {
            drop,
            duplicate,
            reorder,
            flip,
            delay_us,
            drift_ppm,
            ..
        } = self.faults;
        let [lost, twice, swapped, wrong] = [drop, duplicate, reorder, flip].map(|p| self.chance(p));
        let late_us = self.rng.random_range(0..=delay_us);
        let flipped = sent.what.flipped(&mut self.rng);
        if lost {
            return;
        }
        let by_its_clock = sent.at_us as f64 / (1.0 + 1e-6 * drift_ppm);
        let frame = Timed {
            at_us: (by_its_clock + 0.5) as u64 + late_us,
            what: if wrong { flipped } else { sent.what },
        };
        if swapped && self.overtaken.is_none() {
            self.overtaken = Some((frame, twice));
            return;
        }
        self.arrive(frame, twice);
        if let Some((frame, twice)) = self.overtaken.take() {
            self.arrive(frame, twice);
        }
    }

    fn arrive(&mut self, frame: Timed<F>, twice: bool) {
        self.last_us = self.last_us.max(frame.at_us);
        let at_us = self.last_us;
        for _ in 0..=usize::from(twice) {
            // Taken before more arrives, so that there is room.
            let _ = self.arrived.push_back(Timed { at_us, ..frame });
        }
    }
}

impl<I: Iterator<Item = Timed<F>>, F: LinkFrame> Iterator for Link<I, F> {
    type Item = Timed<F>;

    fn next(&mut self) -> Option<Timed<F>> {
        loop {
            if let Some(frame) = self.arrived.pop_front() {
                return Some(frame);
            }
            match self.frames.next() {
                Some(sent) => self.pass(sent),
                None => {
                    let (frame, twice) = self.overtaken.take()?;
                    self.arrive(frame, twice);
                }
            }
        }
    }
}
