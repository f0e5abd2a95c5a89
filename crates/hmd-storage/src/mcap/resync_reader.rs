//! Reads the records of an MCAP file that may be damaged, and resynchronises after a broken one.
//!
//! In: the bytes of a file. Out: [`ResyncItem`]s, chunks whose checksum is right and the places of everything else.
//!
//! The lengths that lead from record to record have no checksum, so no length is trusted alone: a record is skipped only
//! when the bytes after it look like a record too, or when it is metadata with the right checksum in it. Otherwise the
//! reader searches, byte by byte, for the next chunk whose own lengths agree with each other. So one broken record costs
//! no chunk after it, with or without a summary.
//!
//! Memory: one record of at most [`RECORD_BYTES_MAX`], its decompressed content of the same size, and the decoder's
//! buffers for both. Time: what the search tries to decode is bounded by a multiple of the file's size
//! ([`SEARCH_FACTOR`]).

use super::chunk::{Content, verify};
use super::fault::McapFault;
use super::limits::{EXPANSION_MAX, METADATA_BYTES_MAX, RECORD_BYTES_MAX};
use super::records;
use crate::quoted;
use crc32fast::Hasher;
use hmd_core::metadata_checksum::is_sealed;
use mcap::records::op;
use std::io::{self, BufReader, Read, Seek, SeekFrom};

/// Opcode and length.
pub(super) const HEAD: u64 = 9;
/// Bytes of a chunk, head included, that [`chunk_length`] looks at.
const CHUNK_HEAD: usize = 53;
/// Bytes read at once.
const BLOCK: usize = 64 << 10;
/// How many times its own size of a file the search may try to decode, on top of one record.
const SEARCH_FACTOR: u64 = 16;

/// One item of the file.
#[derive(Debug)]
pub(super) struct ResyncItem {
    /// Place of its record.
    pub(super) at_byte: u64,
    pub(super) kind: ItemKind,
}

/// Kind of an item, with its content.
#[derive(Debug)]
pub(super) enum ItemKind {
    /// A chunk with the right checksum.
    Chunk(Content),
    /// The header, which has no checksum of its own.
    Header(Vec<u8>),
    /// A metadata record, which MCAP gives no checksum.
    Metadata(Vec<u8>),
    /// An attachment; not read here.
    Attachment,
    /// The data have ended, and the checksum over all of them is right.
    AllVerified,
    /// Something that cannot be used.
    Fault(McapFault),
}

/// Reader of the items of a file, front to back.
#[derive(Debug)]
pub(super) struct ResyncReader<R> {
    input: BufReader<R>,
    length: u64,
    /// Place of the next record, or where the search goes on.
    at: u64,
    searching: bool,
    search_bytes_left: u64,
    /// What the chunks to come may expand to.
    expand_bytes_left: u64,
    expanded_bytes: u64,
    /// Sum over the data so far; `None` once something was left out or the data have ended.
    sum: Option<Hasher>,
    ended: bool,
    /// The file may go on behind `length`.
    growing: bool,
    /// Its footer was read.
    finished: bool,
    /// A file in progress: what is torn at its end is not written yet, and no fault.
    in_progress: bool,
    /// Fault of a record that ends behind the file, until it is known whether another follows.
    torn: Option<ResyncItem>,
}

impl<R: Read + Seek> ResyncReader<R> {
    pub(super) fn new(mut input: R) -> io::Result<Self> {
        let length = input.seek(SeekFrom::End(0))?;
        input.rewind()?;
        Ok(Self {
            growing: false,
            ..Self::growing(input, length)
        })
    }

    /// Of a file that is still being written: up to `length`, where a record must end, and then as [`ResyncReader::grow`] says.
    pub(super) fn growing(input: R, length: u64) -> Self {
        Self {
            input: BufReader::with_capacity(BLOCK, input),
            length,
            at: 0,
            searching: false,
            search_bytes_left: length
                .saturating_mul(SEARCH_FACTOR)
                .saturating_add(RECORD_BYTES_MAX as u64),
            expand_bytes_left: length
                .saturating_mul(EXPANSION_MAX)
                .saturating_add(2 * RECORD_BYTES_MAX as u64),
            expanded_bytes: 0,
            sum: Some(Hasher::new()),
            ended: false,
            growing: true,
            finished: false,
            in_progress: false,
            torn: None,
        }
    }

    /// The same of a file that another process may be writing.
    pub(super) fn in_progress(mut self) -> Self {
        self.in_progress = true;
        self
    }

