//! What was in a source and could not be read.

use hmd_core::pipeline::Losses;
use hmd_storage::mcap::McapLoss;
use thiserror::Error;

use crate::candump::BadLine;
use crate::damage::{Damage, Place};

/// Something that was in a source and could not be read.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Loss {
    /// A line of a text log.
    #[error(transparent)]
    Line(#[from] BadLine),
    /// A stretch of an MCAP file.
    #[error(transparent)]
    Mcap(#[from] McapLoss),
    /// A place of a log that another program wrote.
    #[error(transparent)]
    Foreign(#[from] Damage),
}

impl Loss {
    /// How many frames are known to be lost; 0 when that is unknown.
    pub fn frames(&self) -> u64 {
        match self {
            Self::Line(_) => 1,
            Self::Mcap(loss) => loss.frames(),
            Self::Foreign(damage) => u64::from(!matches!(damage.place, Place::Byte(_))),
        }
    }

    /// Adds it to the losses of a run; the number of damaged places of a file, 0 or 1.
    pub fn count_into(&self, losses: &mut Losses) -> u64 {
        match self {
            Self::Line(_)
            | Self::Foreign(Damage {
                place: Place::Line(_) | Place::Row(_) | Place::Frame(_),
                ..
            }) => {
                losses.unreadable += 1;
                0
            }
            Self::Mcap(_) | Self::Foreign(_) => {
                losses.damaged = losses.damaged.saturating_add(self.frames());
                1
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hmd_storage::mcap::McapFault;

    #[test]
    fn a_frame_that_cannot_be_is_one_and_a_stretch_of_bytes_any_number() {
        for (place, frames, unreadable) in [(Place::Frame(7), 1, 1), (Place::Row(7), 1, 1), (Place::Byte(7), 0, 0)] {
            let loss = Loss::Foreign(Damage {
                file: "a.blf".into(),
                place,
                expected: "a frame that can be",
                found: "another".to_owned(),
            });
            let mut losses = Losses::default();
            let damaged = loss.count_into(&mut losses);
            assert_eq!(
                (loss.frames(), losses.unreadable, damaged),
                (frames, unreadable, 1 - unreadable)
            );
        }
    }

    #[test]
    fn the_sum_of_missing_frames_does_not_overflow() {
        let loss = Loss::Mcap(McapLoss {
            file: "a.mcap".into(),
            at_byte: 0,
            fault: McapFault::MissingFrames {
                first_index: 0,
                count: u64::MAX / 2 + 1,
            },
        });
        let mut losses = Losses::default();
        let places: u64 = (0..2).map(|_| loss.count_into(&mut losses)).sum();
        assert_eq!((places, losses.damaged), (2, u64::MAX));
    }
}
