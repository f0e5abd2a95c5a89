//! Blocks of the file, by their addresses.

use std::collections::BTreeSet;
use std::io::{Read, Seek, SeekFrom};
use std::sync::Arc;

use crate::damage::{Damage, Place};

/// Most links of a block.
const LINKS_MAX: u64 = 1 << 16;
/// Most blocks of the structure.
const BLOCKS_MAX: usize = 1 << 20;
/// Bytes of a block before its links.
const HEAD: u64 = 24;

/// Access to the blocks.
#[derive(Debug)]
pub(super) struct Blocks<R> {
    input: R,
    length: u64,
    file: Arc<str>,
    visited: BTreeSet<u64>,
    bytes_read: u64,
}

/// A block without its data.
#[derive(Debug, Clone)]
pub(super) struct Block {
    pub(super) id: [u8; 4],
    pub(super) links: Vec<u64>,
    /// Where its data are.
    pub(super) data: u64,
    pub(super) data_length: u64,
}

impl Block {
    /// A link; `None` where there is none.
    pub(super) fn link(&self, n: usize) -> Option<u64> {
        self.links.get(n).copied().filter(|&at| at != 0)
    }
}

impl<R: Read + Seek> Blocks<R> {
    pub(super) fn new(mut input: R, file: Arc<str>) -> Result<Self, Damage> {
        let length = input.seek(SeekFrom::End(0)).map_err(|error| Damage {
            file: file.clone(),
            place: Place::Byte(0),
            expected: "a file that can be sought",
            found: error.to_string(),
        })?;
        Ok(Self {
            input,
            length,
            file,
            visited: BTreeSet::new(),
            bytes_read: 0,
        })
    }

    pub(super) fn damage(&self, at: u64, expected: &'static str, found: &str) -> Damage {
        Damage {
            file: self.file.clone(),
            place: Place::Byte(at),
            expected,
            found: found.to_owned(),
        }
    }

    pub(super) fn length(&self) -> u64 {
        self.length
    }

    pub(super) fn bytes_read(&self) -> u64 {
        self.bytes_read
    }

    /// `length` bytes from `at` on. The caller bounds the length.
    pub(super) fn read(&mut self, at: u64, length: usize) -> Result<Vec<u8>, Damage> {
        let end = at.checked_add(length as u64);
        if end.is_none_or(|end| end > self.length) {
            return Err(self.damage(at, "data inside the file", "an address beyond its end: it was cut"));
        }
        let mut bytes = vec![0; length];
        let read = self
            .input
            .seek(SeekFrom::Start(at))
            .and_then(|_| self.input.read_exact(&mut bytes));
        self.bytes_read += length as u64;
        match read {
            Ok(()) => Ok(bytes),
            Err(error) => Err(self.damage(at, "to read on", &error.to_string())),
        }
    }

    /// The block at an address, which no other link may lead to.
    pub(super) fn once(&mut self, at: u64) -> Result<Block, Damage> {
        if self.visited.len() >= BLOCKS_MAX || !self.visited.insert(at) {
            return Err(self.damage(at, "a block that no other link leads to", "a circle of links"));
        }
        self.block(at)
    }

    /// Whether no block that was visited lies behind an address.
    pub(super) fn is_behind_structure(&self, at: u64) -> bool {
        self.visited.last().is_none_or(|last| *last < at)
    }

    /// The block at an address.
    pub(super) fn block(&mut self, at: u64) -> Result<Block, Damage> {
        let head = self.read(at, HEAD as usize)?;
        let (length, links) = (u64_at(&head, 8), u64_at(&head, 16));
        if !head.starts_with(b"##") || links > LINKS_MAX || length < HEAD.saturating_add(links.saturating_mul(8)) {
            return Err(self.damage(at, "a block", "something else"));
        }
        let data = at + HEAD + 8 * links;
        let bytes = self.read(at + HEAD, 8 * links as usize)?;
        Ok(Block {
            id: [head[0], head[1], head[2], head[3]],
            links: bytes.chunks_exact(8).map(|link| u64_at(link, 0)).collect(),
            data,
            data_length: length - HEAD - 8 * links,
        })
    }

    /// The data of a block, zeros behind them up to `length`.
    pub(super) fn data(&mut self, block: &Block, length: usize) -> Result<Vec<u8>, Damage> {
        let there = block.data_length.min(length as u64) as usize;
        let mut data = self.read(block.data, there)?;
        data.resize(length, 0);
        Ok(data)
    }

    /// The text of a block that a link leads to, in its first bytes.
    pub(super) fn text(&mut self, at: Option<u64>) -> Result<String, Damage> {
        const TEXT_MAX: u64 = 256;
        let Some(at) = at else { return Ok(String::new()) };
        let block = self.block(at)?;
        let bytes = self.read(block.data, block.data_length.min(TEXT_MAX) as usize)?;
        let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
        Ok(String::from_utf8_lossy(&bytes[..end]).into_owned())
    }
}

pub(super) fn u64_at(bytes: &[u8], at: usize) -> u64 {
    let mut word = [0; 8];
    let there = &bytes[at.min(bytes.len())..bytes.len().min(at + 8)];
    word[..there.len()].copy_from_slice(there);
    u64::from_le_bytes(word)
}

pub(super) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u64_at(bytes, at) as u32
}