    /// Goes on as far as `length`, where a record must end unless nothing more will come.
    pub(super) fn grow(&mut self, length: u64, last: bool) {
        let more = length.saturating_sub(self.length);
        self.search_bytes_left = self
            .search_bytes_left
            .saturating_add(more.saturating_mul(SEARCH_FACTOR));
        self.expand_bytes_left = self
            .expand_bytes_left
            .saturating_add(more.saturating_mul(EXPANSION_MAX));
        self.length += more;
        self.growing = !last;
        self.ended = self.finished;
    }

    /// Ends with [`McapFault::Expansion`] before the chunks expand to more than this, too.
    pub(super) fn limit_expansion(&mut self, bytes: u64) {
        self.expand_bytes_left = self.expand_bytes_left.min(bytes);
    }

    /// Place up to which the file was read.
    pub(super) fn position(&self) -> u64 {
        self.at
    }

    /// Bytes that the chunks so far were expanded to.
    pub(super) fn expanded_bytes(&self) -> u64 {
        self.expanded_bytes
    }

    /// The next item; `None` at the end.
    pub(super) fn next(&mut self) -> Option<ResyncItem> {
        while !self.ended {
            match self.advance() {
                Ok(None) => {}
                Ok(Some(found)) => return Some(found),
                Err(error) => {
                    self.ended = true;
                    return Some(fault(self.at, McapFault::Io(error.kind())));
                }
            }
        }
        None
    }

    /// One record, or one stretch searched.
    fn advance(&mut self) -> io::Result<Option<ResyncItem>> {
        if self.at == 0 {
            return self.magic();
        }
        if self.searching {
            match self.search()? {
                Some(at) => {
                    self.at = at;
                    if let Some(torn) = self.torn.take() {
                        return Ok(Some(torn));
                    }
                }
                None => {
                    self.ended = true;
                    self.at = self.length;
                    return Ok(None);
                }
            }
        }
        let at_byte = self.at;
        let left = self.length - at_byte;
        if left == 0 && self.growing || left < HEAD && self.in_progress {
            self.ended = true;
            self.at = self.length;
            return Ok(None);
        }
        if left < HEAD {
            self.ended = true;
            self.at = self.length;
            return Ok(Some(fault(at_byte, McapFault::Truncated)));
        }
        self.input.seek(SeekFrom::Start(at_byte))?;
        let mut head = [0; HEAD as usize];
        self.input.read_exact(&mut head)?;
        let (opcode, length) = (head[0], length_of(&head));
        if !is_opcode(opcode) {
            return Ok(Some(self.broken(McapFault::Broken(format!("opcode {opcode:#04x}")))));
        }
        if length > left - HEAD {
            let cut = length <= RECORD_BYTES_MAX as u64;
            if cut && self.in_progress {
                self.torn = Some(self.broken(McapFault::Truncated));
                return Ok(None);
            }
            let fault = if cut {
                McapFault::Truncated
            } else {
                McapFault::TooLarge { got: length }
            };
            return Ok(Some(self.broken(fault)));
        }
        let agreed = self.agreed_chunk_length(head)?;
        if opcode != op::CHUNK && agreed == Some(length) {
            // Passed as what it claims to be, it would be lost without a report.
            let text = format!("it is one but for its opcode {opcode:#04x}");
            return Ok(Some(self.broken(McapFault::Chunk(text))));
        }
        match opcode {
            op::CHUNK if agreed != Some(length) => {
                let text = "its lengths contradict each other".to_owned();
                Ok(Some(self.broken(McapFault::Chunk(text))))
            }
            op::CHUNK => self.chunk(head, length).map(Some),
            op::FOOTER => self.footer(length),
            _ => self.other(head, length),
        }
    }

    fn magic(&mut self) -> io::Result<Option<ResyncItem>> {
        let mut magic = [0; mcap::MAGIC.len()];
        let got = read_up_to(&mut self.input, &mut magic)?;
        self.at = got as u64;
        let start = &magic[..got];
        if got < magic.len() {
            self.ended = true;
            let found = match start {
                [] => McapFault::Empty,
                start if mcap::MAGIC.starts_with(start) => McapFault::Truncated,
                start => McapFault::Start(quoted(start)),
            };
            return Ok(Some(fault(0, found)));
        }
        if magic != mcap::MAGIC {
            self.at = 1;
            self.searching = true;
            self.sum = None;
            return Ok(Some(fault(0, McapFault::Start(quoted(start)))));
        }
        self.add(&magic);
        Ok(None)
    }

    /// What [`chunk_length`] says of the record whose head was read, whatever its opcode.
    fn agreed_chunk_length(&mut self, head: [u8; 9]) -> io::Result<Option<u64>> {
        let mut shown = [0; CHUNK_HEAD];
        shown[..9].copy_from_slice(&head);
        shown[0] = op::CHUNK;
        let got = read_up_to(&mut self.input, &mut shown[9..])?;
        self.input.seek_relative(-(got as i64))?;
        Ok(chunk_length(&shown[..9 + got]))
    }

