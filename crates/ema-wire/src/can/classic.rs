//! The four classic messages, 8 bytes each.
//!
//! The struct fields are the wire fields in their raw units; [`crate::quantity`] scales them. A field without a word
//! about validity has no invalid value: every bit pattern is a measurement.

use serde::{Deserialize, Serialize};

use super::{CLASSIC_LEN, ParseError};
use crate::quantity::wrap_s24;

/// Raw `load_torque` when nothing measures the torque.
const LOAD_TORQUE_NOT_MEASURED: i16 = i16::MIN;

/// B+0: phase currents and the sample counter. Positive current flows into the motor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Currents {
    /// Phase A, mA.
    pub i_a_ma: i16,
    /// Phase B, mA.
    pub i_b_ma: i16,
    /// Phase C, mA.
    pub i_c_ma: i16,
    /// Sample counter, wraps.
    pub seq: u16,
}

impl Currents {
    /// Reads the data bytes; all patterns are valid.
    #[must_use]
    pub fn parse(data: &[u8; CLASSIC_LEN]) -> Self {
        let [a0, a1, b0, b1, c0, c1, s0, s1] = *data;
        Self {
            i_a_ma: i16::from_le_bytes([a0, a1]),
            i_b_ma: i16::from_le_bytes([b0, b1]),
            i_c_ma: i16::from_le_bytes([c0, c1]),
            seq: u16::from_le_bytes([s0, s1]),
        }
    }

    /// Writes the data bytes.
    #[must_use]
    pub fn emit(&self) -> [u8; CLASSIC_LEN] {
        let ([a0, a1], [b0, b1]) = (self.i_a_ma.to_le_bytes(), self.i_b_ma.to_le_bytes());
        let ([c0, c1], [s0, s1]) = (self.i_c_ma.to_le_bytes(), self.seq.to_le_bytes());
        [a0, a1, b0, b1, c0, c1, s0, s1]
    }
}

/// B+1: both angle counters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Position {
    /// Resolver, 65 536 counts per motor turn, multi-turn, wraps.
    pub motor_counts: i32,
    /// Encoder, 20 000 counts per output turn, multi-turn, 24 bits, wraps. `emit` keeps the low 24 bits.
    pub output_counts: i32,
    /// Low byte of the sample counter.
    pub seq8: u8,
}

impl Position {
    /// Reads the data bytes; all patterns are valid.
    #[must_use]
    pub fn parse(data: &[u8; CLASSIC_LEN]) -> Self {
        let [m0, m1, m2, m3, o0, o1, o2, seq8] = *data;
        Self {
            motor_counts: i32::from_le_bytes([m0, m1, m2, m3]),
            output_counts: s24_from_le_bytes([o0, o1, o2]),
            seq8,
        }
    }

    /// Writes the data bytes.
    #[must_use]
    pub fn emit(&self) -> [u8; CLASSIC_LEN] {
        let ([m0, m1, m2, m3], [o0, o1, o2, _]) = (self.motor_counts.to_le_bytes(), self.output_counts.to_le_bytes());
        [m0, m1, m2, m3, o0, o1, o2, self.seq8]
    }
}

/// What the setpoint means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[repr(u8)]
pub enum Mode {
    /// Not controlled; the setpoint means nothing.
    #[default]
    Idle = 0,
    /// The setpoint is the output angle, 1 µrad.
    Position = 1,
    /// The setpoint is the motor speed, 1 mrad/s.
    Speed = 2,
}

impl Mode {
    /// Reads the mode byte that stands `at` this offset of a frame.
    pub(super) const fn parse(raw: u8, at: usize) -> Result<Self, ParseError> {
        match raw {
            0 => Ok(Self::Idle),
            1 => Ok(Self::Position),
            2 => Ok(Self::Speed),
            got => Err(ParseError::Mode { at, got }),
        }
    }
}

