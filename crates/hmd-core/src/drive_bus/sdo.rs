//! [`SdoListener`]: expedited SDO writes of CiA 301, overheard.
//!
//! A master that configures a drive writes its objects at start-up. A write counts once the drive confirms it.

use crate::frame::RawFrame;

const REQUEST: u32 = 0x600;
const RESPONSE: u32 = 0x580;

/// An object and its value.
pub(super) type Write = (u16, u8, u64);

/// Listens to one node's SDO server.
#[derive(Clone, Copy, Debug)]
pub(super) struct SdoListener {
    node: u32,
    asked: Option<Write>,
}

impl SdoListener {
    pub(super) fn new(node: u8) -> Self {
        Self {
            node: u32::from(node),
            asked: None,
        }
    }

    /// Whether a frame is of the node's SDO.
    pub(super) fn is_sdo(&self, frame: &RawFrame) -> bool {
        !frame.is_extended() && [REQUEST, RESPONSE].iter().any(|of| of + self.node == frame.id())
    }

    /// The write that a frame confirms.
    pub(super) fn push(&mut self, frame: &RawFrame) -> Option<Write> {
        let &[command, low, high, sub, ref value @ ..] = frame.data() else {
            return None;
        };
        let index = u16::from_le_bytes([low, high]);
        if frame.id() == REQUEST + self.node {
            // Download, expedited; its size where it says so.
            let is_write = command & 0xe2 == 0x22;
            let size = if command & 1 == 1 {
                4 - usize::from(command >> 2 & 3)
            } else {
                4
            };
            let bytes = value.iter().take(size).rev();
            let value = bytes.fold(0, |sum, &byte| sum << 8 | u64::from(byte));
            self.asked = is_write.then_some((index, sub, value));
            return None;
        }
        let confirms = |(of, of_sub, _): &Write| command == 0x60 && (*of, *of_sub) == (index, sub);
        self.asked.take().filter(confirms)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::FrameFlags;

    #[test]
    fn a_write_counts_when_it_is_confirmed() {
        let mut listener = SdoListener::new(5);
        let mut hear = |id: u32, data: &[u8]| {
            let frame = RawFrame::new(0, 0, id, FrameFlags::NONE, data).expect("a frame");
            listener.push(&frame)
        };
        assert_eq!(hear(0x605, &[0x2f, 0x00, 0x1a, 0, 2, 0, 0, 0]), None);
        assert_eq!(hear(0x585, &[0x60, 0x00, 0x1a, 0, 0, 0, 0, 0]), Some((0x1A00, 0, 2)));
        // Nothing is left to confirm; an abort; a read; another object's answer.
        assert_eq!(hear(0x585, &[0x60, 0x00, 0x1a, 0, 0, 0, 0, 0]), None);
        assert_eq!(hear(0x605, &[0x23, 0x00, 0x1a, 1, 1, 2, 3, 4]), None);
        assert_eq!(hear(0x585, &[0x80, 0x00, 0x1a, 1, 0, 0, 0, 8]), None);
        assert_eq!(hear(0x605, &[0x40, 0x00, 0x1a, 1, 0, 0, 0, 0]), None);
        assert_eq!(hear(0x585, &[0x43, 0x00, 0x1a, 1, 1, 2, 3, 4]), None);
        assert_eq!(hear(0x605, &[0x23, 0x00, 0x1a, 1, 1, 2, 3, 4]), None);
        assert_eq!(hear(0x585, &[0x60, 0x00, 0x1a, 2, 0, 0, 0, 0]), None);
        assert_eq!(hear(0x605, &[]), None);
    }
}