    fn chunk(&mut self, head: [u8; 9], length: u64) -> io::Result<ResyncItem> {
        let at_byte = self.at;
        let mut chunk = vec![0; length as usize];
        self.input.read_exact(&mut chunk)?;
        let end = at_byte + HEAD + length;
        let expanded = records::chunk_expanded_bytes(&chunk).unwrap_or(0);
        let Some(left) = self.expand_bytes_left.checked_sub(expanded) else {
            self.ended = true;
            self.finished = true;
            self.sum = None;
            self.at = self.length;
            return Ok(fault(at_byte, McapFault::Expansion));
        };
        self.expand_bytes_left = left;
        self.expanded_bytes += expanded;
        match verify(&chunk) {
            Ok(content) => {
                self.add(&head);
                self.add(&chunk);
                self.at = end;
                if std::mem::take(&mut self.searching) {
                    self.sum = None;
                }
                Ok(ResyncItem {
                    at_byte,
                    kind: ItemKind::Chunk(content),
                })
            }
            Err(cause) if !self.searching && self.is_record_next()? => {
                self.sum = None;
                self.at = end;
                Ok(fault(at_byte, cause))
            }
            Err(cause) => Ok(self.broken(cause)),
        }
    }

    /// The footer is one only when nothing but the magic follows.
    fn footer(&mut self, length: u64) -> io::Result<Option<ResyncItem>> {
        const LENGTH: u64 = 20;
        let end = self.at + HEAD + LENGTH;
        self.input.seek_relative(length.min(LENGTH) as i64)?;
        let mut tail = Vec::new();
        (&mut self.input)
            .take(1 + mcap::MAGIC.len() as u64)
            .read_to_end(&mut tail)?;
        if length == LENGTH && tail == mcap::MAGIC {
            self.ended = true;
            self.finished = true;
            self.at = self.length;
            return Ok(None);
        }
        if length == LENGTH && mcap::MAGIC.starts_with(&tail) {
            self.ended = true;
            self.at = self.length;
            return Ok(Some(fault(end, McapFault::Truncated)));
        }
        let text = "bytes after the footer".to_owned();
        Ok(Some(self.broken(McapFault::Broken(text))))
    }

    fn other(&mut self, head: [u8; 9], length: u64) -> io::Result<Option<ResyncItem>> {
        let at_byte = self.at;
        let opcode = head[0];
        let is_read = matches!(opcode, op::HEADER | op::METADATA | op::DATA_END | op::MESSAGE_INDEX);
        let keep = is_read && length <= RECORD_BYTES_MAX as u64;
        let mut data = Vec::new();
        if keep {
            data.resize(length as usize, 0);
            self.input.read_exact(&mut data)?;
        } else {
            self.input.seek(SeekFrom::Start(at_byte + HEAD + length))?;
        }
        let fits = match opcode {
            op::MESSAGE_INDEX => is_message_index(&data),
            op::DATA_END => data.len() == 4,
            _ => true,
        };
        // A record that its own checksum vouches for has the right length, whatever follows it.
        let is_sealed = || opcode == op::METADATA && is_sealed_metadata(&data);
        let is_right = fits && (self.is_record_next()? || is_sealed());
        if !is_right {
            let text = "its length leads to no other".to_owned();
            return Ok(Some(self.broken(McapFault::Broken(text))));
        }
        self.at = at_byte + HEAD + length;
        if opcode == op::DATA_END {
            return Ok(self.data_end(at_byte, &data));
        }
        if self.sum.is_some() {
            self.add(&head);
            if keep {
                self.add(&data);
            } else {
                self.add_stretch(at_byte + HEAD, length)?;
            }
        }
        let kind = match opcode {
            op::HEADER => ItemKind::Header(data),
            op::METADATA => ItemKind::Metadata(data),
            op::MESSAGE => ItemKind::Fault(McapFault::NoCrc),
            op::ATTACHMENT => ItemKind::Attachment,
            _ => return Ok(None),
        };
        Ok(Some(ResyncItem { at_byte, kind }))
    }

    fn data_end(&mut self, at_byte: u64, data: &[u8]) -> Option<ResyncItem> {
        let got = self.sum.take()?.finalize();
        let expected = u32::from_le_bytes(data.try_into().ok()?);
        let kind = match expected {
            0 => return None,
            sum if sum == got => ItemKind::AllVerified,
            expected => ItemKind::Fault(McapFault::DataCrc { expected, got }),
        };
        Some(ResyncItem { at_byte, kind })
    }

