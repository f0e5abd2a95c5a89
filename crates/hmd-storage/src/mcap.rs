//! Raw frames from an MCAP file that `hmd` wrote.
//!
//! Batches of one round are put back into the order in which their frames arrived on all buses, so that replay sees
//! what live saw. At most one round and one chunk are in memory.

pub(crate) mod channels;
mod chunk;
mod fault;
mod limits;
pub(crate) mod messages;
mod no_windows;
mod records;
mod resync_reader;
mod summary;
mod tail;

pub use fault::{McapFault, McapLoss};
pub use messages::{McapMessage, McapMessages};
pub use no_windows::NoWindows;
pub use tail::{McapTail, TailError};

use crate::regular_file::open_regular;
use hmd_core::frame::{BusNames, RawFrame};
use hmd_core::record::{RawBatch, Record};
use prost::Message;
use std::collections::{BTreeSet, VecDeque};
use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::Path;

/// Most frames held back for one round; a file of ours has fewer.
const ROUND_LIMIT: usize = 1 << 16;
/// Most losses held back for one round.
const HELD_MAX: usize = 64;
/// Longest batch that is decoded, bytes; of ours, none comes near 200 kB. Its frames take some 25 times as much at most.
const BATCH_BYTES_MAX: usize = 512 << 10;

/// Whether a regular file begins as an MCAP file does.
#[must_use]
pub fn is_mcap_file(path: &Path) -> bool {
    let mut start = Vec::new();
    let mut read = |file: File| file.take(mcap::MAGIC.len() as u64).read_to_end(&mut start);
    open_regular(path).is_ok_and(|file| read(file).is_ok()) && start == mcap::MAGIC
}

/// Iterates over the raw frames of an MCAP file, in the order of their arrival.
#[derive(Debug)]
pub struct McapFrames<R> {
    messages: McapMessages<R>,
    names: BusNames,
    /// Interfaces by topic, in the order of the batches; a frame enters `names` only when it is handed out.
    seen: BusNames,
    round: Vec<(u64, RawFrame)>,
    round_number: u64,
    round_at_byte: u64,
    next_index: u64,
    /// Newest stamp of a frame handed out, ns.
    newest_ns: u64,
    refused_topics: BTreeSet<String>,
    /// Losses in the middle of the round: they come behind its frames, which would else be taken for frames that were read before.
    held: Vec<McapLoss>,
    queue: VecDeque<Result<RawFrame, McapLoss>>,
}

impl<R: Read + Seek> McapFrames<R> {
    /// A reader of `input` from its start; `file` names it in errors, `names` is the table of interfaces to go on with.
    ///
    /// # Errors
    /// When the input cannot be read or sought.
    pub fn new(input: R, file: &str, names: BusNames) -> io::Result<Self> {
        Ok(Self::of_messages(McapMessages::new(input, file)?, names))
    }

    /// The frames among messages.
    #[must_use]
    pub fn of_messages(messages: McapMessages<R>, names: BusNames) -> Self {
        Self {
            messages,
            names,
            seen: BusNames::new(),
            round: Vec::new(),
            round_number: 0,
            round_at_byte: 0,
            next_index: 0,
            newest_ns: 0,
            refused_topics: BTreeSet::new(),
            held: Vec::new(),
            queue: VecDeque::new(),
        }
    }

    /// The interfaces seen so far.
    pub fn bus_names(&self) -> &BusNames {
        &self.names
    }

    /// The table of interfaces, to go on with in the next log.
    pub fn into_bus_names(self) -> BusNames {
        self.names
    }

    /// The messages below, for their position, topics, chunks and metadata.
    pub fn messages(&self) -> &McapMessages<R> {
        &self.messages
    }

    fn add_message(&mut self, message: &McapMessage) {
        let Some(interface) = interface_of(&message.topic) else {
            return;
        };
        if self.refused_topics.contains(&*message.topic) {
            return;
        }
        let topic = message.topic.to_string();
        let fault = if *message.schema != *RawBatch::SCHEMA_NAME {
            let found = message.schema.to_string();
            McapFault::Schema {
                topic: topic.clone(),
                expected: RawBatch::SCHEMA_NAME,
                found,
            }
        } else {
            match self.seen.intern(interface) {
                Err(cause) => McapFault::Bus {
                    topic: topic.clone(),
                    cause,
                },
                Ok(bus) => return self.add_batch(message, bus),
            }
        };
        // Said once per topic: all its messages have the same fault.
        self.refused_topics.insert(topic);
        self.lose(message.at_byte, fault);
    }

