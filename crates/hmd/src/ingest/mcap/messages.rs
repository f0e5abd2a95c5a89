//! Messages of an MCAP file, as far as a checksum vouches for them.
//!
//! Chunks are read one by one and decoded only after their CRC was checked; whatever else stands in the file (bare
//! messages, chunks without a CRC) is not trusted. A damaged chunk costs that chunk. When the chain of records breaks,
//! reading goes on at the next chunk that the summary knows; without a summary (a file that was cut) it ends there.
//!
//! Tried and dropped: the crate's `MessageStream` and `IndexedReader`. A flipped byte gave silently wrong messages or
//! allocations that ended the process.

use super::chunk::{Channels, RECORD_LIMIT, read_chunk, read_some};
use super::fault::{McapFault, McapLoss};
use super::records;
use super::summary::{Summary, read_summary};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, records::op};
use std::collections::{BTreeMap, VecDeque};
use std::io::{self, Read, Seek, SeekFrom};
use std::sync::Arc;

/// Most metadata records that are kept.
const METADATA_LIMIT: usize = 64;
/// One message of an intact chunk.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct McapMessage {
    /// Topic.
    pub topic: Arc<str>,
    /// Name of the schema; empty when the channel has none.
    pub schema: Arc<str>,
    /// UTC time of the record, ns.
    pub log_time_ns: u64,
    /// Place of its chunk in the file.
    pub at_byte: u64,
    /// The encoded message.
    pub data: Vec<u8>,
}
/// Iterates over the messages of an MCAP file in bounded memory.
#[derive(Debug)]
pub struct McapMessages<R> {
    input: R,
    file: Arc<str>,
    outer: Outer,
    summary: Summary,
    channels: Channels,
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    queue: VecDeque<Result<McapMessage, McapLoss>>,
    /// Place of the next record.
    at_byte: u64,
    /// Place of the last chunk that was looked at.
    tried: u64,
    any_loss: bool,
    ended: bool,
}

struct Outer(LinearReader);

impl std::fmt::Debug for Outer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("LinearReader")
    }
}

impl<R: Read + Seek> McapMessages<R> {
    /// A reader of `input` from its start; `file` names it in errors.
    ///
    /// # Errors
    /// When the input cannot be read or sought.
    pub fn new(mut input: R, file: &str) -> io::Result<Self> {
        let summary = read_summary(&mut input)?.unwrap_or_default();
        input.rewind()?;
        let options = LinearReaderOptions::default()
            .with_emit_chunks(true)
            .with_validate_data_section_crc(true)
            .with_record_length_limit(RECORD_LIMIT);
        Ok(Self {
            input,
            file: file.into(),
            outer: Outer(LinearReader::new_with_options(options)),
            summary,
            channels: Channels::default(),
            metadata: BTreeMap::new(),
            queue: VecDeque::new(),
            at_byte: mcap::MAGIC.len() as u64,
            tried: 0,
            any_loss: false,
            ended: false,
        })
    }

    /// The file's name, as given.
    pub fn file(&self) -> &Arc<str> {
        &self.file
    }

    /// Place in the file up to which records were read.
    pub fn position(&self) -> u64 {
        self.at_byte
    }

    /// Metadata records read so far, by name. They have no checksum of their own.
    pub fn metadata(&self) -> &BTreeMap<String, BTreeMap<String, String>> {
        &self.metadata
    }

    /// Topics known so far, sorted.
    pub fn topics(&self) -> Vec<String> {
        let mut topics: Vec<String> = self.channels.topics().chain(self.summary.channels.topics()).collect();
        topics.sort_unstable();
        topics.dedup();
        topics
    }

    /// Reads one record of the file into the queue.
    fn advance(&mut self) {
        match self.outer.0.next_event() {
            None => {
                self.at_byte += mcap::MAGIC.len() as u64;
                self.resume_or_end();
            }
            Some(Ok(LinearReadEvent::ReadRequest(need))) => match read_some(&mut self.input, &mut self.outer.0, need) {
                Ok(()) => {}
                Err(error) => {
                    self.lose(McapFault::Io(error.kind()));
                    self.ended = true;
                }
            },
            Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                let at_byte = self.at_byte;
                self.at_byte += 9 + data.len() as u64;
                let fault = match opcode {
                    op::CHUNK => {
                        self.tried = at_byte;
                        read_chunk(
                            data,
                            at_byte,
                            &mut self.channels,
                            &self.summary.channels,
                            &mut self.queue,
                        )
                    }
                    op::MESSAGE => Err(McapFault::NoCrc),
                    op::METADATA => {
                        if let Some((name, content)) = records::metadata(data)
                            && self.metadata.len() < METADATA_LIMIT
                        {
                            self.metadata.insert(name.to_owned(), content);
                        }
                        Ok(())
                    }
                    _ => Ok(()),
                };
                if let Err(fault) = fault {
                    self.queue.push_back(Err(McapLoss {
                        file: self.file.clone(),
                        at_byte,
                        fault,
                    }));
                    self.any_loss = true;
                }
            }
            Some(Err(error)) => {
                let fault = match error {
                    McapError::UnexpectedEof => Some(McapFault::Truncated),
                    McapError::RecordTooLarge { len, .. } => Some(McapFault::TooLarge { got: len }),
                    // After a damaged chunk the sum over all data is wrong as well: nothing new.
                    McapError::BadDataCrc { .. } if self.any_loss => None,
                    McapError::BadDataCrc { saved, calculated } => Some(McapFault::DataCrc {
                        expected: saved,
                        got: calculated,
                    }),
                    other => Some(McapFault::Broken(other.to_string())),
                };
                if let Some(fault) = fault {
                    self.lose(fault);
                }
                self.resume_or_end();
            }
        }
    }

    fn lose(&mut self, fault: McapFault) {
        self.queue.push_back(Err(McapLoss {
            file: self.file.clone(),
            at_byte: self.at_byte,
            fault,
        }));
        self.any_loss = true;
    }

    /// Goes on at the next chunk that the summary knows and that was not looked at yet.
    fn resume_or_end(&mut self) {
        let next = self
            .summary
            .chunk_offsets
            .iter()
            .copied()
            .find(|&offset| offset > self.tried);
        let Some(offset) = next.filter(|&offset| self.input.seek(SeekFrom::Start(offset)).is_ok()) else {
            self.ended = true;
            return;
        };
        let options = LinearReaderOptions::default()
            .with_emit_chunks(true)
            .with_skip_start_magic(true)
            .with_record_length_limit(RECORD_LIMIT);
        self.outer = Outer(LinearReader::new_with_options(options));
        self.at_byte = offset;
        self.tried = offset;
    }
}

impl<R: Read + Seek> Iterator for McapMessages<R> {
    type Item = Result<McapMessage, McapLoss>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(item) = self.queue.pop_front() {
                return Some(item);
            }
            if self.ended {
                return None;
            }
            self.advance();
        }
    }
}
