//! What is left of a damaged MCAP file, as a whole one.
//!
//! Every chunk whose checksum is right is kept, message by message and with its definitions; everything else is left out
//! and reported. The result has a summary again, so that any reader takes it. Bounded like the reader below
//! ([`McapMessages`]), with a list of at most [`LISTED_MAX`] losses.

use std::collections::{BTreeMap, HashMap};
use std::io::{self, Read, Seek, Write};
use std::sync::Arc;

use mcap::records::{MessageHeader, Metadata};
use mcap::{McapError, Writer};

use crate::mcap::channels::Channel;
use crate::mcap::messages::McapMetadata;
use crate::mcap::{McapFault, McapFrames, McapLoss, McapMessage, McapMessages};
use crate::mcap_writer::{root_cause, write_options};
use hmd_core::frame::BusNames;
use hmd_core::metadata_checksum::{is_sealed, seal};

/// Most losses that are listed; the others are counted.
pub const LISTED_MAX: usize = 1000;

/// Name of the metadata record of a copy that lacks parts of its original; `losses` is their number.
pub const RECOVERED_NAME: &str = "hmd.recovered";

/// Library in the header of a copy of a file that another program wrote.
const LIBRARY_OF_OTHERS: &str = concat!("hmd-recover/", env!("CARGO_PKG_VERSION"));

/// Why nothing can be recovered.
#[derive(Debug, thiserror::Error)]
pub enum RecoverError {
    /// The damaged file cannot be read at all.
    #[error("{file}: expected a readable file, found: {cause}")]
    Input {
        /// The file.
        file: String,
        /// Error of the operating system.
        cause: io::Error,
    },
    /// The result cannot be written.
    #[error("cannot write the recovered file: {}", root_cause(.0))]
    Output(#[from] McapError),
}

/// What was kept and what was lost.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recovered {
    /// Intact chunks.
    pub chunks: u64,
    /// Messages in them, all kept.
    pub messages: u64,
    /// Metadata records that a checksum vouches for, kept; copies of definitions apart, which the summary takes the
    /// place of.
    pub metadata: u64,
    /// Bytes that the chunks were expanded to: what the work depends on.
    pub expanded_bytes: u64,
    /// The chunks expand to more than is allowed; the rest was not read.
    pub is_given_up: bool,
    /// Attachments, which are left out (`hmd` writes none).
    pub attachments_lost: u64,
    /// Whatever cannot be used, by its place: the first [`LISTED_MAX`].
    pub losses: Vec<McapLoss>,
    /// All of them.
    pub losses_total: u64,
    /// Place of the last chunk of which a message was kept.
    pub last_chunk_at: Option<u64>,
}

impl Recovered {
    /// Whether the file was intact.
    #[must_use]
    pub fn is_intact(&self) -> bool {
        self.losses_total == 0 && self.attachments_lost == 0
    }

    fn lose(&mut self, loss: McapLoss) {
        self.losses_total += 1;
        self.is_given_up |= loss.fault == McapFault::Expansion;
        if self.losses.len() < LISTED_MAX {
            self.losses.push(loss);
        }
    }
}

/// Writes what is intact in `input` to `out` as a finished file with this `profile` in its header. Where something is lost, a metadata record
/// [`RECOVERED_NAME`] says so: the copy itself is whole.
///
/// # Errors
/// [`RecoverError`]; damage of the input is none, it is in the report.
pub fn recover<R: Read + Seek, W: Write + Seek>(
    input: R,
    file: &str,
    out: W,
    profile: &str,
) -> Result<(W, Recovered), RecoverError> {
    let (mut copy, report) = copied(input, file, out, profile, u64::MAX, &|| false)?;
    if !report.is_intact() {
        let mut metadata = BTreeMap::from([("losses".to_owned(), report.losses_total.to_string())]);
        seal(RECOVERED_NAME, &mut metadata);
        let name = RECOVERED_NAME.to_owned();
        copy.writer.write_metadata(&Metadata { name, metadata })?;
    }
    Ok((copy.finished()?, report))
}

/// The same without that record, given up when the chunks expand to more than `expanded_max` bytes, or at the next message once it is stopped.
pub(crate) fn recover_within<R: Read + Seek, W: Write + Seek>(
    input: R,
    file: &str,
    out: W,
    profile: &str,
    expanded_max: u64,
    is_stopped: &dyn Fn() -> bool,
) -> Result<(W, Recovered), RecoverError> {
    let (copy, report) = copied(input, file, out, profile, expanded_max, is_stopped)?;
    Ok((copy.finished()?, report))
}

