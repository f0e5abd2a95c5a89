//! Measurement files of ASAM MDF version 4, `.mf4`, with the frames of CAN buses.
//!
//! Blocks with links between them: the file's head, data groups, in each its channel groups (one layout of records each) and their
//! channels, and the records, in one block or a list, compressed or not. Channel groups with channels `CAN_DataFrame.…`,
//! `CAN_RemoteFrame.…` or `CAN_ErrorFrame.…` (ASAM's bus logging) become frames, those of all data groups in the order of their stamps. A
//! file that its writer did not finalise is read by the lengths of its records instead of its counters.
//!
//! Interface: `can<BusChannel>`, as the number stands in the file. A start in local time without an offset is taken as UTC. Stamps are
//! floats of seconds and are rounded to whole microseconds.
//!
//! Memory and time are bounded: of each data group one block is held, no block is visited twice, a compressed block is inflated to
//! 8 MiB at most.

mod block;
mod channel;
mod layout;
mod records;
#[cfg(feature = "signals")]
mod signals;

use std::io::{Read, Seek};
use std::sync::Arc;

use hmd_core::frame::{BusNames, RawFrame};

use crate::damage::{Damage, Place};
use block::Blocks;
use layout::{Layout, Stamped};
use records::Records;
#[cfg(feature = "signals")]
pub use signals::MdfSignals;

/// Beginnings of such a file: finalised, and not.
pub const MAGICS: [&[u8]; 2] = [b"MDF     ", b"UnFinMF "];

/// Most data groups with frames that are read beside each other.
const GROUPS_MAX: usize = 32;

/// Reads the frames of a file.
#[derive(Debug)]
pub struct MdfReader<R> {
    blocks: Blocks<R>,
    names: BusNames,
    groups: Vec<Group>,
    /// Bytes of records read.
    position: u64,
    /// Channel groups of the file whose frames cannot be read, and why.
    refused: Vec<Damage>,
}

#[derive(Debug)]
struct Group {
    records: Records,
    layout: Layout,
    /// Its next frame.
    next: Option<Stamped>,
    ended: bool,
}

impl<R: Read + Seek> MdfReader<R> {
    /// A reader of `input`; `file` names it in errors, `names` is the table of interfaces to go on with.
    ///
    /// # Errors
    /// The head or the structure of the file cannot be read.
    pub fn new(input: R, file: &str, names: BusNames) -> Result<Self, Damage> {
        let file: Arc<str> = file.into();
        let mut blocks = Blocks::new(input, file)?;
        let mut refused = Vec::new();
        let mut groups = Vec::new();
        let found = layout::read(&mut blocks, &mut refused)?;
        for (layout, data) in found.into_iter().filter(|(layout, _)| layout.has_frames()) {
            if groups.len() == GROUPS_MAX {
                return Err(blocks.damage(0, "at most 32 data groups with frames", "more"));
            }
            groups.push(Group {
                records: Records::new(data, &layout),
                layout,
                next: None,
                ended: false,
            });
        }
        Ok(Self {
            blocks,
            names,
            groups,
            position: 0,
            refused,
        })
    }

    /// Whether the file says of any of its records that they are frames.
    #[must_use]
    pub fn has_frames(&self) -> bool {
        !self.groups.is_empty() || !self.refused.is_empty()
    }

    /// The interfaces seen so far.
    pub fn bus_names(&self) -> &BusNames {
        &self.names
    }

    /// The table of interfaces, to go on with in the next log.
    pub fn into_bus_names(self) -> BusNames {
        self.names
    }

    /// Bytes of the file read so far.
    pub fn position(&self) -> u64 {
        self.position
    }
}

impl<R: Read + Seek> Iterator for MdfReader<R> {
    type Item = Result<RawFrame, Damage>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Some(refused) = self.refused.pop() {
            return Some(Err(refused));
        }
        for group in &mut self.groups {
            while group.next.is_none() && !group.ended {
                let record = match group.records.next(&mut self.blocks) {
                    Ok(Some(record)) => record,
                    Ok(None) => {
                        group.ended = true;
                        continue;
                    }
                    Err(damage) => {
                        group.ended = true;
                        return Some(Err(damage));
                    }
                };
                match group.layout.frame(record.format, record.bytes) {
                    Ok(frame) => group.next = frame,
                    Err(found) => {
                        let damage = self.blocks.damage(record.at, "a frame that can be", &found);
                        return Some(Err(damage.at(Place::Frame(record.at))));
                    }
                }
            }
        }
        self.position = self.blocks.bytes_read();
        let waiting = self
            .groups
            .iter_mut()
            .filter(|group| group.next.is_some())
            .min_by_key(|group| group.next.as_ref().map(Stamped::stamp_ns))?;
        let at = waiting.records.at();
        let stamped = waiting.next.take()?;
        Some(
            stamped
                .into_frame(&mut self.names)
                .map_err(|found| self.blocks.damage(at, "an interface", &found).at(Place::Frame(at))),
        )
    }
}

#[cfg(test)]
mod tests;
