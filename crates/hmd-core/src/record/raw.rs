//! Raw frames of one bus in one message: one sample per message would triple the file.
//!
//! The sink cuts the stream of all buses into *rounds* and writes one batch per bus and round. Every frame keeps its
//! place in the whole stream (`first_index`, `index_step`), so that a reader restores the order across buses and sees
//! how many frames a damaged chunk has cost.

use super::schema::message;
use crate::frame::{FrameError, FrameFlags, RawFrame};
use thiserror::Error;

message! {
    /// Frames of one bus, in the order of their arrival; all arrays have one entry per frame unless said otherwise.
    pub struct RawBatch {
        /// Interface name, as in the topic.
        interface: String = 1 string;
        /// Number of the round; batches of one round were cut from the same stretch of the stream.
        round: u64 = 2 uint64;
        /// Place of the first frame in the stream of all buses of this file, from 0.
        first_index: u64 = 3 uint64;
        /// Distance of each further frame from the one before in that stream; empty: all 1.
        index_step: Vec<u32> = 4 uint32 repeated;
        /// Stamp of the first frame, UTC ns.
        first_stamp_ns: u64 = 5 uint64;
        /// Stamp of each further frame minus the one before, ns; negative when the host clock stepped back.
        stamp_step_ns: Vec<i64> = 6 sint64 repeated;
        /// Identifier without flags; 0 of a serial line.
        id: Vec<u32> = 7 uint32 repeated;
        /// Bits: 1 extended, 2 remote, 4 error, 8 FD, 16 BRS, 32 ESI, 64 sent by this host; 128 alone: of a serial line.
        flags: Vec<u32> = 8 uint32 repeated;
        /// Data length, bytes; for a remote request the length it asks for.
        length: Vec<u32> = 9 uint32 repeated;
        /// Data of all frames, end to end; a remote request has none.
        payload: Vec<u8> = 10 bytes;
    }
}

/// A decoded batch that is not one: the arrays contradict each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum BatchError {
    /// An array has the wrong number of entries.
    #[error("field {field} has {got} entries instead of {expected}")]
    Count {
        /// Name of the field.
        field: &'static str,
        /// Entries that the identifiers call for.
        expected: usize,
        /// Entries found.
        got: usize,
    },
    /// A stamp or an index leaves its range.
    #[error("frame {frame} of the batch has a stamp or an index out of range")]
    Range {
        /// Place in the batch, from 0.
        frame: usize,
    },
    /// The values of one frame do not make a frame.
    #[error("frame {frame} of the batch: {cause}")]
    Frame {
        /// Place in the batch, from 0.
        frame: usize,
        /// What is wrong with it.
        cause: FrameError,
    },
}

impl RawBatch {
    /// A batch of `frames`, each with its place in the stream of all buses.
    ///
    /// # Panics
    /// If `frames` is empty or the places do not grow.
    pub fn pack(interface: &str, round: u64, frames: &[(u64, &RawFrame)]) -> Self {
        let (first_index, first) = frames[0];
        let mut batch = Self {
            interface: interface.to_owned(),
            round,
            first_index,
            first_stamp_ns: first.stamp_ns,
            ..Self::default()
        };
        for pair in frames.windows(2) {
            let ((before_index, before), (index, frame)) = (pair[0], pair[1]);
            assert!(index > before_index, "places grow within a batch");
            batch.index_step.push((index - before_index) as u32);
            // Wrapping is right: adding it again with wrap gives the stamp back, whatever the clock did.
            batch
                .stamp_step_ns
                .push(frame.stamp_ns.wrapping_sub(before.stamp_ns) as i64);
        }
        if batch.index_step.iter().all(|&step| step == 1) {
            batch.index_step.clear();
        }
        for (_, frame) in frames {
            batch.id.push(frame.id());
            batch.flags.push(u32::from(frame.flags().bits()));
            batch.length.push(frame.announced_len() as u32);
            batch.payload.extend_from_slice(frame.data());
        }
        batch
    }

