//! moteus: registers in multiplex frames of CAN FD (github.com/mjbots/moteus, docs/reference.md, appendix A).
//!
//! Identifier `source << 8 | destination`, bit 15 where an answer is asked for. A frame has subframes of registers, each as integers of
//! 8, 16 or 32 bits or as floats, the integers in steps that follow from the register. Position in turns of what the drive takes for its
//! output, currents as peaks in the rotor's frame.

use ema_models::ActuatorParams;

use super::DriveSettings;
use super::layout::{Angles, Coding, DriveLayout, Field, Place};
use crate::dbc::{ModeCodes, Role};
use crate::log_map::Quantity;

const MODE: u32 = 0x000;
const POSITION: u32 = 0x001;
const Q_CURRENT: u32 = 0x004;
const D_CURRENT: u32 = 0x005;
const MOTOR_TEMPERATURE: u32 = 0x00a;
const VOLTAGE: u32 = 0x00d;
const COMMAND_POSITION: u32 = 0x020;
const CONTROL_POSITION: u32 = 0x038;
/// Position of the encoder in slot 0; that of the next slot is two registers on.
const ENCODER_POSITION: u32 = 0x050;
pub(super) const ENCODER_SLOTS: u32 = 3;

/// The mode in which the drive follows its position command.
const IN_POSITION: u64 = 10;

/// Bits of an identifier that name the source, with the bit for an answer and whatever is above; and the destination.
const SOURCE_MASK: u32 = 0x1fff_ff00;
const DESTINATION_MASK: u32 = 0x1fff_00ff;

pub(super) fn layout(settings: &DriveSettings, params: &ActuatorParams) -> DriveLayout {
    let mut layout = DriveLayout::new();
    let steps = (
        settings.motor_units_per_rev.unwrap_or(1.0),
        settings.output_units_per_rev.unwrap_or(1.0),
    );
    let names = ["0x001 position", "encoder position", "0x020 position command"];
    let angles = Angles::add(&mut layout, settings, params, names, steps);
    if let Some(output) = angles.output {
        // An encoder shows its own turn alone.
        layout.columns[output].wraps_after = Some(1.0);
    }
    let of = Quantity::Of;
    let q = layout.column(Quantity::CurrentQ, "0x004 Q current", Some("A"), 1.0);
    let d = layout.column(Quantity::CurrentD, "0x005 D current", Some("A"), 1.0);
    let voltage = layout.column(of(Role::DcLink), "0x00d voltage", Some("V"), 1.0);
    let temperature = layout.column(of(Role::WindingTemp), "0x00a motor temperature", Some("degC"), 1.0);

    let modes = ModeCodes::default();
    let mut replied = vec![
        Field::column(Place::Register(POSITION), angles.motor),
        Field::column(Place::Register(Q_CURRENT), q),
        Field::column(Place::Register(D_CURRENT), d),
        Field::column(Place::Register(VOLTAGE), voltage),
        Field::column(Place::Register(MOTOR_TEMPERATURE), temperature),
    ];
    if let (Some(column), Some(slot)) = (angles.output, settings.output_encoder) {
        let register = ENCODER_POSITION + 2 * u32::from(slot);
        replied.push(Field::column(Place::Register(register), column));
    }
    let node = u32::from(settings.node);
    if let Some(position) = angles.position {
        replied.push(Field::state(Place::Register(MODE), 0xff, &[IN_POSITION]));
        // What the drive follows at this instant, of a trajectory too, is better than what it was sent.
        let follows = Place::Register(CONTROL_POSITION);
        replied.push(Field::command(follows, position, modes.position));
        let written = Coding::Registers { written: true };
        let command = Place::Register(COMMAND_POSITION);
        let command = Field::command(command, position, modes.position);
        layout.message("command", node, None, written, vec![command]);
    }
    let coding = Coding::Registers { written: false };
    layout.message("reply", node << 8, None, coding, replied);
    for message in &mut layout.messages {
        message.mask = if message.name == "reply" {
            SOURCE_MASK
        } else {
            DESTINATION_MASK
        };
    }
    layout
}

/// Values of registers in one frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Registers {
    /// No frame has more.
    values: [(u32, f64); crate::frame::MAX_DATA],
    count: usize,
}

impl Default for Registers {
    fn default() -> Self {
        Self {
            values: [(0, 0.0); crate::frame::MAX_DATA],
            count: 0,
        }
    }
}

impl Registers {
    /// The last value of a register, NaN where it is none.
    pub(super) fn value(&self, register: u32) -> Option<f64> {
        let values = &self.values[..self.count];
        values
            .iter()
            .rev()
            .find(|(of, _)| *of == register)
            .map(|(_, value)| *value)
    }

