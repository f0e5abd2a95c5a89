//! [`Assembler`]: joins the frames of one actuator into samples, never frames of two instants.
//!
//! A sample is delivered when its currents, position and command frames are all present. Frames are matched by the low byte
//! of the counter **and** by the receive stamp. The byte alone is ambiguous: it repeats every 256 samples, so after an
//! interruption a position frame may carry the same byte as currents received long before.
//!
//! Rules, in this order, for a frame with counter byte s and the newest sample c, which is open or closed:
//! 1. the first frame of c is more than `max_span_ns` away from this frame's stamp: c is closed (and counted as incomplete
//!    if it was open), and the frame opens a new sample;
//! 2. s is 1 to 127 ahead of the counter byte of c: as in rule 1;
//! 3. s is behind the counter byte of c: the frame is late and dropped;
//! 4. s is the counter byte of c, and c lacks this frame: the frame is added, in any order;
//! 5. s is the counter byte of c, and c has this frame: the frame is a duplicate and dropped (CAN repeats a frame when only
//!    its sender sees an error at its end). If its content differs and c is
//!    still open, two senders share an identifier, and c is rejected; a sample that was delivered is not compared any more.
//!
//! A sample that comes whole brings all 16 bits of its counter: behind a delivered one it is late by 128 at most. Farther back the device
//! restarted, and any number ahead is a gap, as of a serial line that was read late and then a lot at once, with one stamp.
//!
//! The assembler holds one sample and queues nothing. After a restart of the device at most `max_span_ns` of samples count
//! as late. A complete sample that was delayed by more than `max_span_ns` is delivered out of order and counted as a restart.
//! Rule 1 needs stamps: in a log without stamps (all zero), a silence of n × 256 samples inside a sample is not detected.
//!
//! A bus with a layout of its own has no such frames; there `hmd_core::dbc::Joiner` builds the samples.

mod parts;

use parts::{Insertion, Part, Parts};

use crate::can::{Frame, SampleFd};
use crate::sample::{ActuatorId, Sample};

/// Counts of delivered and lost samples and frames since the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AssemblerStats {
    /// Samples delivered.
    pub samples: u64,
    /// Samples closed before all their frames were received.
    pub incomplete: u64,
    /// Samples rejected because two frames with one counter have different content.
    pub conflicting: u64,
    /// Frames (or complete samples) received twice.
    pub duplicates: u64,
    /// Frames (or complete samples) received after a newer one, or after their sample was rejected.
    pub late: u64,
    /// Samples between two delivered ones, by their counters alone, that were not delivered; it includes those in `incomplete` and
    /// `conflicting`. The 16-bit counter cannot show silences of 32 768 samples and more (16 s at 2 kHz), and looks as after a loss when a
    /// device restarts beyond 32 768; who knows the rate asks the stamps (`hmd_core::actuator_stream`).
    pub missing: u64,
    /// Times the counter stood still or went back: the device restarted, or the silence was too long to count.
    pub restarts: u64,
}

