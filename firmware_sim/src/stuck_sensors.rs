//! Sensors that repeat a value for several samples: packets in, packets with repeated values out.

use ema_wire::{Sample, SerialPacket};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::device::Timed;

/// Largest number of samples with a repeated value.
const LONGEST: u32 = 8;

/// Number of signals that become stuck: currents, resolver counts, encoder counts.
const SIGNALS: u32 = 3;

/// Repeats the currents, the resolver counts or the encoder counts of a sample in the next 1 to 8 samples.
#[derive(Clone, Debug)]
pub struct StuckSensors<I> {
    packets: I,
    probability: f64,
    rng: ChaCha8Rng,
    /// The stuck signal, the sample whose value it repeats, and the number of samples left.
    held: Option<(u32, Sample, u32)>,
    last: Option<Sample>,
}

impl<I> StuckSensors<I> {
    /// At each sample, one of the three signals, drawn at random, becomes stuck with this probability, 0 to 1, unless one is
    /// stuck already.
    pub fn new(packets: I, probability: f64, seed: u64) -> Self {
        Self {
            packets,
            probability: probability.clamp(0.0, 1.0),
            rng: ChaCha8Rng::seed_from_u64(seed),
            held: None,
            last: None,
        }
    }

    fn with_repeated_values(&mut self, mut sample: Sample) -> Sample {
        let begins = self.rng.random_bool(self.probability);
        let (signal, length) = (self.rng.random_range(0..SIGNALS), self.rng.random_range(1..=LONGEST));
        if begins
            && self.held.is_none()
            && let Some(last) = self.last
        {
            self.held = Some((signal, last, length));
        }
        if let Some((signal, old, left)) = self.held {
            match signal {
                0 => (sample.i_a_ma, sample.i_b_ma, sample.i_c_ma) = (old.i_a_ma, old.i_b_ma, old.i_c_ma),
                1 => sample.motor_counts = old.motor_counts,
                _ => sample.output_counts = old.output_counts,
            }
            self.held = (left > 1).then_some((signal, old, left - 1));
        }
        self.last = Some(sample);
        sample
    }
}

impl<I: Iterator<Item = Timed<SerialPacket>>> Iterator for StuckSensors<I> {
    type Item = Timed<SerialPacket>;

    fn next(&mut self) -> Option<Self::Item> {
        let timed = self.packets.next()?;
        Some(timed.map(|packet| match packet {
            SerialPacket::Sample(sample) => SerialPacket::Sample(self.with_repeated_values(sample)),
            SerialPacket::Status { .. } => packet,
        }))
    }
}
