//! The serial line: the same samples as packets of bytes.
//!
//! ```text
//! COBS( version u8 | packet, postcard | CRC-32 of both, little-endian ) 0x00
//! ```
//!
//! The CRC is the one of zip and Ethernet (`zlib.crc32`). A zero byte appears nowhere but at the end of a frame, so a
//! reader that joins late or lost bytes finds its place again at the next zero. Packets are at most
//! [`MAX_FRAME_LEN`] bytes long.

use core::fmt;

use crc::{CRC_32_ISO_HDLC, Crc};
use postcard::ser_flavors::crc::CrcModifier;
use postcard::ser_flavors::{Cobs, Slice};
use serde::{Deserialize, Serialize};

use crate::can::{ActuatorId, Status};
use crate::cobs;
use crate::quantity::wrap_s24;
use crate::sample::Sample;

/// First byte of every packet; it changes when any packet's bytes change their meaning.
pub const VERSION: u8 = 1;
/// Longest frame on the line: a sample with every varint at its longest, CRC, COBS code byte and the closing zero.
pub const MAX_FRAME_LEN: usize = 39;

const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
const CRC_LEN: usize = 4;

/// One packet of the serial line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum SerialPacket {
    /// One sample, whole.
    Sample(Sample),
    /// The slow quantities of one actuator, 10 Hz.
    Status {
        /// Whose status.
        actuator: ActuatorId,
        /// The same fields as on CAN.
        status: Status,
    },
}

impl SerialPacket {
    /// Writes the frame, closing zero included, to the start of `buffer` and returns it. [`MAX_FRAME_LEN`] bytes suffice.
    ///
    /// # Errors
    ///
    /// [`BufferTooSmall`], with the buffer's content unspecified.
    pub fn emit<'a>(&self, buffer: &'a mut [u8]) -> Result<&'a [u8], BufferTooSmall> {
        let too_small = BufferTooSmall {
            sufficient: MAX_FRAME_LEN,
            got: buffer.len(),
        };
        let packet = self.as_on_can();
        let cobs = Cobs::try_new(Slice::new(buffer)).map_err(|_| too_small)?;
        let frame = postcard::serialize_with_flavor(&(VERSION, packet), CrcModifier::new(cobs, CRC.digest()));
        frame.map(|bytes: &mut [u8]| &*bytes).map_err(|_| too_small)
    }

    /// Reads one frame, without the zero that ends it.
    ///
    /// ```
    /// use ema_wire::{FrameFault, SerialPacket};
    /// assert_eq!(SerialPacket::parse(b"not a packet"), Err(FrameFault::Cobs));
    /// ```
    ///
    /// # Errors
    ///
    /// The [`FrameFault`] of the first layer that refuses it. Nothing is interpreted before the CRC is right.
    pub fn parse(frame: &[u8]) -> Result<Self, FrameFault> {
        let mut buffer = [0; MAX_FRAME_LEN - 1];
        let frame = match buffer.get_mut(..frame.len()) {
            Some(copy) => {
                copy.copy_from_slice(frame);
                copy
            }
            None => return Err(FrameFault::TooLong),
        };
        let len = cobs::decode_in_place(frame).ok_or(FrameFault::Cobs)?;
        let (content, crc) = frame[..len].split_last_chunk::<CRC_LEN>().ok_or(FrameFault::Crc)?;
        if CRC.checksum(content) != u32::from_le_bytes(*crc) {
            return Err(FrameFault::Crc);
        }
        let (version, packet) = content.split_first().ok_or(FrameFault::Decode)?;
        if *version != VERSION {
            return Err(FrameFault::Version);
        }
        match postcard::take_from_bytes(packet) {
            Ok((packet, [])) => Ok(packet),
            _ => Err(FrameFault::Decode),
        }
    }

    /// The packet with the limits that the CAN fields have, so that a sample is the same whichever way it came.
    fn as_on_can(self) -> Self {
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

/// The buffer given to [`SerialPacket::emit`] does not hold the frame.
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

/// Why a frame was dropped: the first layer that refuses it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameFault {
    /// Longer than any packet.
    TooLong,
    /// No COBS.
    Cobs,
    /// The CRC is wrong, or there is no room for one.
    Crc,
    /// The CRC is right, and the version not ours.
    Version,
    /// The CRC is right, and the content no packet of this version.
    Decode,
}

