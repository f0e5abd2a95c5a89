//! The serial line: samples and status as packets, emitted as COBS frames and parsed from a byte stream.
//!
//! ```text
//! COBS( version u8 | packet, postcard | CRC-32 of both, little-endian ) 0x00
//! ```
//!
//! The CRC is CRC-32/ISO-HDLC, as in zip and Ethernet (`zlib.crc32`). A zero byte occurs only at the end of a frame, so a
//! reader that joins late or has lost bytes is synchronised at the next zero. A frame has at most [`MAX_FRAME_LEN`] bytes.

use core::fmt;

use crc::{CRC_32_ISO_HDLC, Crc};
use postcard::ser_flavors::crc::CrcModifier;
use postcard::ser_flavors::{Cobs, Slice};
use serde::{Deserialize, Serialize};

use crate::can::Status;
use crate::cobs;
use crate::quantity::wrap_s24;
use crate::sample::{ActuatorId, Sample};

/// First byte of every packet. It changes with the meaning of any byte, so an old reader rejects the new packets.
pub const VERSION: u8 = 1;
/// Greatest length of a frame, bytes: a sample whose varints all have their greatest length, CRC, COBS code byte and the
/// zero at the end.
pub const MAX_FRAME_LEN: usize = 39;

const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
const CRC_LEN: usize = 4;

/// One packet of the serial line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum SerialPacket {
    /// One complete sample.
    Sample(Sample),
    /// Slow quantities of one actuator, 10 Hz.
    Status {
        /// The actuator that sends it.
        actuator: ActuatorId,
        /// The same fields as on CAN.
        status: Status,
    },
}

impl SerialPacket {
    /// Writes the frame, with the zero at its end, to the start of `buffer` and returns it. [`MAX_FRAME_LEN`] bytes suffice.
    ///
    /// # Errors
    ///
    /// [`BufferTooSmall`]; the content of the buffer is then unspecified.
    pub fn emit<'a>(&self, buffer: &'a mut [u8]) -> Result<&'a [u8], BufferTooSmall> {
        let too_small = BufferTooSmall {
            sufficient: MAX_FRAME_LEN,
            got: buffer.len(),
        };
        let packet = self.limited_to_can_ranges();
        let cobs = Cobs::try_new(Slice::new(buffer)).map_err(|_| too_small)?;
        let frame = postcard::serialize_with_flavor(&(VERSION, packet), CrcModifier::new(cobs, CRC.digest()));
        frame.map(|bytes: &mut [u8]| &*bytes).map_err(|_| too_small)
    }

    /// Parses one frame, given without the zero that ends it.
    ///
    /// ```
    /// use ema_wire::{FrameError, SerialPacket};
    /// assert_eq!(SerialPacket::parse(b"not a packet"), Err(FrameError::Cobs));
    /// ```
    ///
    /// # Errors
    ///
    /// The [`FrameError`] of the first layer that rejects the frame. No content is decoded before the CRC is checked.
    pub fn parse(frame: &[u8]) -> Result<Self, FrameError> {
        let mut buffer = [0; MAX_FRAME_LEN - 1];
        let frame = match buffer.get_mut(..frame.len()) {
            Some(copy) => {
                copy.copy_from_slice(frame);
                copy
            }
            None => return Err(FrameError::TooLong),
        };
        let len = cobs::decode_in_place(frame).ok_or(FrameError::Cobs)?;
        let (content, crc) = frame[..len].split_last_chunk::<CRC_LEN>().ok_or(FrameError::Crc)?;
        if CRC.checksum(content) != u32::from_le_bytes(*crc) {
            return Err(FrameError::Crc);
        }
        let (version, packet) = content.split_first().ok_or(FrameError::Decode)?;
        if *version != VERSION {
            return Err(FrameError::Version);
        }
        match postcard::take_from_bytes(packet) {
            // A sender of another make may exceed them.
            Ok((packet, [])) => Ok(SerialPacket::limited_to_can_ranges(packet)),
            _ => Err(FrameError::Decode),
        }
    }

    /// The packet limited to the ranges of the CAN fields, so that both transports deliver equal samples.
    fn limited_to_can_ranges(self) -> Self {
        match self {
            Self::Sample(sample) => Self::Sample(Sample {
                output_counts: wrap_s24(sample.output_counts.into()),
                ..sample
            }),
            Self::Status { actuator, status } => Self::Status {
                actuator,
                status: Status::parse(&status.emit()),
            },
        }
    }
}

