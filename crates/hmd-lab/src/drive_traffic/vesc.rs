//! VESC by `comm/comm_can.c` of github.com/vedderb/bldc: status 1, 4 and 5 of firmware 6, and a host that closes the position loop itself
//! and commands currents.

use hmd_core::frame::FrameFlags;

use super::{DriveLink, DriveSample, Sent};

pub(super) fn frames(link: &DriveLink, sample: &DriveSample) -> Vec<Sent> {
    let mut frames = Vec::new();
    let mut send = |packet: u32, parts: &[&[u8]]| {
        frames.push(Sent {
            id: packet << 8 | u32::from(link.node),
            flags: FrameFlags::EXTENDED,
            data: parts.concat(),
        });
    };
    // C truncates towards zero, as `as` does.
    let i16_of = |value: f64| (value as i16).to_be_bytes();
    // SET_CURRENT, mA.
    send(1, &[&((1000.0 * sample.i_q) as i32).to_be_bytes()]);
    let length = sample.i_d.hypot(sample.i_q);
    let draws = if sample.v_q * sample.i_q < 0.0 { -1.0 } else { 1.0 };
    // The largest voltage along one axis is the supply over the root of three.
    let duty = sample.v_q * 3.0_f64.sqrt() / sample.dc_link_v;
    // The electrical speed is not read here.
    send(9, &[&[0; 4], &i16_of(10.0 * draws * length), &i16_of(1000.0 * duty)]);
    let degrees = 360.0 * sample.motor_turns.rem_euclid(1.0);
    let [fet, motor] = [40.0, sample.winding_temp_deg_c].map(|degrees| i16_of(10.0 * degrees));
    send(16, &[&fet, &motor, &i16_of(5.0), &i16_of(50.0 * degrees)]);
    if sample.is_slow {
        send(27, &[&[0; 4], &i16_of(10.0 * sample.dc_link_v), &[0; 2]]);
    }
    frames
}