    fn add(&mut self, register: u32, value: f64) {
        if let Some(place) = self.values.get_mut(self.count) {
            *place = (register, value);
            self.count += 1;
        }
    }
}

/// The registers that a frame writes, or answers with; `None` where it ends inside a subframe. What comes behind a subframe of an unknown
/// kind is not read.
pub(super) fn registers(data: &[u8], written: bool) -> Option<Registers> {
    let mut found = Registers::default();
    let mut rest = data;
    while let Some((&kind, after)) = rest.split_first() {
        rest = after;
        match kind {
            0x00..=0x2f => {
                let count = match kind & 3 {
                    0 => varuint(&mut rest)?,
                    count => u32::from(count),
                };
                let start = varuint(&mut rest)?;
                if kind & 0x30 == 0x10 {
                    continue;
                }
                let is_wanted = (kind & 0x30 == 0x00) == written;
                for n in 0..count {
                    let register = start.wrapping_add(n);
                    let value = value(&mut rest, kind >> 2 & 3, register)?;
                    if is_wanted {
                        found.add(register, value);
                    }
                }
            }
            0x30 | 0x31 => {
                varuint(&mut rest)?;
                varuint(&mut rest)?;
            }
            0x50 => {}
            _ => break,
        }
    }
    Some(found)
}

/// A number of seven bits a byte, at most five bytes.
fn varuint(rest: &mut &[u8]) -> Option<u32> {
    let mut number = 0_u64;
    for shift in (0..35).step_by(7) {
        let (&byte, after) = rest.split_first()?;
        *rest = after;
        number |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return u32::try_from(number).ok();
        }
    }
    None
}

/// A value of a register: integers of 8, 16, 32 bits or a float. The least integer is no number.
fn value(rest: &mut &[u8], coding: u8, register: u32) -> Option<f64> {
    let size = [1, 2, 4, 4][usize::from(coding & 3)];
    let (bytes, after) = rest.split_at_checked(size)?;
    *rest = after;
    let number = |raw: i32, least: i32| if raw == least { f64::NAN } else { f64::from(raw) };
    let (raw, place) = match *bytes {
        [a] => (number(i32::from(a as i8), i8::MIN.into()), 0),
        [a, b] => (number(i32::from(i16::from_le_bytes([a, b])), i16::MIN.into()), 1),
        [a, b, c, d] if coding & 3 == 3 => return Some(f64::from(f32::from_le_bytes([a, b, c, d]))),
        [a, b, c, d] => (number(i32::from_le_bytes([a, b, c, d]), i32::MIN), 2),
        _ => return None,
    };
    Some(raw * steps(register)[place])
}

/// Value of one step of a register, as integers of 8, 16 and 32 bits.
fn steps(register: u32) -> [f64; 3] {
    match register {
        Q_CURRENT | D_CURRENT => [1.0, 0.1, 0.001],
        VOLTAGE => [0.5, 0.1, 0.001],
        MOTOR_TEMPERATURE => [1.0, 0.1, 0.001],
        MODE => [1.0; 3],
        _ => [0.01, 0.0001, 0.00001],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_example_of_the_reference_is_read() {
        // Mode 10; position 96 steps, velocity, torque as int16; two reads.
        let data = [
            0x01, 0x00, 0x0a, 0x07, 0x20, 0x60, 0x00, 0x20, 0x01, 0x50, 0xff, 0x14, 0x04, 0x00, 0x13, 0x0d,
        ];
        let written = registers(&data, true).expect("a whole frame");
        assert_eq!(written.value(MODE), Some(10.0));
        assert!((written.value(COMMAND_POSITION).expect("there") - 0.0096).abs() < 1e-12);
        assert_eq!(written.value(POSITION), None);
        assert_eq!(registers(&data, false).expect("a whole frame").count, 0);
        for length in 0..data.len() {
            // Any cut is refused or read, and never invents a value.
            if let Some(found) = registers(&data[..length], true) {
                assert!(found.count <= written.count);
            }
        }
    }

    #[test]
    fn values_have_the_steps_of_their_register() {
        let data = [
            0x20 | 1,
            0x0d,
            48, // 24 V
            0x24 | 2,
            0x04,
            0xf6,
            0xff,
            0x00,
            0x80, // i_q −1 A, i_d not known
            0x2c | 1,
            0x01,
            0x00,
            0x00,
            0x20,
            0x40, // 2.5 turns
            0x50,
            0x50,
        ];
        let found = registers(&data, false).expect("a whole frame");
        assert_eq!(found.value(VOLTAGE), Some(24.0));
        assert_eq!(found.value(Q_CURRENT), Some(-1.0));
        assert!(found.value(D_CURRENT).expect("there").is_nan());
        assert_eq!(found.value(POSITION), Some(2.5));
    }
}
