//! Damiao: geared motors, their feedback frame and three kinds of commands (manuals at github.com/dmBots).
//!
//! All angles, speeds and torques are those of the output, by the motor's own gear ratio: the encoder at the output serves the start
//! alone. Feedback is on the identifier that the master is given, the lowest four bits of the motor's number within. i_d is in no frame.

use ema_models::ActuatorParams;

use super::layout::{Coding, DriveLayout, Field, Place};
use super::{DriveMisfit, DriveSettings};
use crate::dbc::{Layout, ModeCodes, Role, Selector, Signal, SignalKind};
use crate::log_map::Quantity;

/// `PMAX` as the factory sets it, rad at the output.
const POSITION_MAX_RAD: f64 = 12.5;

/// Steps of position and torque over their ranges.
const POSITION_STEPS: f64 = 65_535.0;
const TORQUE_STEPS: f64 = 4095.0;

/// Offsets of the identifiers of commands: MIT, position with speed, speed.
const MIT: u32 = 0x000;
const POSITION: u32 = 0x100;
const SPEED: u32 = 0x200;

/// `ERR` of a motor that follows its commands.
const ENABLED: u64 = 1;

pub(super) fn layout(settings: &DriveSettings, params: &ActuatorParams) -> Result<DriveLayout, DriveMisfit> {
    let rated = settings.rated_current_a;
    let rated = rated.ok_or(DriveMisfit::Unknown("rated_current_a, the peak of i_q at TMAX"))?;
    let mut layout = DriveLayout::new();
    let of = Quantity::Of;
    let motor = layout.column(of(Role::MotorPosition), "POS", Some("rev"), 1.0);
    let current = layout.column(Quantity::CurrentQ, "T", Some("A"), 1.0);
    let temperature = layout.column(of(Role::WindingTemp), "T_Rotor", Some("degC"), 1.0);

    let range_turns = settings.position_max_rad.unwrap_or(POSITION_MAX_RAD) / core::f64::consts::TAU;
    let gear_ratio = params.transmission.gear_ratio;
    let position = |byte: u16, turns: f64| Signal {
        factor: 2.0 * turns / POSITION_STEPS,
        offset: -turns,
        ..big_endian(8 * byte + 7, 16)
    };
    let torque = Signal {
        factor: 2.0 * rated / TORQUE_STEPS,
        offset: -rated,
        ..big_endian(35, 12)
    };
    let fields = vec![
        Field::column(Place::Bits(position(1, range_turns * gear_ratio)), motor),
        Field::column(Place::Bits(torque), current),
        Field::column(Place::Bits(big_endian(63, 8)), temperature),
        Field::state(Place::Bits(big_endian(7, 4)), 0xf, &[ENABLED]),
    ];
    let id = u32::from(settings.feedback_id.unwrap_or(0));
    layout.message("feedback", id, Some(false), Coding::Bits { length: 8 }, fields);
    // All motors behind one master may have one identifier for their feedback.
    let number = u64::from(settings.node & 0xf);
    if let Some(feedback) = layout.messages.last_mut() {
        feedback.selector = Some(Selector {
            multiplexor: big_endian(3, 4).layout,
            ranges: vec![(number, number)],
        });
    }

    if settings.uses_commands {
        let turn = 1.0 / core::f64::consts::TAU;
        let angle = layout.column(of(Role::CommandPosition), "p_des", Some("rev"), 1.0);
        let speed = layout.column(of(Role::CommandSpeed), "v_des", Some("rev/s"), gear_ratio);
        let modes = ModeCodes::default();
        let mut command = |offset: u32, name: &str, length: usize, fields: Vec<Field>| {
            let id = offset + u32::from(settings.node);
            layout.message(name, id, Some(false), Coding::Bits { length }, fields);
        };
        let only = |signal: &Signal, first: u64, last: u64| Selector {
            multiplexor: signal.layout,
            ranges: vec![(first, last)],
        };
        let (mut impedance, mut stiffness) = (position(0, range_turns), big_endian(27, 12));
        // Frames that enable, disable and set the zero begin with the greatest number.
        let is_command = only(&impedance, 0, 0xfffe);
        // Without stiffness a motor follows the speed or torque of the frame, and no position.
        impedance.selectors = vec![is_command.clone(), only(&stiffness, 1, 0xfff)];
        stiffness.selectors = vec![is_command, only(&stiffness, 0, 0)];
        let follows = Field::command(Place::Bits(impedance), angle, modes.position);
        let is_other = Field::other_command(Place::Bits(stiffness));
        command(MIT, "MIT", 8, vec![follows, is_other]);
        let float = || Signal {
            factor: turn,
            ..little_endian_float()
        };
        let to_angle = Field::command(Place::Bits(float()), angle, modes.position);
        command(POSITION, "position", 8, vec![to_angle]);
        let at_speed = Field::command(Place::Bits(float()), speed, modes.speed);
        command(SPEED, "speed", 4, vec![at_speed]);
    }
    Ok(layout)
}