impl FrameFault {
    /// All of them, in the order of the layers.
    pub const ALL: [Self; 5] = [Self::TooLong, Self::Cobs, Self::Crc, Self::Version, Self::Decode];
}

impl fmt::Display for FrameFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TooLong => "longer than any packet",
            Self::Cobs => "no COBS",
            Self::Crc => "wrong CRC",
            Self::Version => "another version",
            Self::Decode => "not a packet of this version",
        })
    }
}

impl core::error::Error for FrameFault {}

/// Counts of good and dropped frames, since the start.
///
/// A reader that joins a running line drops one frame (the rest of the one in flight), and counts it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DeframerStats {
    /// Packets delivered.
    pub packets: u64,
    /// Frames with a wrong CRC, or too short to have one.
    pub crc: u64,
    /// Frames that are no COBS.
    pub cobs: u64,
    /// Frames longer than any packet.
    pub too_long: u64,
    /// Frames whose CRC is right and whose version is not ours.
    pub version: u64,
    /// Frames whose CRC is right and whose content is not a packet of this version.
    pub decode: u64,
    /// Frames begun and not ended when the stream ended.
    pub truncated: u64,
}

impl DeframerStats {
    /// Counts one frame by what came of it.
    pub fn count(&mut self, parsed: &Result<SerialPacket, FrameFault>) {
        let count = match parsed {
            Ok(_) => &mut self.packets,
            Err(FrameFault::TooLong) => &mut self.too_long,
            Err(FrameFault::Cobs) => &mut self.cobs,
            Err(FrameFault::Crc) => &mut self.crc,
            Err(FrameFault::Version) => &mut self.version,
            Err(FrameFault::Decode) => &mut self.decode,
        };
        *count += 1;
    }

    /// Frames dropped for this reason.
    #[must_use]
    pub const fn dropped_for(&self, fault: FrameFault) -> u64 {
        match fault {
            FrameFault::TooLong => self.too_long,
            FrameFault::Cobs => self.cobs,
            FrameFault::Crc => self.crc,
            FrameFault::Version => self.version,
            FrameFault::Decode => self.decode,
        }
    }

    /// All dropped frames.
    #[must_use]
    pub const fn dropped(&self) -> u64 {
        self.crc + self.cobs + self.too_long + self.version + self.decode + self.truncated
    }
}

/// Cuts a stream of bytes into frames at its zeros, in chunks of any size, with a buffer of `N` bytes and no other memory.
///
/// A frame that does not fit comes out as its first `N` bytes, which are more than any packet has: whoever parses it sees
/// that it was too long.
#[derive(Debug, Clone)]
pub struct Splitter<const N: usize = 64> {
    buffer: [u8; N],
    /// Bytes of the frame so far, at most `N`.
    len: usize,
}

impl<const N: usize> Splitter<N> {
    const TELLS_WHAT_IS_TOO_LONG: () = assert!(N >= MAX_FRAME_LEN);

    /// Empty, as if the last byte had been a zero.
    #[must_use]
    pub const fn new() -> Self {
        const { Self::TELLS_WHAT_IS_TOO_LONG };
        Self { buffer: [0; N], len: 0 }
    }

    /// Takes the next byte; the frame comes out, without its zero, with the zero that ends it. Zeros in a row are no
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

    /// End of the stream, or a known break in it: what there is of an unfinished frame.
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

/// Finds the packets in a stream of bytes, in chunks of any size and in fixed memory.
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
    /// Empty, as if the last byte had been a zero.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Counts so far.
    #[must_use]
    pub const fn stats(&self) -> DeframerStats {
        self.stats
    }

    /// Takes the next byte; a packet comes out with the zero that ends a good frame. Zeros in a row are no frames.
    pub fn push(&mut self, byte: u8) -> Option<SerialPacket> {
        let parsed = SerialPacket::parse(self.splitter.push(byte)?);
        self.stats.count(&parsed);
        parsed.ok()
    }

    /// Takes a chunk and yields its packets. Bytes are consumed as the iterator is: run it to its end.
    pub fn push_slice<'a>(&'a mut self, bytes: &'a [u8]) -> impl Iterator<Item = SerialPacket> + 'a {
        bytes.iter().filter_map(|byte| self.push(*byte))
    }

    /// End of the stream, or a known break in it: an unfinished frame counts as truncated.
    pub fn finish(&mut self) {
        if self.splitter.finish().is_some() {
            self.stats.truncated += 1;
        }
    }
}