/// B+2: setpoint, mode and device time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Command {
    /// Position mode: 1 µrad at the output shaft; speed mode: 1 mrad/s at the motor shaft; idle: ignored.
    pub setpoint: i32,
    /// What the setpoint means; any other value than 0, 1, 2 makes the frame invalid.
    pub mode: Mode,
    /// Low 16 bits of the device's microseconds when the sample was latched; wraps every 65.536 ms.
    pub time_us: u16,
    /// Low byte of the sample counter.
    pub seq8: u8,
}

impl Command {
    const MODE_AT: usize = 4;

    /// Reads the data bytes.
    ///
    /// # Errors
    ///
    /// [`ParseError::Mode`] when the mode is unknown.
    pub fn parse(data: &[u8; CLASSIC_LEN]) -> Result<Self, ParseError> {
        let [p0, p1, p2, p3, mode, t0, t1, seq8] = *data;
        Ok(Self {
            setpoint: i32::from_le_bytes([p0, p1, p2, p3]),
            mode: Mode::parse(mode, Self::MODE_AT)?,
            time_us: u16::from_le_bytes([t0, t1]),
            seq8,
        })
    }

    /// Writes the data bytes.
    #[must_use]
    pub fn emit(&self) -> [u8; CLASSIC_LEN] {
        let ([p0, p1, p2, p3], [t0, t1]) = (self.setpoint.to_le_bytes(), self.time_us.to_le_bytes());
        [p0, p1, p2, p3, self.mode as u8, t0, t1, self.seq8]
    }
}

/// B+3, 10 Hz: slow quantities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Status {
    /// DC link voltage, 0.1 V.
    pub dc_link_dv: u16,
    /// Winding temperature, 0.1 °C.
    pub winding_temp_dc: i16,
    /// Load torque at the output, 0.1 Nm, positive when it opposes positive motion. `None` (raw 0x8000): not measured.
    /// `Some(-32768)` cannot be said on the wire; `emit` saturates it to -32767.
    pub load_torque_dnm: Option<i16>,
    /// Flags of the device, 0 when it has nothing to say. The bits are the device's own; here they are only carried.
    pub fault_flags: u8,
    /// Low byte of the counter of the latest sample.
    pub seq8: u8,
}

impl Status {
    /// Reads the data bytes; all patterns are valid.
    ///
    /// ```
    /// use ema_wire::can::Status;
    /// let status = Status::parse(&[0xd8, 0x0e, 0xfa, 0, 0x00, 0x80, 0, 9]);
    /// assert_eq!((status.dc_link_dv, status.winding_temp_dc), (3_800, 250)); // 380 V, 25 °C
    /// assert_eq!(status.load_torque_dnm, None);
    /// ```
    #[must_use]
    pub fn parse(data: &[u8; CLASSIC_LEN]) -> Self {
        let [v0, v1, w0, w1, l0, l1, fault_flags, seq8] = *data;
        Self {
            dc_link_dv: u16::from_le_bytes([v0, v1]),
            winding_temp_dc: i16::from_le_bytes([w0, w1]),
            load_torque_dnm: Some(i16::from_le_bytes([l0, l1])).filter(|raw| *raw != LOAD_TORQUE_NOT_MEASURED),
            fault_flags,
            seq8,
        }
    }

    /// Writes the data bytes.
    #[must_use]
    pub fn emit(&self) -> [u8; CLASSIC_LEN] {
        let load_torque = self
            .load_torque_dnm
            .map_or(LOAD_TORQUE_NOT_MEASURED, |raw| raw.max(-i16::MAX));
        let ([v0, v1], [w0, w1]) = (self.dc_link_dv.to_le_bytes(), self.winding_temp_dc.to_le_bytes());
        let [l0, l1] = load_torque.to_le_bytes();
        [v0, v1, w0, w1, l0, l1, self.fault_flags, self.seq8]
    }
}

/// Sign-extends three little-endian bytes.
pub(super) fn s24_from_le_bytes([b0, b1, b2]: [u8; 3]) -> i32 {
    wrap_s24(i64::from(u32::from_le_bytes([b0, b1, b2, 0])))
}
