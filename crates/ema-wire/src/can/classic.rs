//! The four classic messages, 8 bytes each, with `parse` and `emit`; and a [`Sample`] as three of them.
//!
//! The struct fields are the wire fields in raw units; [`crate::quantity`] converts them. Every bit pattern of a field is
//! valid unless its documentation excludes some.

use serde::{Deserialize, Serialize};

use super::{CLASSIC_LEN, Frame, ParseError};
use crate::quantity::wrap_s24;
use crate::sample::{ActuatorId, Mode, Sample};

/// Raw `load_torque` of an actuator without a torque sensor.
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
    /// Parses the data bytes; every bit pattern is valid.
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
    /// Encoder, 20 000 counts per output turn, multi-turn, 24 bits, wraps. `emit` writes the low 24 bits.
    pub output_counts: i32,
    /// Low byte of the sample counter.
    pub seq8: u8,
}

impl Position {
    /// Parses the data bytes; every bit pattern is valid.
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

/// B+2: setpoint, mode and device time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Command {
    /// Position mode: 1 µrad at the output shaft; speed mode: 1 mrad/s at the motor shaft; idle: ignored.
    pub setpoint: i32,
    /// Quantity that the setpoint commands; a byte other than 0, 1, 2 makes the frame invalid.
    pub mode: Mode,
    /// Device time at which the sample was latched, low 16 bits of the microseconds; wraps every 65.536 ms.
    pub time_us: u16,
    /// Low byte of the sample counter.
    pub seq8: u8,
}

impl Command {
    const MODE_AT: usize = 4;

    /// Parses the data bytes.
    ///
    /// # Errors
    ///
    /// [`ParseError::Mode`] when the mode is unknown.
    pub fn parse(data: &[u8; CLASSIC_LEN]) -> Result<Self, ParseError> {
        let [p0, p1, p2, p3, mode, t0, t1, seq8] = *data;
        Ok(Self {
            setpoint: i32::from_le_bytes([p0, p1, p2, p3]),
            mode: parse_mode(mode, Self::MODE_AT)?,
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
    /// Winding temperature, 0.1 °C; [`Status::NO_TEMPERATURE`] (raw 0x8000): not measured.
    pub winding_temp_dc: i16,
    /// Load torque at the output, 0.1 Nm, positive when it opposes positive motion. `None` (raw 0x8000): not measured.
    /// The wire has no code for `Some(-32768)`; `emit` saturates it to -32767.
    pub load_torque_dnm: Option<i16>,
    /// Flags of the device, 0 = none. The device defines the bits; this crate does not interpret them.
    pub fault_flags: u8,
    /// Low byte of the counter of the latest sample.
    pub seq8: u8,
}

impl Status {
    /// Winding temperature that is none.
    pub const NO_TEMPERATURE: i16 = i16::MIN;

    /// Parses the data bytes; every bit pattern is valid.
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

impl Sample {
    /// The three classic frames of this sample, in the order in which a device sends them.
    #[must_use]
    pub fn to_frames(&self) -> [Frame; 3] {
        let seq8 = self.seq8();
        [
            Frame::Currents(Currents {
                i_a_ma: self.i_a_ma,
                i_b_ma: self.i_b_ma,
                i_c_ma: self.i_c_ma,
                seq: self.seq,
            }),
            Frame::Position(Position {
                motor_counts: self.motor_counts,
                output_counts: self.output_counts,
                seq8,
            }),
            Frame::Command(Command {
                setpoint: self.setpoint,
                mode: self.mode,
                time_us: self.time_us,
                seq8,
            }),
        ]
    }

    /// Joins three frames into a sample; `None` unless they carry the same counter byte.
    ///
    /// The byte repeats every 256 samples, so the caller must know that the frames are closer than that;
    /// [`crate::Assembler`] does.
    #[must_use]
    pub fn from_parts(
        actuator: ActuatorId,
        currents: &Currents,
        position: &Position,
        command: &Command,
    ) -> Option<Self> {
        let seq8 = currents.seq as u8;
        (position.seq8 == seq8 && command.seq8 == seq8).then_some(Self {
            actuator,
            seq: currents.seq,
            time_us: command.time_us,
            i_a_ma: currents.i_a_ma,
            i_b_ma: currents.i_b_ma,
            i_c_ma: currents.i_c_ma,
            motor_counts: position.motor_counts,
            output_counts: position.output_counts,
            setpoint: command.setpoint,
            mode: command.mode,
        })
    }
}

/// Parses the mode byte at offset `at` of a frame.
pub(super) const fn parse_mode(raw: u8, at: usize) -> Result<Mode, ParseError> {
    match raw {
        0 => Ok(Mode::Idle),
        1 => Ok(Mode::Position),
        2 => Ok(Mode::Speed),
        got => Err(ParseError::Mode { at, got }),
    }
}

/// Sign-extends three little-endian bytes.
pub(super) fn s24_from_le_bytes([b0, b1, b2]: [u8; 3]) -> i32 {
    wrap_s24(i64::from(u32::from_le_bytes([b0, b1, b2, 0])))
}