    /// The record here is broken: the search begins behind its first byte.
    fn broken(&mut self, cause: McapFault) -> ResyncItem {
        let at_byte = self.at;
        self.at += 1;
        self.searching = true;
        self.sum = None;
        fault(at_byte, cause)
    }

    /// Whether the next bytes may be a record (even one that was cut), the magic or the end.
    fn is_record_next(&mut self) -> io::Result<bool> {
        let mut head = [0; HEAD as usize];
        let got = read_up_to(&mut self.input, &mut head)?;
        self.input.seek_relative(-(got as i64))?;
        let Some(&opcode) = head[..got].first() else {
            return Ok(true);
        };
        let fits = got < head.len() || length_of(&head) <= self.length.max(RECORD_BYTES_MAX as u64);
        Ok(is_opcode(opcode) && fits)
    }

    /// Place of the next chunk whose lengths agree.
    fn search(&mut self) -> io::Result<Option<u64>> {
        let mut block = vec![0; BLOCK];
        let mut from = self.at;
        loop {
            self.input.seek(SeekFrom::Start(from))?;
            let got = read_up_to(&mut self.input, &mut block)?;
            for (offset, _) in block[..got].iter().enumerate().filter(|(_, byte)| **byte == op::CHUNK) {
                let at = from + offset as u64;
                // A file that grows has more than that already.
                let fits = |&length: &u64| at + HEAD + length <= self.length;
                if let Some(length) = chunk_length(&block[offset..got]).filter(fits) {
                    // What a wrong guess costs: this stretch again, and the chunk.
                    let cost = BLOCK as u64 + length;
                    self.search_bytes_left = self.search_bytes_left.saturating_sub(cost);
                    return Ok(Some(at).filter(|_| self.search_bytes_left > 0));
                }
            }
            if got < block.len() {
                return Ok(None);
            }
            from += (got - CHUNK_HEAD) as u64;
        }
    }

    fn add(&mut self, bytes: &[u8]) {
        if let Some(sum) = &mut self.sum {
            sum.update(bytes);
        }
    }

    fn add_stretch(&mut self, start: u64, length: u64) -> io::Result<()> {
        self.input.seek(SeekFrom::Start(start))?;
        let mut left = length;
        let mut block = vec![0; BLOCK.min(length as usize)];
        while left > 0 {
            let part = left.min(block.len() as u64) as usize;
            self.input.read_exact(&mut block[..part])?;
            self.add(&block[..part]);
            left -= part as u64;
        }
        Ok(())
    }
}

fn fault(at_byte: u64, fault: McapFault) -> ResyncItem {
    ResyncItem {
        at_byte,
        kind: ItemKind::Fault(fault),
    }
}

/// Records of the format, and private ones.
pub(super) fn is_opcode(opcode: u8) -> bool {
    (op::HEADER..=op::DATA_END).contains(&opcode) || opcode >= 0x80
}

pub(super) fn length_of(head: &[u8; 9]) -> u64 {
    let mut length = [0; 8];
    length.copy_from_slice(&head[1..]);
    u64::from_le_bytes(length)
}

fn is_sealed_metadata(record: &[u8]) -> bool {
    let bounded = record.len() <= METADATA_BYTES_MAX;
    let parsed = bounded.then(|| records::metadata(record)).flatten();
    parsed.is_some_and(|(name, content)| is_sealed(name, &content))
}

/// A channel number and a list whose length fits.
fn is_message_index(record: &[u8]) -> bool {
    let list = record.get(2..6).and_then(|bytes| bytes.try_into().ok());
    list.is_some_and(|bytes| u32::from_le_bytes(bytes) as usize == record.len() - 6)
}

/// Length of the chunk record that starts here, if its own lengths agree: opcode, length, two times, uncompressed size,
/// checksum, name of the compression, size of the content.
fn chunk_length(bytes: &[u8]) -> Option<u64> {
    let number = |at: usize| Some(u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?));
    let length = number(1)?;
    let name_length = usize::from(*bytes.get(37)?);
    let name = bytes.get(41..41 + name_length)?;
    let size = number(41 + name_length)?;
    let known = bytes[38..41] == [0; 3] && [&b""[..], b"lz4", b"zstd"].contains(&name);
    let agree = length.checked_sub(40 + name_length as u64) == Some(size);
    let bounded = length <= RECORD_BYTES_MAX as u64 && number(25)? <= RECORD_BYTES_MAX as u64;
    (bytes[0] == op::CHUNK && known && agree && bounded).then_some(length)
}

/// Fills the buffer as far as the input goes.
fn read_up_to(input: &mut impl Read, buffer: &mut [u8]) -> io::Result<usize> {
    let mut got = 0;
    while got < buffer.len() {
        match input.read(&mut buffer[got..]) {
            Ok(0) => break,
            Ok(read) => got += read,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(got)
}
