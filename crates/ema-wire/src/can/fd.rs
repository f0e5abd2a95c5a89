//! `SampleFd`: up to three complete samples in one CAN FD frame of 64 bytes.
//!
//! | bytes | field |
//! |---|---|
//! | 0–1 | `seq` u16, counter of the first sample; slot k has `seq + k` |
//! | 2 | `count` u8, slots in use, 1 to 3 |
//! | 3 | `layout` u8, this layout is 1 |
//! | 4 + 20k … | slot k: `i_a`, `i_b`, `i_c` s16; `motor_counts` s32; `output_counts` s24; `mode` u8; `setpoint` s32; `time_us` u16 |
//!
//! Every sample has full resolution, its own time and its own mode; 4 + 3 × 20 bytes fill the frame exactly. Differences
//! between samples instead of values would make room for a fourth sample at best, and one slot would depend on another.
//! Unused slots are emitted as zeros and not parsed.

use super::classic::{parse_mode, s24_from_le_bytes};
use super::{BatchError, FD_LEN, ParseError};
use crate::sample::{ActuatorId, Mode, Sample};

const HEADER_LEN: usize = 4;
const SLOT_LEN: usize = 20;
const MODE_AT: usize = 13;

/// One sample inside a [`SampleFd`]; fields as in [`Sample`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FdSlot {
    /// Phase A, mA.
    pub i_a_ma: i16,
    /// Phase B, mA.
    pub i_b_ma: i16,
    /// Phase C, mA.
    pub i_c_ma: i16,
    /// Resolver counts, wraps.
    pub motor_counts: i32,
    /// Encoder counts, 24 bits, wraps.
    pub output_counts: i32,
    /// Quantity that the setpoint commands.
    pub mode: Mode,
    /// 1 µrad or 1 mrad/s, by `mode`.
    pub setpoint: i32,
    /// Low 16 bits of the device's microseconds.
    pub time_us: u16,
}

/// B+8, CAN FD: consecutive samples of one actuator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SampleFd {
    seq: u16,
    count: u8,
    slots: [FdSlot; Self::MAX_SAMPLES],
}

impl SampleFd {
    /// Slots in one frame.
    pub const MAX_SAMPLES: usize = 3;
    /// Number in byte 3. It changes with the meaning of any byte, so an old reader rejects the new frames.
    pub const LAYOUT: u8 = 1;

    /// Packs 1 to 3 consecutive samples.
    ///
    /// # Errors
    ///
    /// [`BatchError`] when there are no samples or too many, or they are of two actuators or not consecutive.
    pub fn from_samples(samples: &[Sample]) -> Result<Self, BatchError> {
        let count_error = BatchError::Count {
            max: Self::MAX_SAMPLES,
            got: samples.len(),
        };
        let first = samples.first().ok_or(count_error)?;
        let mut packed = Self {
            seq: first.seq,
            count: samples.len() as u8,
            slots: [FdSlot::default(); Self::MAX_SAMPLES],
        };
        if samples.len() > Self::MAX_SAMPLES {
            return Err(count_error);
        }
        let mut expected = first.seq;
        for (slot, sample) in packed.slots.iter_mut().zip(samples) {
            if sample.actuator != first.actuator {
                return Err(BatchError::Actuator {
                    expected: first.actuator,
                    got: sample.actuator,
                });
            }
            if sample.seq != expected {
                return Err(BatchError::Seq {
                    expected,
                    got: sample.seq,
                });
            }
            *slot = FdSlot::from(sample);
            expected = expected.wrapping_add(1);
        }
        Ok(packed)
    }

    /// Counter of the first sample.
    #[must_use]
    pub const fn seq(&self) -> u16 {
        self.seq
    }

    /// The slots in use, oldest first.
    #[must_use]
    pub fn slots(&self) -> &[FdSlot] {
        &self.slots[..usize::from(self.count)]
    }

