//! [`Assembler`]: frames of one actuator back into samples, never mixing two instants.
//!
//! A sample is delivered when its currents, position and command frames are all in. They are matched by the low byte of
//! the counter **and** by the receive stamp: the byte repeats every 256 samples, so after a cut cable a position frame may
//! carry the byte of currents that arrived long before. Parts further apart than `max_span_ns` never meet.
//!
//! Rules, in this order, for a part with counter byte s and the sample c that is being collected or was closed last:
//! 1. c began more than `max_span_ns` from the part's stamp: c is over (incomplete if it was open), the part begins a
//!    new one;
//! 2. s is 1 to 127 ahead of c: the same;
//! 3. s is behind c: the part is late and dropped;
//! 4. s equals c, and c still lacks this part: it is added, in whatever order;
//! 5. s equals c, and the part is there already: a duplicate, dropped (CAN repeats a frame when only the sender saw an
//!    error at its end). If it says something else, two senders share an identifier and the sample is rejected.
//!
//! One sample is held, nothing is queued. After a device restart at most `max_span_ns` of samples count as late. A whole
//! sample that some queue held back for longer than that is delivered out of order, unmixed, and counted as a restart.
//! Rule 1 needs stamps: with a log that has none (all zero), a silence of n × 256 samples inside a sample goes unseen.

mod parts;

use parts::{Inserted, Part, Parts};

use crate::can::{ActuatorId, Frame, SampleFd};
use crate::sample::Sample;

/// Counts of what was delivered and what was lost, since the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AssemblerStats {
    /// Samples delivered.
    pub samples: u64,
    /// Samples begun and given up because a frame did not come.
    pub incomplete: u64,
    /// Samples rejected because two frames with one counter said different things.
    pub conflicting: u64,
    /// Frames (or whole samples) that came twice.
    pub duplicates: u64,
    /// Frames (or whole samples) that came after a newer one, or after their sample was rejected.
    pub late: u64,
    /// Samples that the counter says lie between two delivered ones and were not delivered; those in `incomplete` and
    /// `conflicting` included. Silences of 32 768 samples and more (16 s at 2 kHz) cannot be counted from 16 bits.
    pub missing: u64,
    /// Times the counter stood still or jumped back: the device restarted, or the silence was too long to count.
    pub restarts: u64,
}

/// Collects the frames of one actuator into samples. A pure state machine of bounded size.
///
/// ```
/// use ema_wire::{ActuatorId, Assembler, Mode, Sample};
/// let actuator = ActuatorId::new(0).expect("0 to 15");
/// let first = Sample {
///     actuator, seq: 7, time_us: 0, i_a_ma: 1, i_b_ma: 2, i_c_ma: -3, motor_counts: 4, output_counts: 5, setpoint: 6,
///     mode: Mode::Position,
/// };
/// let second = Sample { seq: 8, time_us: 500, ..first };
/// let ([currents, _lost, command], [c2, p2, k2]) = (first.to_frames(), second.to_frames());
///
/// let mut assembler = Assembler::new(actuator);
/// let frames = [currents, command, c2, p2, k2];
/// let delivered: Vec<Sample> = frames.iter().flat_map(|frame| assembler.push(frame, 1_000)).collect();
/// assert_eq!(delivered, [second]);
/// assert_eq!(assembler.stats().incomplete, 1);
/// ```
#[derive(Debug, Clone)]
pub struct Assembler {
    actuator: ActuatorId,
    max_span_ns: u64,
    newest: Option<Collected>,
    last_seq: Option<u16>,
    stats: AssemblerStats,
}

impl Assembler {
    /// Default for the largest distance between the receive stamps of one sample's frames: 20 ms. The frames go out back
    /// to back; what lies between them is the rest of a full bus and the jitter of a USB adapter.
    pub const DEFAULT_MAX_SPAN_NS: u64 = 20_000_000;

    /// For one actuator, with the default span, good for sampling rates up to 6.4 kHz.
    #[must_use]
    pub const fn new(actuator: ActuatorId) -> Self {
        Self::with_max_span_ns(actuator, Self::DEFAULT_MAX_SPAN_NS)
    }

    /// With another span. It must be shorter than 128 sample periods, or the counter byte is ambiguous.
    #[must_use]
    pub const fn with_max_span_ns(actuator: ActuatorId, max_span_ns: u64) -> Self {
        let stats = AssemblerStats {
            samples: 0,
            incomplete: 0,
            conflicting: 0,
            duplicates: 0,
            late: 0,
            missing: 0,
            restarts: 0,
        };
        Self {
            actuator,
            max_span_ns,
            newest: None,
            last_seq: None,
            stats,
        }
    }

    /// Takes another span from here on; see [`Assembler::with_max_span_ns`].
    pub const fn set_max_span_ns(&mut self, max_span_ns: u64) {
        self.max_span_ns = max_span_ns;
    }

    /// Whose frames it expects.
    #[must_use]
    pub const fn actuator(&self) -> ActuatorId {
        self.actuator
    }

    /// Counts so far.
    #[must_use]
    pub const fn stats(&self) -> AssemblerStats {
        self.stats
    }

