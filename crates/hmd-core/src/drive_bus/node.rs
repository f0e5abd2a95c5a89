//! Which node of a preset sends a frame.

use super::{Preset, odrive, vesc};
use crate::frame::RawFrame;

/// CANopen's heartbeat, without the node.
const HEARTBEAT: u32 = 0x700;
const NODE_MASK: u32 = 0x7f;

impl Preset {
    /// The node that sends this frame, where the preset's identifiers tell it; Damiao's do not.
    #[must_use]
    pub(crate) fn node_of(self, frame: &RawFrame) -> Option<u8> {
        if frame.is_remote() || frame.is_error() || frame.is_serial() {
            return None;
        }
        let id = frame.id();
        let node = match (self, frame.is_extended()) {
            (Self::Odrive, false) if odrive::SENT.contains(&(id & 0x1f)) => id >> 5,
            (Self::Vesc, true) if vesc::SENT.contains(&(id >> 8)) => id & 0xff,
            (Self::Cia402, false) if id & !NODE_MASK == HEARTBEAT => id & NODE_MASK,
            // To the host, which is 0.
            (Self::Moteus, _) if id & 0xff == 0 => id >> 8,
            _ => return None,
        };
        u8::try_from(node).ok().filter(|_| self.nodes().contains(&node))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::FrameFlags;

    #[test]
    fn identifiers_tell_the_node_that_sends() {
        let (none, wide) = (FrameFlags::empty(), FrameFlags::EXTENDED);
        for (preset, id, flags, expected) in [
            (Preset::Odrive, 5 << 5 | 0x09, none, Some(5)),
            (Preset::Odrive, 5 << 5 | 0x0C, none, None),
            (Preset::Vesc, 9 << 8 | 7, wide, Some(7)),
            (Preset::Vesc, 3 << 8 | 7, wide, None),
            (Preset::Cia402, 0x703, none, Some(3)),
            (Preset::Cia402, 0x700, none, None),
            (Preset::Cia402, 0x183, none, None),
            (Preset::Moteus, 0x100, none, Some(1)),
            (Preset::Moteus, 0x8001, wide, None),
            (Preset::Damiao, 0x001, none, None),
        ] {
            let frame = RawFrame::new(1, 0, id, flags, &[0; 8]).unwrap();
            assert_eq!(preset.node_of(&frame), expected, "{preset:?} {id:#x}");
        }
    }
}
