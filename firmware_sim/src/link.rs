//! A link with injected faults: frames as sent in, frames as received out. The seed determines every fault.

use ema_wire::Message;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::device::Timed;
use crate::frames::{CanFrame, SerialFrame};
use crate::stuck_sensors::StuckSensors;

/// Faults of the link and of the sensors. Probabilities are 0 to 1 and independent for each frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkFaults {
    /// Probability that a frame is lost.
    pub drop: f64,
    /// Probability that a frame arrives twice.
    pub duplicate: f64,
    /// Probability that a frame arrives after the next one.
    pub reorder: f64,
    /// Probability that one bit of a frame is flipped; the effect depends on the link ([`LinkFrame::flipped`]).
    pub flip: f64,
    /// Probability at each sample that a signal becomes stuck, for up to 8 samples ([`StuckSensors`]).
    pub stuck: f64,
    /// Largest delay of a frame, µs; the frames after it wait.
    pub delay_us: u64,
    /// Drift of the device's clock, parts per million; a positive drift shortens the times of transmission.
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

    /// The worst combination under which no link fault may be reported as a fault of the actuator.
    pub const WORST: Self = Self {
        drop: 0.01,
        flip: 0.01,
        stuck: 0.001,
        drift_ppm: 100.0,
        ..Self::NONE
    };

    /// The packets of a device whose sensors become stuck with probability [`LinkFaults::stuck`].
    pub fn with_stuck_sensors<I>(&self, packets: I, seed: u64) -> StuckSensors<I> {
        // The random stream differs from the link's.
        StuckSensors::new(packets, self.stuck, !seed)
    }
}

/// A frame of the link, for the injection of flipped bits.
pub trait LinkFrame: Copy {
    /// The frame as received after one bit is flipped.
    #[must_use]
    fn flipped(self, rng: &mut ChaCha8Rng) -> Self;
}

impl LinkFrame for SerialFrame {
    /// Flips any bit, including those of the zero at the end.
    fn flipped(mut self, rng: &mut ChaCha8Rng) -> Self {
        let bit = rng.random_range(0..8 * self.len.max(1));
        self.bytes[bit / 8] ^= 1 << (bit % 8);
        self
    }
}

impl LinkFrame for CanFrame {
    /// CAN controllers detect almost every flipped bit, so an error frame replaces the frame. Half of the flips in measured
    /// values happen in the device, before the checksum is computed: there a current is wrong by at least 1 A, or a counter
    /// by at least 50 counts. (Smaller errors are of the size of the sensors' own errors.)
    fn flipped(mut self, rng: &mut ChaCha8Rng) -> Self {
        let undetected = rng.random_bool(0.5);
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
            Some(bit) if undetected => {
                data[bit / 8] ^= 1 << (bit % 8);
                self
            }
            _ => Self::Error,
        }
    }
}

/// Bits of each phase in a currents frame whose value is 1.024 A or more.
const CURRENT_BITS: [core::ops::Range<usize>; 3] = [10..16, 26..32, 42..48];
/// Bits of resolver and encoder in a position frame whose value is 64 counts or more.
const COUNT_BITS: [core::ops::Range<usize>; 2] = [6..32, 38..56];

/// The frames as received, in the order of reception.
#[derive(Clone, Debug)]
pub struct Link<I, F> {
    frames: I,
    faults: LinkFaults,
    rng: ChaCha8Rng,
    /// A reordered frame, held until the next one has arrived; and whether it arrives twice.
    overtaken: Option<(Timed<F>, bool)>,
    /// Received frames that the iterator has not yielded yet: at most two frames, each twice.
    arrived: heapless::Deque<Timed<F>, 4>,
    last_us: u64,
}

impl<I, F> Link<I, F> {
    /// A link with these faults.
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

    /// True with this probability. It always draws one number, so the other faults do not depend on the probability.
    fn draw(&mut self, probability: f64) -> bool {
        self.rng.random_range(0.0..1.0) < probability
    }
}

impl<I: Iterator<Item = Timed<F>>, F: LinkFrame> Link<I, F> {
    /// Applies the faults to a frame.
    fn transmit(&mut self, sent: Timed<F>) {
        let LinkFaults {
            drop,
            duplicate,
            reorder,
            flip,
            delay_us,
            drift_ppm,
            ..
        } = self.faults;
        let [lost, twice, swapped, wrong] = [drop, duplicate, reorder, flip].map(|p| self.draw(p));
        let late_us = self.rng.random_range(0..=delay_us);
        let flipped = sent.value.flipped(&mut self.rng);
        if lost {
            return;
        }
        let by_its_clock = sent.at_us as f64 / (1.0 + 1e-6 * drift_ppm);
        let frame = Timed {
            at_us: (by_its_clock + 0.5) as u64 + late_us,
            value: if wrong { flipped } else { sent.value },
        };
        if swapped && self.overtaken.is_none() {
            self.overtaken = Some((frame, twice));
            return;
        }
        self.receive(frame, twice);
        if let Some((frame, twice)) = self.overtaken.take() {
            self.receive(frame, twice);
        }
    }

    /// Appends a frame to those received, not earlier than the frame before.
    fn receive(&mut self, frame: Timed<F>, twice: bool) {
        self.last_us = self.last_us.max(frame.at_us);
        let at_us = self.last_us;
        for _ in 0..=usize::from(twice) {
            // The iterator empties the queue before the next frame, so there is room.
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
                Some(sent) => self.transmit(sent),
                None => {
                    let (frame, twice) = self.overtaken.take()?;
                    self.receive(frame, twice);
                }
            }
        }
    }
}