    /// The frames with their places in the stream, on interface index `bus`.
    ///
    /// # Errors
    /// [`BatchError`] when the arrays contradict each other; then no frame of the batch can be trusted.
    pub fn unpack(&self, bus: u16) -> Result<Vec<(u64, RawFrame)>, BatchError> {
        let count = self.id.len();
        let check = |field, expected: usize, got: usize| {
            if expected == got {
                Ok(())
            } else {
                Err(BatchError::Count { field, expected, got })
            }
        };
        check("flags", count, self.flags.len())?;
        check("length", count, self.length.len())?;
        check("stamp_step_ns", count.saturating_sub(1), self.stamp_step_ns.len())?;
        if !self.index_step.is_empty() {
            check("index_step", count.saturating_sub(1), self.index_step.len())?;
        }
        if self.first_index > MAX_INDEX {
            return Err(BatchError::Range { frame: 0 });
        }
        let (mut index, mut stamp_ns, mut rest) = (self.first_index, self.first_stamp_ns, self.payload.as_slice());
        let mut frames = Vec::with_capacity(count);
        for at in 0..count {
            if let Some(before) = at.checked_sub(1) {
                let step = self.index_step.get(before).copied().unwrap_or(1);
                index = index
                    .checked_add(u64::from(step))
                    .filter(|_| step > 0)
                    .ok_or(BatchError::Range { frame: at })?;
                stamp_ns = stamp_ns.wrapping_add(self.stamp_step_ns[before] as u64);
            }
            let flags = u8::try_from(self.flags[at]).map_err(|_| BatchError::Range { frame: at })?;
            let flags = FrameFlags::from_bits(flags);
            let length = usize::try_from(self.length[at]).unwrap_or(usize::MAX);
            let asked = [0; crate::frame::MAX_DATA];
            let data = if flags.contains(FrameFlags::REMOTE) {
                asked.get(..length)
            } else {
                rest.split_at_checked(length).map(|(data, more)| {
                    rest = more;
                    data
                })
            };
            let data = data.ok_or(BatchError::Count {
                field: "payload",
                expected: length,
                got: rest.len(),
            })?;
            let frame = RawFrame::new(stamp_ns, bus, self.id[at], flags, data);
            frames.push((index, frame.map_err(|cause| BatchError::Frame { frame: at, cause })?));
        }
        check("payload", self.payload.len() - rest.len(), self.payload.len())?;
        Ok(frames)
    }
}

/// Largest place that is believed, so that sums of losses stay in range; centuries of a full bus.
const MAX_INDEX: u64 = 1 << 48;

super::impl_record!(RawBatch, |batch| format!("/bus/{}/raw", batch.interface));

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::any_frame;
    use proptest::prelude::*;
    use prost::Message;

    proptest! {
        #[test]
        fn unpack_inverts_pack(frames in prop::collection::vec((any_frame(), 1..5u64), 1..40)) {
            let mut index = 7;
            let placed: Vec<_> = frames.iter().map(|(frame, step)| { index += step; (index, frame) }).collect();
            let bytes = RawBatch::pack("vcan0", 3, &placed).encode_to_vec();
            let unpacked = RawBatch::decode(bytes.as_slice()).unwrap().unpack(0).unwrap();
            prop_assert_eq!(unpacked, placed.into_iter().map(|(index, frame)| (index, *frame)).collect::<Vec<_>>());
        }

        #[test]
        fn any_bytes_are_refused_or_unpacked(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            if let Ok(batch) = RawBatch::decode(bytes.as_slice()) {
                let _ = batch.unpack(0);
            }
        }
    }

    #[test]
    fn serial_frames_come_back() {
        let frames = [&b"abc"[..], &[], &[1; 64]].map(|bytes| RawFrame::of_serial(9, 0, bytes));
        let placed: Vec<_> = frames
            .iter()
            .enumerate()
            .map(|(at, frame)| (at as u64, frame))
            .collect();
        let unpacked = RawBatch::pack("uart1", 0, &placed).unpack(0).unwrap();
        assert_eq!(
            unpacked,
            placed.into_iter().map(|(at, frame)| (at, *frame)).collect::<Vec<_>>()
        );
    }

    #[test]
    fn contradicting_arrays_are_refused() {
        let frame = RawFrame::new(1, 0, 1, FrameFlags::NONE, &[1, 2]).unwrap();
        let good = RawBatch::pack("vcan0", 0, &[(0, &frame), (1, &frame)]);
        let mut bad = good.clone();
        bad.payload.pop();
        assert_eq!(
            bad.unpack(0),
            Err(BatchError::Count {
                field: "payload",
                expected: 2,
                got: 1
            })
        );
        let mut bad = good.clone();
        bad.payload.push(0);
        assert!(matches!(bad.unpack(0), Err(BatchError::Count { field: "payload", .. })));
        let mut bad = good;
        bad.flags[1] = 300;
        assert_eq!(bad.unpack(0), Err(BatchError::Range { frame: 1 }));
    }
}
