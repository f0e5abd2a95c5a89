//! VESC: status frames of firmware 3 to 6 (github.com/vedderb/bldc, `comm/comm_can.c`, `motor/mcpwm_foc.c`).
//!
//! Identifier of 29 bits, `packet << 8 | controller`, most significant byte first. The current is the length of the current vector,
//! positive where the motor draws power: v_q i_q > 0. The duty cycle has the sign of v_q, so both give that of i_q. i_d is in no frame.

use ema_models::ActuatorParams;

use super::DriveSettings;
use super::layout::{Coding, DriveLayout, Field, Place};
use crate::dbc::{ModeCodes, Role, SignalKind};
use crate::log_map::Quantity;

/// 255 is everybody.
pub(super) const NODE_MAX: u32 = 254;

const SET_RPM: u32 = 3;
/// Commands of duty cycle, current, brake, position, and the same relative to their limits.
const OTHER_COMMANDS: [(u32, &str); 8] = [
    (0, "SET_DUTY"),
    (1, "SET_CURRENT"),
    (2, "SET_CURRENT_BRAKE"),
    (4, "SET_POS"),
    (10, "SET_CURRENT_REL"),
    (11, "SET_CURRENT_BRAKE_REL"),
    (12, "SET_CURRENT_HANDBRAKE"),
    (13, "SET_CURRENT_HANDBRAKE_REL"),
];
const STATUS: u32 = 9;
const STATUS_4: u32 = 16;
const STATUS_5: u32 = 27;

/// Of these, what a drive sends.
pub(super) const SENT: [u32; 3] = [STATUS, STATUS_4, STATUS_5];

/// Step of the current, A. Numbers are truncated towards zero.
const CURRENT_STEP_A: f64 = 0.1;

/// Steps of the position in a turn: fiftieths of a degree. It begins again after one.
const STEPS_PER_TURN: f64 = 18_000.0;

pub(super) fn layout(settings: &DriveSettings, params: &ActuatorParams) -> DriveLayout {
    let mut layout = DriveLayout::new();
    let of = Quantity::Of;
    let units = settings.motor_units_per_rev.unwrap_or(STEPS_PER_TURN);
    let position = layout.column(of(Role::MotorPosition), "STATUS_4.pid_pos", Some("rev"), 1.0 / units);
    layout.columns[position].wraps_after = Some(STEPS_PER_TURN);
    let current = layout.column(Quantity::CurrentQ, "STATUS.current", Some("A"), 1.0);
    let voltage = layout.column(of(Role::DcLink), "STATUS_5.v_in", Some("V"), 0.1);
    let temperature = layout.column(of(Role::WindingTemp), "STATUS_4.temp_motor", Some("degC"), 0.1);

    let i16_at = |byte| Place::big_endian(SignalKind::Signed, byte, 16);
    let mut message = |packet: u32, name: &str, length: usize, fields: Vec<Field>| {
        let id = packet << 8 | u32::from(settings.node);
        layout.message(name, id, Some(true), Coding::Bits { length }, fields);
    };
    let vector = Place::CurrentByPower {
        current: Box::new(i16_at(4)),
        duty: Box::new(i16_at(6)),
    };
    message(STATUS, "STATUS", 8, vec![Field::column(vector, current)]);
    let fields = vec![
        Field::column(i16_at(6), position),
        Field::column(i16_at(2), temperature),
    ];
    message(STATUS_4, "STATUS_4", 8, fields);
    message(STATUS_5, "STATUS_5", 6, vec![Field::column(i16_at(4), voltage)]);
    if settings.uses_commands {
        let of_motor = 1.0 / params.motor.pole_pairs;
        let speed = layout.column(of(Role::CommandSpeed), "SET_RPM", Some("rpm"), of_motor);
        let erpm = Place::big_endian(SignalKind::Signed, 0, 32);
        let command = Field::command(erpm, speed, ModeCodes::default().speed);
        let id = SET_RPM << 8 | u32::from(settings.node);
        let coding = Coding::Bits { length: 4 };
        layout.message("SET_RPM", id, Some(true), coding, vec![command]);
        for (packet, name) in OTHER_COMMANDS {
            let command = Field::other_command(Place::big_endian(SignalKind::Signed, 0, 32));
            let id = packet << 8 | u32::from(settings.node);
            layout.message(name, id, Some(true), coding, vec![command]);
        }
    }
    layout
}

/// i_q, A, of a current in steps and a duty cycle. Half a step is what the truncation takes from it in the mean.
pub(super) fn current_a(current: f64, duty: f64) -> f64 {
    let length = if current.abs() < 0.5 {
        0.0
    } else {
        current + 0.5 * current.signum()
    };
    CURRENT_STEP_A * if duty < 0.0 { -length } else { length }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sign_of_the_current_is_that_of_power_and_voltage() {
        // Driving forwards and backwards, braking from either.
        for (current, duty, expected) in [
            (20.0, 300.0, 2.05),
            (20.0, -300.0, -2.05),
            (-20.0, 300.0, -2.05),
            (-20.0, -300.0, 2.05),
            (0.0, -300.0, 0.0),
            (1.0, 0.0, 0.15),
        ] {
            assert!((current_a(current, duty) - expected).abs() < 1e-12, "{current} {duty}");
        }
    }
}