    fn add_batch(&mut self, message: &McapMessage, bus: u16) {
        if message.data.len() > BATCH_BYTES_MAX {
            let text = format!("{} bytes, instead of at most {BATCH_BYTES_MAX}", message.data.len());
            return self.lose(message.at_byte, McapFault::Batch(text));
        }
        let batch = match RawBatch::decode(message.data.as_slice()) {
            Ok(batch) => batch,
            Err(error) => return self.lose(message.at_byte, McapFault::Batch(error.to_string())),
        };
        let frames = match batch.unpack(bus) {
            Ok(frames) => frames,
            Err(error) => return self.lose(message.at_byte, McapFault::Batch(error.to_string())),
        };
        if batch.round != self.round_number || self.round.len() + frames.len() > ROUND_LIMIT {
            self.end_round();
        }
        self.round_number = batch.round;
        self.round_at_byte = message.at_byte;
        self.round.extend(frames);
    }

    /// Hands out the frames of a round in their order, and then the losses in it.
    fn end_round(&mut self) {
        self.end_frames();
        self.queue.extend(self.held.drain(..).map(Err));
    }

    /// The frames of the round, after a note on those that are missing before or between them.
    fn end_frames(&mut self) {
        let mut round = std::mem::take(&mut self.round);
        round.sort_by_key(|(index, _)| *index);
        // A chunk that is there twice, or overlaps another: neither place nor time is new.
        let (next_index, newest_ns, before) = (self.next_index, self.newest_ns, round.len());
        round.dedup_by_key(|(index, _)| *index);
        round.retain(|(index, frame)| *index >= next_index || frame.stamp_ns > newest_ns);
        let repeated = before - round.len();
        if repeated > 0 {
            let count = repeated as u64;
            let fault = McapFault::RepeatedFrames {
                expected: next_index,
                count,
            };
            self.lose(self.round_at_byte, fault);
        }
        let (Some((first, _)), Some((last, _))) = (round.first(), round.last()) else {
            return;
        };
        // Smaller places than expected: recordings were joined, and a new count begins.
        let expected = if *first < self.next_index {
            *first
        } else {
            self.next_index
        };
        let missing = (last - expected).saturating_add(1).saturating_sub(round.len() as u64);
        self.next_index = last.saturating_add(1);
        if missing > 0 {
            self.lose(
                self.round_at_byte,
                McapFault::MissingFrames {
                    first_index: expected,
                    count: missing,
                },
            );
        }
        for (_, frame) in round.drain(..) {
            self.newest_ns = self.newest_ns.max(frame.stamp_ns);
            let interface = self.seen.name(frame.bus).unwrap_or_default();
            match self.names.intern(interface) {
                Ok(bus) => self.queue.push_back(Ok(frame.with_bus(bus))),
                Err(cause) => {
                    let topic = format!("/bus/{interface}/raw");
                    if self.refused_topics.insert(topic.clone()) {
                        self.lose(self.round_at_byte, McapFault::Bus { topic, cause });
                    }
                }
            }
        }
        self.round = round;
    }

    fn lose(&mut self, at_byte: u64, fault: McapFault) {
        self.queue.push_back(Err(McapLoss {
            file: self.messages.file().clone(),
            at_byte,
            fault,
        }));
    }
}

/// `vcan0` of `/bus/vcan0/raw`.
fn interface_of(topic: &str) -> Option<&str> {
    topic
        .strip_prefix("/bus/")?
        .strip_suffix("/raw")
        .filter(|name| !name.is_empty() && !name.contains('/'))
}

impl<R: Read + Seek> Iterator for McapFrames<R> {
    type Item = Result<RawFrame, McapLoss>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(item) = self.queue.pop_front() {
                return Some(item);
            }
            match self.messages.next() {
                Some(Ok(message)) => self.add_message(&message),
                Some(Err(loss)) => {
                    self.held.push(loss);
                    if self.round.is_empty() || self.held.len() == HELD_MAX {
                        self.end_round();
                    }
                }
                None if self.round.is_empty() => return None,
                None => self.end_round(),
            }
        }
    }
}

#[cfg(test)]
mod tests;
