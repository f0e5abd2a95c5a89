//! A geared motor of Damiao by its manuals (github.com/dmBots): commands of position and speed, and the feedback that answers each.

use super::{DriveLink, DriveSample, Sent};

/// `PMAX`, rad at the output, and what the torque's range is in peaks of i_q, A.
const POSITION_MAX_RAD: f64 = 1.0;
const CURRENT_MAX_A: f64 = 10.0;

/// `MST_ID`.
const FEEDBACK: u32 = 0x11;

pub(super) fn frames(link: &DriveLink, sample: &DriveSample) -> Vec<Sent> {
    let mut frames = Vec::new();
    let node = u32::from(link.node);
    if let Some(angle) = sample.command_rad {
        let floats = [angle as f32, 20.0].map(f32::to_le_bytes).concat();
        frames.push(Sent::classic(0x100 + node, floats));
    }
    let steps = |value: f64, most: f64, bits: u32| {
        let last = f64::from((1_u32 << bits) - 1);
        ((value.clamp(-most, most) + most) / (2.0 * most) * last) as u16
    };
    let [high, low] = steps(sample.rotor_rad_at_output, POSITION_MAX_RAD, 16).to_be_bytes();
    // The speed stands in the middle of its range: it is not read here.
    let speed = 0x7ff_u16;
    let torque = steps(sample.i_q, CURRENT_MAX_A, 12);
    let [torque_high, torque_low] = torque.to_be_bytes();
    let data = [
        1 << 4 | link.node & 0xf,
        high,
        low,
        (speed >> 4) as u8,
        (speed << 4) as u8 | torque_high,
        torque_low,
        30,
        sample.winding_temp_deg_c.clamp(0.0, 255.0) as u8,
    ];
    frames.push(Sent::classic(FEEDBACK, data));
    frames
}
