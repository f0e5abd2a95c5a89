//! ODrive: CANSimple, firmware 0.5 and 0.6 (docs.odriverobotics.com, "CAN Protocol").
//!
//! Identifier `node << 5 | command`, little-endian, floats of 32 bits. Position and speed in turns of the encoder that the controller
//! uses, currents as peaks in the rotor's frame. i_d is in no message.

use ema_models::ActuatorParams;

use super::DriveSettings;
use super::layout::{Angles, Coding, DriveLayout, Field, Place};
use crate::dbc::{Layout, ModeCodes, Role, Selector, SignalKind};
use crate::log_map::Quantity;

/// 63 is what a drive without a number has.
pub(super) const NODE_MAX: u32 = 62;

const HEARTBEAT: u32 = 0x01;
const TX_SDO: u32 = 0x05;
const GET_ENCODER_ESTIMATES: u32 = 0x09;
const SET_INPUT_POS: u32 = 0x0C;
const SET_INPUT_VEL: u32 = 0x0D;
const SET_INPUT_TORQUE: u32 = 0x0E;
const GET_IQ: u32 = 0x14;
const GET_TEMPERATURE: u32 = 0x15;
const GET_BUS_VOLTAGE_CURRENT: u32 = 0x17;

/// Of these, what a drive sends in any case.
pub(super) const SENT: [u32; 3] = [HEARTBEAT, GET_ENCODER_ESTIMATES, GET_IQ];

/// `Axis_State`: only then the controller follows its input.
const CLOSED_LOOP_CONTROL: u64 = 8;

pub(super) fn layout(settings: &DriveSettings, params: &ActuatorParams) -> DriveLayout {
    let mut layout = DriveLayout::new();
    let steps = (
        settings.motor_units_per_rev.unwrap_or(1.0),
        settings.output_units_per_rev.unwrap_or(1.0),
    );
    let names = [
        "Get_Encoder_Estimates.Pos_Estimate",
        "TxSdo.Value",
        "Set_Input_Pos.Input_Pos",
    ];
    let angles = Angles::add(&mut layout, settings, params, names, steps);
    let of = Quantity::Of;
    let current = layout.column(Quantity::CurrentQ, "Get_Iq.Iq_Measured", Some("A"), 1.0);
    let voltage = layout.column(of(Role::DcLink), "Get_Bus_Voltage_Current.Bus_Voltage", Some("V"), 1.0);
    let temperature = "Get_Temperature.Motor_Temperature";
    let temperature = layout.column(of(Role::WindingTemp), temperature, Some("degC"), 1.0);

    let mut message = |command: u32, name: &str, length: usize, fields: Vec<Field>| {
        let id = u32::from(settings.node) << 5 | command;
        layout.message(name, id, Some(false), Coding::Bits { length }, fields);
    };
    let pos = Field::column(Place::f32_at(0), angles.motor);
    message(GET_ENCODER_ESTIMATES, "Get_Encoder_Estimates", 8, vec![pos]);
    message(GET_IQ, "Get_Iq", 8, vec![Field::column(Place::f32_at(4), current)]);
    if let (Some(column), Some(endpoint)) = (angles.output, settings.output_encoder) {
        let mut value = Place::f32_at(4);
        if let Place::Bits(signal) = &mut value {
            signal.selectors.push(Selector {
                multiplexor: Layout {
                    start: 8,
                    size: 16,
                    big_endian: false,
                },
                ranges: vec![(u64::from(endpoint), u64::from(endpoint))],
            });
        }
        message(TX_SDO, "TxSdo", 8, vec![Field::column(value, column)]);
    }
    if let Some(position) = angles.position {
        let modes = ModeCodes::default();
        let command = Field::command(Place::f32_at(0), position, modes.position);
        message(SET_INPUT_POS, "Set_Input_Pos", 4, vec![command]);
        let state = Place::bits(SignalKind::Unsigned, 32, 8);
        let state = Field::state(state, 0xff, &[CLOSED_LOOP_CONTROL]);
        message(HEARTBEAT, "Heartbeat", 5, vec![state]);
    }
    let voltage = Field::column(Place::f32_at(0), voltage);
    message(GET_BUS_VOLTAGE_CURRENT, "Get_Bus_Voltage_Current", 8, vec![voltage]);
    let temperature = Field::column(Place::f32_at(4), temperature);
    message(GET_TEMPERATURE, "Get_Temperature", 8, vec![temperature]);
    if settings.uses_commands {
        let turns_s = 1.0 / steps.0;
        let speed = layout.column(
            of(Role::CommandSpeed),
            "Set_Input_Vel.Input_Vel",
            Some("rev/s"),
            turns_s,
        );
        let command = Field::command(Place::f32_at(0), speed, ModeCodes::default().speed);
        let id = u32::from(settings.node) << 5 | SET_INPUT_VEL;
        let coding = Coding::Bits { length: 4 };
        layout.message("Set_Input_Vel", id, Some(false), coding, vec![command]);
        let torque = Field::other_command(Place::f32_at(0));
        let id = u32::from(settings.node) << 5 | SET_INPUT_TORQUE;
        layout.message("Set_Input_Torque", id, Some(false), coding, vec![torque]);
    }
    layout
}