    /// Takes the next frame of this actuator, with its receive stamp (any clock, used only for distances). Yields one
    /// sample when a classic frame completes it, up to three for `SampleFd`, none for `Status`.
    pub fn push(&mut self, frame: &Frame, received_ns: u64) -> Samples {
        match *frame {
            Frame::Currents(currents) => self
                .push_part(Part::Currents(currents), currents.seq as u8, received_ns)
                .into(),
            Frame::Position(position) => self
                .push_part(Part::Position(position), position.seq8, received_ns)
                .into(),
            Frame::Command(command) => self.push_part(Part::Command(command), command.seq8, received_ns).into(),
            Frame::Status(_) => None.into(),
            Frame::SampleFd(samples) => {
                let mut delivered = [None; SampleFd::MAX_SAMPLES];
                for (out, sample) in delivered.iter_mut().zip(samples.samples(self.actuator)) {
                    *out = self.push_sample(&sample, received_ns);
                }
                Samples(delivered.into_iter().flatten())
            }
        }
    }

    /// Takes a whole sample, as the serial line and `SampleFd` bring it: the same duplicate, late and gap rules.
    pub fn push_sample(&mut self, sample: &Sample, received_ns: u64) -> Option<Sample> {
        let seq8 = sample.seq8();
        match self.place(seq8, received_ns) {
            Place::Late => {
                self.stats.late += 1;
                return None;
            }
            Place::Newest(Stage::Complete) => {
                self.stats.duplicates += 1;
                return None;
            }
            Place::Newest(Stage::Rejected) => {
                self.stats.late += 1;
                return None;
            }
            Place::Newest(Stage::Open(_)) => {} // the whole sample supersedes its parts
            Place::Ahead => self.close(),
        }
        self.newest = Some(Collected {
            seq8,
            since_ns: received_ns,
            stage: Stage::Complete,
        });
        Some(self.deliver(*sample))
    }

    /// End of the stream or a known break in it: an open sample counts as incomplete, and the next frame begins afresh.
    pub fn close(&mut self) {
        if let Some(Collected {
            stage: Stage::Open(_), ..
        }) = self.newest.take()
        {
            self.stats.incomplete += 1;
        }
    }

    fn push_part(&mut self, part: Part, seq8: u8, received_ns: u64) -> Option<Sample> {
        let (mut parts, since_ns) = match self.place(seq8, received_ns) {
            Place::Late | Place::Newest(Stage::Rejected) => {
                self.stats.late += 1;
                return None;
            }
            Place::Newest(Stage::Complete) => {
                self.stats.duplicates += 1;
                return None;
            }
            Place::Newest(Stage::Open(parts)) => (parts, self.newest.map_or(received_ns, |newest| newest.since_ns)),
            Place::Ahead => {
                self.close();
                (Parts::default(), received_ns)
            }
        };
        let stage = match parts.insert(part) {
            Inserted::Duplicate => {
                self.stats.duplicates += 1;
                return None;
            }
            Inserted::Conflict => {
                self.stats.conflicting += 1;
                Stage::Rejected
            }
            Inserted::New => Stage::Open(parts),
        };
        let sample = if let Stage::Open(parts) = stage {
            parts.join(self.actuator)
        } else {
            None
        };
        let stage = if sample.is_some() { Stage::Complete } else { stage };
        self.newest = Some(Collected { seq8, since_ns, stage });
        sample.map(|sample| self.deliver(sample))
    }

    /// Where a counter byte stands relative to the newest sample (rules 1 to 3).
    fn place(&self, seq8: u8, received_ns: u64) -> Place {
        match self.newest {
            Some(newest) if newest.since_ns.abs_diff(received_ns) <= self.max_span_ns => {
                match seq8.wrapping_sub(newest.seq8).cast_signed() {
                    0 => Place::Newest(newest.stage),
                    1.. => Place::Ahead,
                    _ => Place::Late,
                }
            }
            _ => Place::Ahead,
        }
    }

    fn deliver(&mut self, sample: Sample) -> Sample {
        if let Some(last) = self.last_seq {
            match sample.seq.wrapping_sub(last).cast_signed() {
                step @ 1.. => self.stats.missing += u64::from(step.cast_unsigned()) - 1,
                _ => self.stats.restarts += 1,
            }
        }
        self.last_seq = Some(sample.seq);
        self.stats.samples += 1;
        sample
    }
}

/// What one frame completed: up to three samples, oldest first.
#[derive(Debug, Clone)]
pub struct Samples(core::iter::Flatten<core::array::IntoIter<Option<Sample>, { SampleFd::MAX_SAMPLES }>>);

impl Iterator for Samples {
    type Item = Sample;

    fn next(&mut self) -> Option<Sample> {
        self.0.next()
    }
}

impl From<Option<Sample>> for Samples {
    fn from(sample: Option<Sample>) -> Self {
        Self([sample, None, None].into_iter().flatten())
    }
}

#[derive(Debug, Clone, Copy)]
struct Collected {
    seq8: u8,
    since_ns: u64,
    stage: Stage,
}

#[derive(Debug, Clone, Copy)]
enum Stage {
    Open(Parts),
    Complete,
    Rejected,
}

enum Place {
    Ahead,
    Newest(Stage),
    Late,
}