    /// The samples, oldest first. The data bytes do not contain the actuator; the identifier does.
    pub fn samples(&self, actuator: ActuatorId) -> impl ExactSizeIterator<Item = Sample> + '_ {
        self.slots().iter().enumerate().map(move |(k, slot)| Sample {
            actuator,
            seq: self.seq.wrapping_add(k as u16),
            time_us: slot.time_us,
            i_a_ma: slot.i_a_ma,
            i_b_ma: slot.i_b_ma,
            i_c_ma: slot.i_c_ma,
            motor_counts: slot.motor_counts,
            output_counts: slot.output_counts,
            setpoint: slot.setpoint,
            mode: slot.mode,
        })
    }

    /// Parses the data bytes.
    ///
    /// # Errors
    ///
    /// [`ParseError::Layout`], [`ParseError::Count`], or [`ParseError::Mode`] of a slot in use.
    pub fn parse(data: &[u8; FD_LEN]) -> Result<Self, ParseError> {
        let (&[seq_0, seq_1, count, layout], body) = split(data);
        if layout != Self::LAYOUT {
            return Err(ParseError::Layout {
                expected: Self::LAYOUT,
                got: layout,
            });
        }
        if count == 0 || usize::from(count) > Self::MAX_SAMPLES {
            return Err(ParseError::Count {
                max: Self::MAX_SAMPLES as u8,
                got: count,
            });
        }
        let mut slots = [FdSlot::default(); Self::MAX_SAMPLES];
        for (k, (slot, bytes)) in slots.iter_mut().zip(body).take(usize::from(count)).enumerate() {
            *slot = FdSlot::parse(bytes, HEADER_LEN + SLOT_LEN * k)?;
        }
        Ok(Self {
            seq: u16::from_le_bytes([seq_0, seq_1]),
            count,
            slots,
        })
    }

    /// Writes the data bytes.
    #[must_use]
    pub fn emit(&self) -> [u8; FD_LEN] {
        let mut data = [0; FD_LEN];
        let [seq_0, seq_1] = self.seq.to_le_bytes();
        data[..HEADER_LEN].copy_from_slice(&[seq_0, seq_1, self.count, Self::LAYOUT]);
        for (bytes, slot) in data[HEADER_LEN..].chunks_exact_mut(SLOT_LEN).zip(self.slots()) {
            bytes.copy_from_slice(&slot.emit());
        }
        data
    }
}

impl FdSlot {
    /// Parses one slot; `start` is its offset in the frame, for the error.
    fn parse(bytes: &[u8; SLOT_LEN], start: usize) -> Result<Self, ParseError> {
        let [
            a0,
            a1,
            b0,
            b1,
            c0,
            c1,
            m0,
            m1,
            m2,
            m3,
            o0,
            o1,
            o2,
            mode,
            p0,
            p1,
            p2,
            p3,
            t0,
            t1,
        ] = *bytes;
        Ok(Self {
            i_a_ma: i16::from_le_bytes([a0, a1]),
            i_b_ma: i16::from_le_bytes([b0, b1]),
            i_c_ma: i16::from_le_bytes([c0, c1]),
            motor_counts: i32::from_le_bytes([m0, m1, m2, m3]),
            output_counts: s24_from_le_bytes([o0, o1, o2]),
            mode: parse_mode(mode, start + MODE_AT)?,
            setpoint: i32::from_le_bytes([p0, p1, p2, p3]),
            time_us: u16::from_le_bytes([t0, t1]),
        })
    }

    fn emit(&self) -> [u8; SLOT_LEN] {
        let ([a0, a1], [b0, b1]) = (self.i_a_ma.to_le_bytes(), self.i_b_ma.to_le_bytes());
        let ([c0, c1], [t0, t1]) = (self.i_c_ma.to_le_bytes(), self.time_us.to_le_bytes());
        let ([m0, m1, m2, m3], [o0, o1, o2, _]) = (self.motor_counts.to_le_bytes(), self.output_counts.to_le_bytes());
        let [p0, p1, p2, p3] = self.setpoint.to_le_bytes();
        [
            a0,
            a1,
            b0,
            b1,
            c0,
            c1,
            m0,
            m1,
            m2,
            m3,
            o0,
            o1,
            o2,
            self.mode as u8,
            p0,
            p1,
            p2,
            p3,
            t0,
            t1,
        ]
    }
}

impl From<&Sample> for FdSlot {
    fn from(sample: &Sample) -> Self {
        Self {
            i_a_ma: sample.i_a_ma,
            i_b_ma: sample.i_b_ma,
            i_c_ma: sample.i_c_ma,
            motor_counts: sample.motor_counts,
            output_counts: sample.output_counts,
            mode: sample.mode,
            setpoint: sample.setpoint,
            time_us: sample.time_us,
        }
    }
}

/// Header and slots of a frame; the assertion below proves that the sizes fit.
fn split(data: &[u8; FD_LEN]) -> (&[u8; HEADER_LEN], &[[u8; SLOT_LEN]]) {
    let (slots, _) = data[HEADER_LEN..].as_chunks();
    let (header, _) = data.as_chunks();
    (&header[0], slots)
}

const _: () = assert!(HEADER_LEN + SLOT_LEN * SampleFd::MAX_SAMPLES == FD_LEN);
