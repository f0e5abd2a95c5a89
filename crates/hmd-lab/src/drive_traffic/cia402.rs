//! A drive of CiA 402 on CANopen: PDO as `fixtures/drives/drive.dcf` has them, which the master writes at start-up.
//!
//! TPDO1 6041 6061, TPDO2 6064 6078, TPDO3 60E4sub1, TPDO4 6079; RPDO1 6040 607A; all but TPDO4 at each SYNC.

use super::{DriveLink, DriveSample, Sent};

/// Peak of i_q at 1000 ‰: √2 times the 4 A of object 6075.
const RATED_CURRENT_A: f64 = 4.0 * core::f64::consts::SQRT_2;

const SYNC: u32 = 0x80;

/// Communication object, mapping object, COB-ID without the node, and what is mapped.
const PDOS: [(u16, u16, u32, &[u32]); 5] = [
    (0x1800, 0x1A00, 0x180, &[0x6041_0010, 0x6061_0008]),
    (0x1801, 0x1A01, 0x280, &[0x6064_0020, 0x6078_0010]),
    (0x1802, 0x1A02, 0x380, &[0x60E4_0120]),
    (0x1803, 0x1A03, 0x480, &[0x6079_0020]),
    (0x1400, 0x1600, 0x200, &[0x6040_0010, 0x607A_0020]),
];

/// The master's SDO writes and their answers, then the start of the node.
pub(super) fn configuration(link: &DriveLink) -> Vec<Sent> {
    let node = u32::from(link.node);
    let mut frames = Vec::new();
    let mut write = |index: u16, sub: u8, value: u32, bytes: u8| {
        let [low, high] = index.to_le_bytes();
        let mut data = vec![0x23 | (4 - bytes) << 2, low, high, sub];
        data.extend(value.to_le_bytes());
        frames.push(Sent::classic(0x600 + node, data));
        frames.push(Sent::classic(0x580 + node, vec![0x60, low, high, sub, 0, 0, 0, 0]));
    };
    for (communication, mapping, cob, objects) in PDOS {
        if cob == 0x380 && !link.has_output_encoder {
            continue;
        }
        // Off, no object, its objects, their number, on.
        write(communication, 1, 0x8000_0000 | (cob + node), 4);
        write(mapping, 0, 0, 1);
        for (sub, &object) in (1..).zip(objects) {
            write(mapping, sub, object, 4);
        }
        write(mapping, 0, objects.len() as u32, 1);
        write(communication, 1, cob + node, 4);
    }
    frames.push(Sent::classic(0x000, vec![0x01, link.node]));
    frames
}

pub(super) fn frames(link: &DriveLink, sample: &DriveSample) -> Vec<Sent> {
    let node = u32::from(link.node);
    let mut frames = Vec::new();
    if let Some(turns) = sample.command_turns {
        // Steps of the position are those of the motor's resolver. Taken over at the SYNC that follows.
        let target = (turns * sample.motor_counts_per_turn).round() as i32;
        let data = [&0x000f_u16.to_le_bytes()[..], &target.to_le_bytes()].concat();
        frames.push(Sent::classic(0x200 + node, data));
    }
    frames.push(Sent::classic(SYNC, vec![]));
    let mut send = |cob: u32, data: Vec<u8>| frames.push(Sent::classic(cob + node, data));
    // Operation enabled, remote; cyclic synchronous position.
    send(0x180, [&0x0637_u16.to_le_bytes()[..], &[8]].concat());
    let per_thousand = (1000.0 * sample.i_q / RATED_CURRENT_A).round() as i16;
    let position = sample.motor_counts as i32;
    send(
        0x280,
        [&position.to_le_bytes()[..], &per_thousand.to_le_bytes()].concat(),
    );
    if link.has_output_encoder {
        send(0x380, (sample.output_counts as i32).to_le_bytes().to_vec());
    }
    if sample.is_slow {
        send(0x480, ((1000.0 * sample.dc_link_v) as u32).to_le_bytes().to_vec());
        // Heartbeat: operational.
        send(0x700, vec![0x05]);
    }
    frames
}
