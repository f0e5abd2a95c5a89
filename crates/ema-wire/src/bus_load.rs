//! Share of a CAN bus, a CAN FD bus or a serial line that a number of actuators takes at a sampling rate.
//!
//! A classic frame with an 11-bit identifier and n data bytes has `44 + 8n` bits, a pause of 3 bits, and stuff bits: CAN
//! inserts one after five equal bits among the first `34 + 8n`. Their number depends on the data: 0 at least,
//! `(33 + 8n) / 4` at most. [`Stuffing::Nominal`] is one per ten bits, which lies slightly above the data of an actuator:
//! `tests/all/bus_load.rs` counts a mean of 117.6 bits per sample frame. A frame of 8 bytes has 111 bits without stuffing, 120
//! with nominal and 135 with worst-case stuffing.

use crate::can::{CLASSIC_LEN, FD_LEN, SampleFd};
use crate::serial::MAX_FRAME_LEN;

/// Rate of the status frame, 1/s.
pub const STATUS_RATE_HZ: f64 = 10.0;

const FRAMES_PER_SAMPLE: f64 = 3.0;
/// Identifier, control and CRC bits that may be stuffed.
const CLASSIC_STUFFED_OVERHEAD_BITS: u32 = 34;
/// CRC delimiter, acknowledge slot and delimiter, end of frame (7), pause (3).
const UNSTUFFED_TAIL_BITS: u32 = 13;
/// Start bit, identifier (11), RRS, IDE, FDF, res, BRS: sent at the slow rate.
const FD_ARBITRATION_BITS: u32 = 17;
/// ESI and DLC (4), sent at the fast rate before the data.
const FD_CONTROL_BITS: u32 = 5;
/// Stuff count (4), CRC of frames above 16 bytes (21), and a fixed stuff bit before every four of them (7).
const FD_CRC_BITS: u32 = 32;

/// Assumed number of stuff bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Stuffing {
    /// None: the lower bound of a frame's length.
    None,
    /// One per ten bits that may be stuffed: typical of actuator frames. [`bus_load`] and [`fd_bus_load`] use it.
    #[default]
    Nominal,
    /// The most that the stuffing rule can insert: the upper bound of a frame's length.
    Worst,
}

impl Stuffing {
    const fn bits(self, stuffable: u32) -> u32 {
        match self {
            Self::None => 0,
            Self::Nominal => stuffable / 10,
            Self::Worst => (stuffable - 1) / 4,
        }
    }
}

/// Length of one classic frame with an 11-bit identifier, in bits, including the pause after it.
///
/// ```
/// use ema_wire::bus_load::{Stuffing, classic_frame_bits};
/// assert_eq!([Stuffing::None, Stuffing::Nominal, Stuffing::Worst].map(|s| classic_frame_bits(8, s)), [111, 120, 135]);
/// ```
///
/// # Panics
///
/// When `data_bytes` is above 8.
#[must_use]
pub const fn classic_frame_bits(data_bytes: u32, stuffing: Stuffing) -> u32 {
    assert!(data_bytes as usize <= CLASSIC_LEN);
    let stuffable = CLASSIC_STUFFED_OVERHEAD_BITS + 8 * data_bytes;
    stuffable + stuffing.bits(stuffable) + UNSTUFFED_TAIL_BITS
}

/// Share of a classic bus that `actuators` actuators take, each with `rate_hz` samples per second and its status frames.
///
/// 1.0 is a full bus. The result assumes nominal stuffing.
///
/// ```
/// use ema_wire::bus_load::bus_load;
/// assert!((bus_load(2_000.0, 1, 1e6) - 0.72).abs() < 0.005);
/// assert!((bus_load(400.0, 1, 1e6) - 0.145).abs() < 0.005);
/// assert!(bus_load(400.0, 6, 1e6) < 0.9 && bus_load(400.0, 7, 1e6) > 0.9); // six on one bus, not seven
/// ```
#[must_use]
pub fn bus_load(rate_hz: f64, actuators: u32, bitrate_bit_s: f64) -> f64 {
    let frames_per_s = f64::from(actuators) * (FRAMES_PER_SAMPLE * rate_hz + STATUS_RATE_HZ);
    frames_per_s * classic_frame_seconds(bitrate_bit_s)
}

/// Share of a CAN FD bus: full `SampleFd` frames with bit rate switching, and classic status frames; 1.0 is a full bus.
///
/// ```
/// use ema_wire::bus_load::fd_bus_load;
/// let load = fd_bus_load(400.0, 16, 1e6, 5e6);
/// assert!(load < 0.5, "sixteen actuators at 400 Hz fit one FD bus: {load}");
/// ```
#[must_use]
pub fn fd_bus_load(rate_hz: f64, actuators: u32, bitrate_bit_s: f64, data_bitrate_bit_s: f64) -> f64 {
    let frame_s = fd_frame_seconds(FD_LEN as u32, bitrate_bit_s, data_bitrate_bit_s);
    let per_actuator =
        rate_hz / SampleFd::MAX_SAMPLES as f64 * frame_s + STATUS_RATE_HZ * classic_frame_seconds(bitrate_bit_s);
    f64::from(actuators) * per_actuator
}

/// Duration of a CAN FD frame with an 11-bit identifier and bit rate switching, s.
///
/// The result assumes nominal stuffing and the CRC-21 of frames with more than 16 data bytes; it is slightly too long for
/// shorter frames.
#[must_use]
pub fn fd_frame_seconds(data_bytes: u32, bitrate_bit_s: f64, data_bitrate_bit_s: f64) -> f64 {
    let stuffing = Stuffing::Nominal;
    let slow = FD_ARBITRATION_BITS + stuffing.bits(FD_ARBITRATION_BITS) + UNSTUFFED_TAIL_BITS;
    let stuffable = FD_CONTROL_BITS + 8 * data_bytes;
    let fast = stuffable + stuffing.bits(stuffable) + FD_CRC_BITS;
    f64::from(slow) / bitrate_bit_s + f64::from(fast) / data_bitrate_bit_s
}

/// Share of a serial line that `actuators` actuators take, each with `rate_hz` samples per second and its status packets.
///
/// 1.0 is a full line. The result assumes eight data bits, one start and one stop bit, and frames of the greatest length.
///
/// ```
/// use ema_wire::bus_load::serial_load;
/// assert!((serial_load(2_000.0, 1, 921_600.0) - 0.85).abs() < 0.005);
/// ```
#[must_use]
pub fn serial_load(rate_hz: f64, actuators: u32, bitrate_bit_s: f64) -> f64 {
    const BITS_PER_BYTE: f64 = 10.0;
    let frames_per_s = f64::from(actuators) * (rate_hz + STATUS_RATE_HZ);
    frames_per_s * MAX_FRAME_LEN as f64 * BITS_PER_BYTE / bitrate_bit_s
}

fn classic_frame_seconds(bitrate_bit_s: f64) -> f64 {
    f64::from(classic_frame_bits(CLASSIC_LEN as u32, Stuffing::Nominal)) / bitrate_bit_s
}
