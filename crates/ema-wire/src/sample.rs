//! [`Sample`]: what one actuator latched at one instant.

use serde::{Deserialize, Serialize};

use crate::can::{ActuatorId, Command, Currents, Frame, Mode, Position};
use crate::quantity::{current_a, position_setpoint_rad, speed_setpoint_rad_s};

/// One complete sample in raw units; everything in it was latched together at `t0 + seq / f_s`.
///
/// ```
/// use ema_wire::{ActuatorId, Mode, Sample};
/// let sample = Sample {
///     actuator: ActuatorId::new(0).expect("0 to 15"),
///     seq: 0x0203,
///     time_us: 1_500,
///     i_a_ma: 1_000,
///     i_b_ma: -500,
///     i_c_ma: -500,
///     motor_counts: 260_757,
///     output_counts: 795,
///     setpoint: 250_000,
///     mode: Mode::Position,
/// };
/// assert!(sample.currents_a().iter().sum::<f64>().abs() < 1e-12); // star point: the phases sum to zero
/// assert_eq!(sample.setpoint_rad(), Some(0.25));
/// assert_eq!(sample.setpoint_rad_s(), None);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sample {
    /// Whose sample.
    pub actuator: ActuatorId,
    /// Sample counter, wraps.
    pub seq: u16,
    /// Low 16 bits of the device's microseconds; wraps every 65.536 ms.
    pub time_us: u16,
    /// Phase A, mA.
    pub i_a_ma: i16,
    /// Phase B, mA.
    pub i_b_ma: i16,
    /// Phase C, mA.
    pub i_c_ma: i16,
    /// Resolver, 65 536 counts per motor turn, wraps.
    pub motor_counts: i32,
    /// Encoder, 20 000 counts per output turn, 24 bits, wraps.
    pub output_counts: i32,
    /// Position mode: 1 µrad at the output; speed mode: 1 mrad/s at the motor; idle: ignored.
    pub setpoint: i32,
    /// What the setpoint means.
    pub mode: Mode,
}

impl Sample {
    /// The three classic frames, in the order in which they go out.
    #[must_use]
    pub fn to_frames(&self) -> [Frame; 3] {
        let &Self {
            seq,
            time_us,
            i_a_ma,
            i_b_ma,
            i_c_ma,
            motor_counts,
            output_counts,
            setpoint,
            mode,
            ..
        } = self;
        let seq8 = self.seq8();
        [
            Frame::Currents(Currents {
                i_a_ma,
                i_b_ma,
                i_c_ma,
                seq,
            }),
            Frame::Position(Position {
                motor_counts,
                output_counts,
                seq8,
            }),
            Frame::Command(Command {
                setpoint,
                mode,
                time_us,
                seq8,
            }),
        ]
    }

    /// Joins the three parts of one sample; `None` unless they carry the same counter.
    ///
    /// The counter of two parts is one byte, so the caller must know that the parts are less than 256 samples apart;
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

    /// Low byte of the counter, as in the position and command frames.
    #[must_use]
    pub const fn seq8(&self) -> u8 {
        self.seq as u8
    }

    /// Phase currents A, B, C in A.
    #[must_use]
    pub fn currents_a(&self) -> [f64; 3] {
        [current_a(self.i_a_ma), current_a(self.i_b_ma), current_a(self.i_c_ma)]
    }

    /// Commanded output angle in rad; `None` unless the mode is position.
    #[must_use]
    pub fn setpoint_rad(&self) -> Option<f64> {
        (self.mode == Mode::Position).then(|| position_setpoint_rad(self.setpoint))
    }

    /// Commanded motor speed in rad/s; `None` unless the mode is speed.
    #[must_use]
    pub fn setpoint_rad_s(&self) -> Option<f64> {
        (self.mode == Mode::Speed).then(|| speed_setpoint_rad_s(self.setpoint))
    }
}