/// What is intact, in a file that is not finished yet.
fn copied<R: Read + Seek, W: Write + Seek>(
    input: R,
    file: &str,
    out: W,
    profile: &str,
    expanded_max: u64,
    is_stopped: &dyn Fn() -> bool,
) -> Result<(Copy<W>, Recovered), RecoverError> {
    let messages = McapMessages::new(input, file).map_err(|cause| RecoverError::Input {
        file: file.to_owned(),
        cause,
    })?;
    let mut messages = messages.expanding_at_most(expanded_max);
    // The header is read with the first item. Who counted the messages stays visible.
    let mut item = messages.next();
    let options = write_options().profile(profile);
    let options = match messages.is_own_file() {
        true => options,
        false => options.library(LIBRARY_OF_OTHERS),
    };
    let mut copy = Copy {
        writer: options.create(out)?,
        channels: HashMap::new(),
        chunk_at: None,
        chunk_bytes: 0,
    };
    let mut report = Recovered::default();
    let (mut seen, mut unsealed) = (0, Vec::new());
    loop {
        for metadata in &messages.all_metadata()[seen..] {
            if is_sealed(&metadata.name, &metadata.content) {
                copy.metadata(metadata)?;
                report.metadata += 1;
            } else {
                unsealed.push(metadata.clone());
            }
        }
        seen = messages.all_metadata().len();
        match item {
            Some(Ok(message)) => {
                copy.message(&message)?;
                report.messages += 1;
            }
            Some(Err(loss)) => report.lose(loss),
            None => break,
        }
        if is_stopped() {
            report.is_given_up = true;
            break;
        }
        item = messages.next();
    }
    for metadata in unsealed {
        if messages.all_verified() {
            copy.metadata(&metadata)?;
            report.metadata += 1;
        } else {
            report.lose(McapLoss {
                file: messages.file().clone(),
                at_byte: metadata.at_byte,
                fault: McapFault::Metadata { name: metadata.name },
            });
        }
    }
    report.attachments_lost = messages.attachments();
    report.chunks = messages.chunks();
    report.expanded_bytes = messages.expanded_bytes();
    report.last_chunk_at = copy.chunk_at;
    Ok((copy, report))
}

/// Raw frames in a file, and how many are missing between them by their count.
///
/// # Errors
/// When the input cannot be read.
pub fn count_frames<R: Read + Seek>(input: R, file: &str) -> io::Result<(u64, u64)> {
    let (mut frames, mut missing) = (0, 0);
    for item in McapFrames::new(input, file, BusNames::new())? {
        match item {
            Ok(_) => frames += 1,
            // A damaged file may claim any numbers.
            Err(loss) => missing = u64::saturating_add(missing, loss.frames()),
        }
    }
    Ok((frames, missing))
}

/// The file being written.
struct Copy<W: Write + Seek> {
    writer: Writer<W>,
    /// Numbers of channels in the new file, by their definition.
    channels: HashMap<*const Channel, (Arc<Channel>, u16)>,
    /// Chunk of the newest message.
    chunk_at: Option<u64>,
    /// Written since the last chunk was ended.
    chunk_bytes: usize,
}

/// Chunks of the source that are smaller go together into one: each adds an entry to the index that is held until the end.
const CHUNK_BYTES_MIN: usize = 4096;

impl<W: Write + Seek> Copy<W> {
    /// The file with its summary.
    fn finished(mut self) -> Result<W, McapError> {
        self.writer.finish()?;
        let mut out = self.writer.into_inner();
        out.flush()?;
        Ok(out)
    }

    /// Ends the chunk where the source did, unless it is very small.
    fn message(&mut self, message: &McapMessage) -> Result<(), McapError> {
        let is_new = self.chunk_at.replace(message.at_byte) != Some(message.at_byte);
        if is_new && self.chunk_bytes >= CHUNK_BYTES_MIN {
            self.writer.flush()?;
            self.chunk_bytes = 0;
        }
        self.chunk_bytes += message.data.len();
        let channel_id = self.channel(&message.channel)?;
        let header = MessageHeader {
            channel_id,
            sequence: message.sequence,
            log_time: message.log_time_ns,
            publish_time: message.publish_time_ns,
        };
        self.writer.write_to_known_channel(&header, &message.data)
    }

    fn channel(&mut self, channel: &Arc<Channel>) -> Result<u16, McapError> {
        // The definition is kept beside its number, so its address stays its own.
        if let Some((_, id)) = self.channels.get(&Arc::as_ptr(channel)) {
            return Ok(*id);
        }
        let schema = match &channel.schema {
            Some(schema) => self.writer.add_schema(&schema.name, &schema.encoding, &schema.data)?,
            None => 0,
        };
        let id = self
            .writer
            .add_channel(schema, &channel.topic, &channel.encoding, &channel.metadata)?;
        self.channels.insert(Arc::as_ptr(channel), (channel.clone(), id));
        Ok(id)
    }

    fn metadata(&mut self, metadata: &McapMetadata) -> Result<(), McapError> {
        self.writer.write_metadata(&Metadata {
            name: metadata.name.clone(),
            metadata: metadata.content.clone(),
        })
    }
}