/// A number of so many bits below and with this one, the most significant.
fn big_endian(start: u16, size: u16) -> Signal {
    Signal {
        layout: Layout {
            start,
            size,
            big_endian: true,
        },
        kind: SignalKind::Unsigned,
        factor: 1.0,
        offset: 0.0,
        selectors: Vec::new(),
    }
}

fn little_endian_float() -> Signal {
    Signal {
        layout: Layout {
            start: 0,
            size: 32,
            big_endian: false,
        },
        kind: SignalKind::F32,
        ..big_endian(0, 32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive_bus::layout::Target;
    use crate::drive_bus::{DriveBus, ObjectDictionary, Preset};

    #[test]
    fn fields_have_steps_and_ends() {
        let settings = DriveSettings {
            rated_current_a: Some(20.0),
            position_max_rad: Some(1.0),
            ..DriveSettings::new(Preset::Damiao, 2)
        };
        let params = ActuatorParams::servo270();
        let drive = DriveBus::new(settings, &params, ObjectDictionary::default()).unwrap();
        let near = |found: Option<f64>, expected: f64| (found.unwrap() / expected - 1.0).abs() < 1e-9;
        assert!(near(drive.step(Quantity::CurrentQ), 40.0 / 4095.0));
        // In counts of the motor.
        let counts = params.transmission.gear_ratio * params.sensors.motor_counts_per_rev / core::f64::consts::TAU;
        let motor = drive.step(Quantity::Of(Role::MotorPosition));
        assert!(near(motor, 2.0 / 65_535.0 * counts), "{motor:?}");
        assert!(near(drive.quadrature_max(), 20.0 - 20.0 / 4095.0));
        assert_eq!(drive.step(Quantity::CurrentD), None);
    }

    #[test]
    fn a_feedback_frame_is_read_as_the_manual_has_it() {
        let settings = DriveSettings {
            rated_current_a: Some(20.0),
            position_max_rad: Some(core::f64::consts::PI),
            ..DriveSettings::new(Preset::Damiao, 2)
        };
        let params = ActuatorParams::bench();
        let layout = layout(&settings, &params).unwrap();
        let values = |data: [u8; 8]| {
            let of = |field: &Field| match &field.place {
                Place::Bits(signal) => signal.value(&data),
                _ => None,
            };
            layout.messages[0].fields.iter().map(of).collect::<Vec<_>>()
        };
        // Motor 2, enabled; the last step of the position, the middle of the speed, torque 0x800, 30 and 40 °C.
        let found = values([0x12, 0xff, 0xff, 0x80, 0x08, 0x00, 30, 40]);
        let gear_ratio = params.transmission.gear_ratio;
        let near = |found: Option<f64>, expected: f64| (found.unwrap() - expected).abs() < 1e-9;
        assert!(near(found[0], 0.5 * gear_ratio), "{found:?}");
        assert!(near(found[1], 20.0 * (2.0 * 2048.0 / 4095.0 - 1.0)), "{found:?}");
        assert_eq!((found[2], found[3]), (Some(40.0), Some(1.0)));
        // Another motor behind the same master.
        let selector = layout.messages[0].selector.as_ref().unwrap();
        assert!(selector.selects(&[0x12]) && !selector.selects(&[0x13]));
        // A command is one, the frame that enables none.
        let Target::Command(..) = layout.messages[1].fields[0].target else {
            panic!("{layout:?}")
        };
        let Place::Bits(angle) = &layout.messages[1].fields[0].place else {
            panic!("{layout:?}")
        };
        assert!(near(angle.value(&[0, 0, 0x7f, 0xf0, 0x10, 0, 0, 0]), -0.5));
        assert_eq!(angle.value(&[0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xfc]), None);
        // Without stiffness (kp = 0) it is a command of speed or torque.
        let Place::Bits(stiffness) = &layout.messages[1].fields[1].place else {
            panic!("{layout:?}")
        };
        let torque = [0, 0, 0x7f, 0xf0, 0, 0, 0x08, 0xff];
        assert_eq!((angle.value(&torque), stiffness.value(&torque)), (None, Some(0.0)));
        assert_eq!(stiffness.value(&[0, 0, 0x7f, 0xf0, 0x10, 0, 0, 0]), None);
    }
}