/// State machine of bounded size that joins the frames of one actuator into samples.
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
    /// Default for the largest distance between the receive stamps of one sample's frames: 20 ms.
    ///
    /// The device sends the frames back to back; other traffic on a full bus and the jitter of a USB adapter separate them.
    pub const DEFAULT_MAX_SPAN_NS: u64 = 20_000_000;

    /// An assembler for one actuator with the default span, which suits sampling rates up to 6.4 kHz.
    #[must_use]
    pub const fn new(actuator: ActuatorId) -> Self {
        Self::with_max_span_ns(actuator, Self::DEFAULT_MAX_SPAN_NS)
    }

    /// An assembler with another span, ns. It must be shorter than 128 sample periods, or the counter byte is ambiguous.
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

    /// Changes the span, ns; see [`Assembler::with_max_span_ns`].
    pub const fn set_max_span_ns(&mut self, max_span_ns: u64) {
        self.max_span_ns = max_span_ns;
    }

    /// The actuator whose frames it joins.
    #[must_use]
    pub const fn actuator(&self) -> ActuatorId {
        self.actuator
    }

    /// Counts so far.
    #[must_use]
    pub const fn stats(&self) -> AssemblerStats {
        self.stats
    }

    /// Takes the next frame of this actuator with its receive stamp, ns. Only differences of stamps matter, so any clock
    /// suits.
    ///
    /// Yields one sample when a classic frame completes it, up to three for `SampleFd`, none for `Status`.
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

    /// Takes a complete sample from the serial line or a `SampleFd`; duplicates, late samples and gaps follow the same rules.
    pub fn push_sample(&mut self, sample: &Sample, received_ns: u64) -> Option<Sample> {
        let seq8 = sample.seq8();
        match self.relation_to_delivered(sample.seq, received_ns) {
            Relation::Behind => {
                self.stats.late += 1;
                return None;
            }
            Relation::Same(Stage::Complete) => {
                self.stats.duplicates += 1;
                return None;
            }
            Relation::Same(Stage::Rejected) => {
                self.stats.late += 1;
                return None;
            }
            Relation::Same(Stage::Open(_)) => {} // the complete sample replaces its frames
            Relation::Ahead => self.close(),
        }
        self.newest = Some(Collected {
            seq8,
            since_ns: received_ns,
            stage: Stage::Complete,
        });
        Some(self.deliver(*sample))
    }

    /// Marks the end of the stream or a known break in it: an open sample counts as incomplete, and the next frame opens a
    /// new one.
    pub fn close(&mut self) {
        if let Some(Collected {
            stage: Stage::Open(_), ..
        }) = self.newest.take()
        {
            self.stats.incomplete += 1;
        }
    }

    /// Begins another stream of the same actuator: what lies between its first sample and the last one is unknown, and not
    /// counted as missing.
    pub fn begin_stream(&mut self) {
        self.close();
        self.last_seq = None;
    }

    fn push_part(&mut self, part: Part, seq8: u8, received_ns: u64) -> Option<Sample> {
        let (mut parts, since_ns) = match self.relation_to_newest(seq8, received_ns) {
            Relation::Behind | Relation::Same(Stage::Rejected) => {
                self.stats.late += 1;
                return None;
            }
            Relation::Same(Stage::Complete) => {
                self.stats.duplicates += 1;
                return None;
            }
            Relation::Same(Stage::Open(parts)) => (parts, self.newest.map_or(received_ns, |newest| newest.since_ns)),
            Relation::Ahead => {
                self.close();
                (Parts::default(), received_ns)
            }
        };
        let stage = match parts.insert(part) {
            Insertion::Duplicate => {
                self.stats.duplicates += 1;
                return None;
            }
            Insertion::Conflict => {
                self.stats.conflicting += 1;
                Stage::Rejected
            }
            Insertion::New => Stage::Open(parts),
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

    /// Compares a counter byte with the newest sample's, by rules 1 to 3.
    fn relation_to_newest(&self, seq8: u8, received_ns: u64) -> Relation {
        match self.newest {
            Some(newest) if newest.since_ns.abs_diff(received_ns) <= self.max_span_ns => {
                match seq8.wrapping_sub(newest.seq8).cast_signed() {
                    0 => Relation::Same(newest.stage),
                    1.. => Relation::Ahead,
                    _ => Relation::Behind,
                }
            }
            _ => Relation::Ahead,
        }
    }

    /// Compares the whole counter of a complete sample with the newest sample's, if that was delivered.
    fn relation_to_delivered(&self, seq: u16, received_ns: u64) -> Relation {
        match (self.newest, self.last_seq) {
            (Some(newest), Some(last))
                if matches!(newest.stage, Stage::Complete)
                    && newest.since_ns.abs_diff(received_ns) <= self.max_span_ns =>
            {
                match seq.wrapping_sub(last).cast_signed() {
                    0 => Relation::Same(newest.stage),
                    -128..=-1 => Relation::Behind,
                    _ => Relation::Ahead,
                }
            }
            _ => self.relation_to_newest(seq as u8, received_ns),
        }
    }

    /// Counts a sample as delivered, and the samples missing before it.
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

/// The samples that one frame completes: up to three, oldest first.
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

/// The newest sample: its counter byte, the stamp of its first frame, ns, and its stage.
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

/// A frame's counter byte relative to the newest sample's.
enum Relation {
    Ahead,
    Same(Stage),
    Behind,
}