/// The buffer given to [`SerialPacket::emit`] is too short for the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BufferTooSmall {
    /// Bytes that suffice for every packet.
    pub sufficient: usize,
    /// Bytes given.
    pub got: usize,
}

impl fmt::Display for BufferTooSmall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "serial buffer: {} bytes suffice, got {}", self.sufficient, self.got)
    }
}

impl core::error::Error for BufferTooSmall {}

/// Why a serial frame is dropped: the first layer that rejects it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameError {
    /// The frame is longer than any packet.
    TooLong,
    /// The frame is not valid COBS.
    Cobs,
    /// The CRC is wrong, or the frame is too short to contain one.
    Crc,
    /// The CRC is right, but the version is not [`VERSION`].
    Version,
    /// CRC and version are right, but the content is not a packet.
    Decode,
}

impl FrameError {
    /// All reasons, in the order of the layers.
    pub const ALL: [Self; 5] = [Self::TooLong, Self::Cobs, Self::Crc, Self::Version, Self::Decode];
}

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TooLong => "longer than any packet",
            Self::Cobs => "not valid COBS",
            Self::Crc => "wrong CRC",
            Self::Version => "unknown version",
            Self::Decode => "not a packet of this version",
        })
    }
}

impl core::error::Error for FrameError {}

/// Counts of good and dropped frames since the start.
///
/// A reader that joins a running line drops and counts one frame: the rest of the frame under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DeframerStats {
    /// Packets delivered.
    pub packets: u64,
    /// Frames with a wrong CRC, or too short to contain one.
    pub crc: u64,
    /// Frames that are not valid COBS.
    pub cobs: u64,
    /// Frames longer than any packet.
    pub too_long: u64,
    /// Frames whose CRC is right and whose version is not [`VERSION`].
    pub version: u64,
    /// Frames whose CRC and version are right and whose content is not a packet.
    pub decode: u64,
    /// Frames that were incomplete at the end of the stream.
    pub truncated: u64,
}

impl DeframerStats {
    /// Counts one frame by the result of [`SerialPacket::parse`].
    pub fn count(&mut self, parsed: &Result<SerialPacket, FrameError>) {
        let count = match parsed {
            Ok(_) => &mut self.packets,
            Err(FrameError::TooLong) => &mut self.too_long,
            Err(FrameError::Cobs) => &mut self.cobs,
            Err(FrameError::Crc) => &mut self.crc,
            Err(FrameError::Version) => &mut self.version,
            Err(FrameError::Decode) => &mut self.decode,
        };
        *count += 1;
    }

    /// Frames dropped for this reason.
    #[must_use]
    pub const fn dropped_for(&self, error: FrameError) -> u64 {
        match error {
            FrameError::TooLong => self.too_long,
            FrameError::Cobs => self.cobs,
            FrameError::Crc => self.crc,
            FrameError::Version => self.version,
            FrameError::Decode => self.decode,
        }
    }

    /// Frames dropped for any reason.
    #[must_use]
    pub const fn dropped(&self) -> u64 {
        self.crc + self.cobs + self.too_long + self.version + self.decode + self.truncated
    }
}

/// Splits a byte stream into frames at its zeros, in chunks of any size, with a buffer of `N` bytes.
///
/// Of a longer frame it yields the first `N` bytes. `N` exceeds the length of any packet, so [`SerialPacket::parse`] rejects
/// such a frame with [`FrameError::TooLong`].
#[derive(Debug, Clone)]
pub struct Splitter<const N: usize = 64> {
    buffer: [u8; N],
    /// Bytes of the frame so far, at most `N`.
    len: usize,
}

impl<const N: usize> Splitter<N> {
    const HOLDS_MORE_THAN_A_PACKET: () = assert!(N >= MAX_FRAME_LEN);

