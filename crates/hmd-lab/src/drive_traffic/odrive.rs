//! ODrive by the page "CAN Protocol" of docs.odriverobotics.com (firmware 0.6): cyclic messages, and the host's commands and reads.

use super::{DriveLink, DriveSample, Sent};

/// Endpoint of `axis0.load_mapper.pos_abs` or the like; which one follows from the firmware's `flat_endpoints.json`.
const ENDPOINT: u16 = 490;

pub(super) fn frames(link: &DriveLink, sample: &DriveSample) -> Vec<Sent> {
    let mut frames = Vec::new();
    let mut send = |command: u32, data: Vec<u8>| frames.push(Sent::classic(u32::from(link.node) << 5 | command, data));
    let floats = |a: f64, b: f64| [(a as f32).to_le_bytes(), (b as f32).to_le_bytes()].concat();
    if let Some(turns) = sample.command_turns {
        // Set_Input_Pos, without feed-forward: the drive follows it at the sample that comes behind it.
        send(0x0C, floats(turns, 0.0));
    }
    // Get_Encoder_Estimates, Get_Iq: what was measured; the set point of the current is not simulated.
    send(0x09, floats(sample.motor_turns, 0.0));
    send(0x14, floats(sample.i_q, sample.i_q));
    if link.has_output_encoder {
        // RxSdo, a read, and its answer TxSdo.
        let [low, high] = ENDPOINT.to_le_bytes();
        send(0x04, vec![0, low, high, 0]);
        let value = (sample.output_turns as f32).to_le_bytes();
        send(0x05, [&[0, low, high, 0], &value[..]].concat());
    }
    if sample.is_slow {
        // Heartbeat: no error, closed loop; Get_Bus_Voltage_Current; Get_Temperature.
        send(0x01, vec![0, 0, 0, 0, 8, 0, 0, 0]);
        send(0x17, floats(sample.dc_link_v, 0.5));
        send(0x15, floats(35.0, sample.winding_temp_deg_c));
    }
    frames
}
