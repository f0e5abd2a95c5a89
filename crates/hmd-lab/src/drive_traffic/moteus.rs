//! moteus by docs/reference.md of github.com/mjbots/moteus, appendix A: a command that writes and reads registers, and its reply.

use hmd_core::frame::{FrameFlags, is_fd_length};

use super::{DriveLink, DriveSample, Sent};

pub(super) fn frames(link: &DriveLink, sample: &DriveSample) -> Vec<Sent> {
    let float = |value: f64| (value as f32).to_le_bytes();
    // Write mode 10 (position) as int8; write register 0x020 as float; read 0x000 to 0x005 as float, 0x00d as int8.
    let mut command = Vec::new();
    if let Some(turns) = sample.command_turns {
        command.extend([0x01, 0x00, 0x0a, 0x0d, 0x20]);
        command.extend(float(turns));
    }
    command.extend([0x1c, 0x06, 0x00, 0x11, 0x0d]);
    // Mode, position, velocity, torque, i_q, i_d; the voltage in steps of 0.5 V, or of 0.1 V where it needs 16 bits.
    let mut reply = vec![0x2c, 0x06, 0x00];
    for value in [10.0, sample.motor_turns, 0.0, 0.0, sample.i_q, sample.i_d] {
        reply.extend(float(value));
    }
    reply.extend([0x25, 0x0d]);
    reply.extend(((10.0 * sample.dc_link_v).round() as i16).to_le_bytes());
    if sample.is_slow {
        reply.extend([0x25, 0x0a]);
        reply.extend(((10.0 * sample.winding_temp_deg_c).round() as i16).to_le_bytes());
    }
    if link.has_output_encoder {
        command.extend([0x1d, 0x52]);
        reply.extend([0x2d, 0x52]);
        reply.extend(float(sample.output_turns.rem_euclid(1.0)));
    }
    let node = u32::from(link.node);
    // The command asks for an answer, so its identifier is above 0x7ff.
    vec![
        sent(0x8000 | node, FrameFlags::EXTENDED, command),
        sent(node << 8, FrameFlags::NONE.with(FrameFlags::EXTENDED, node > 7), reply),
    ]
}

/// A frame of CAN FD, padded with no-operations to a length that there is.
fn sent(id: u32, flags: FrameFlags, mut data: Vec<u8>) -> Sent {
    while !is_fd_length(data.len()) {
        data.push(0x50);
    }
    let flags = flags | FrameFlags::FD | FrameFlags::BIT_RATE_SWITCH;
    Sent { id, flags, data }
}