    /// A splitter at the start of a frame.
    #[must_use]
    pub const fn new() -> Self {
        const { Self::HOLDS_MORE_THAN_A_PACKET };
        Self { buffer: [0; N], len: 0 }
    }

    /// Takes the next byte. The zero at the end of a frame yields the frame, without that zero. Consecutive zeros yield no
    /// frames.
    pub fn push(&mut self, byte: u8) -> Option<&[u8]> {
        if byte == 0 {
            return self.finish();
        }
        if let Some(free) = self.buffer.get_mut(self.len) {
            *free = byte;
            self.len += 1;
        }
        None
    }

    /// Marks the end of the stream or a known break in it; yields the unfinished frame, if there is one.
    pub fn finish(&mut self) -> Option<&[u8]> {
        let len = core::mem::take(&mut self.len);
        self.buffer.get(..len).filter(|frame| !frame.is_empty())
    }
}

impl<const N: usize> Default for Splitter<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// Finds the packets in a byte stream, in chunks of any size, in fixed memory, and counts the dropped frames.
///
/// ```
/// use ema_wire::{ActuatorId, Deframer, SerialPacket, Status};
/// let status =
///     Status { dc_link_dv: 3_800, winding_temp_dc: 251, load_torque_dnm: None, fault_flags: 0, seq8: 9 };
/// let packet = SerialPacket::Status { actuator: ActuatorId::new(3).expect("0 to 15"), status };
/// let mut buffer = [0; ema_wire::serial::MAX_FRAME_LEN];
/// let frame = packet.emit(&mut buffer)?;
///
/// let mut deframer = Deframer::new();
/// let line = [b"noise\0", frame, &frame[..5], b"\0", frame].concat();
/// let packets: Vec<SerialPacket> = deframer.push_slice(&line).collect();
/// assert_eq!(packets, [packet, packet]);
/// assert_eq!(deframer.stats().dropped(), 2);
/// # Ok::<(), ema_wire::serial::BufferTooSmall>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Deframer {
    splitter: Splitter,
    stats: DeframerStats,
}

impl Deframer {
    /// A deframer at the start of a frame.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Counts so far.
    #[must_use]
    pub const fn stats(&self) -> DeframerStats {
        self.stats
    }

    /// Takes the next byte. The zero at the end of a good frame yields its packet. Consecutive zeros are not frames.
    pub fn push(&mut self, byte: u8) -> Option<SerialPacket> {
        let parsed = SerialPacket::parse(self.splitter.push(byte)?);
        self.stats.count(&parsed);
        parsed.ok()
    }

    /// Takes a chunk and yields its packets. The iterator consumes the bytes as it advances: run it to its end.
    pub fn push_slice<'a>(&'a mut self, bytes: &'a [u8]) -> impl Iterator<Item = SerialPacket> + 'a {
        bytes.iter().filter_map(|byte| self.push(*byte))
    }

    /// Marks the end of the stream or a known break in it; an unfinished frame counts as truncated.
    pub fn finish(&mut self) {
        if self.splitter.finish().is_some() {
            self.stats.truncated += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::Mode;

    #[test]
    fn a_packet_of_another_sender_is_limited_to_the_ranges_of_can() {
        let sample = |output_counts| {
            SerialPacket::Sample(Sample {
                actuator: ActuatorId::new(3).unwrap(),
                seq: 7,
                time_us: 0,
                i_a_ma: 0,
                i_b_ma: 0,
                i_c_ma: 0,
                motor_counts: 0,
                output_counts,
                setpoint: 0,
                mode: Mode::Position,
            })
        };
        let mut buffer = [0; MAX_FRAME_LEN];
        let cobs = Cobs::try_new(Slice::new(&mut buffer)).unwrap();
        let crc = CrcModifier::new(cobs, CRC.digest());
        let frame: &mut [u8] = postcard::serialize_with_flavor(&(VERSION, sample(1 << 23)), crc).unwrap();
        let (_, frame) = frame.split_last().unwrap();
        assert_eq!(SerialPacket::parse(frame), Ok(sample(-(1 << 23))));
    }
}
