//! The records of a data group, one after the other, from blocks in whatever arrangement.

use std::io::{Read, Seek};

use miniz_oxide::inflate::decompress_to_vec_zlib_with_limit;

use super::block::{Block, Blocks, u32_at, u64_at};
use super::layout::{Data, Layout};
use crate::damage::Damage;

/// Most bytes of an inflated block; the standard allows 4 MiB.
pub(super) const INFLATED_MAX: usize = 1 << 23;
/// Bytes of an uncompressed block that are read at once.
const PIECE: u64 = 1 << 20;

/// Reads the records of one data group.
#[derive(Debug)]
pub(super) struct Records {
    /// Addresses of blocks to come, the next at the end.
    waiting: Vec<u64>,
    is_open: bool,
    /// Rest of the block that is being read: its address and end.
    piece: Option<(u64, u64)>,
    id_bytes: usize,
    /// Number and length of each format.
    formats: Vec<(u64, Option<usize>)>,
    bytes: Vec<u8>,
    used: usize,
    at: u64,
}

/// One record.
pub(super) struct Record<'a> {
    /// Index of its format.
    pub(super) format: usize,
    pub(super) bytes: &'a [u8],
    /// Address of its block.
    pub(super) at: u64,
}

impl Records {
    pub(super) fn new(data: Data, layout: &Layout) -> Self {
        Self {
            waiting: data.first.into_iter().collect(),
            is_open: data.is_open,
            piece: None,
            id_bytes: layout.id_bytes,
            formats: layout.formats.iter().map(|format| (format.id, format.length)).collect(),
            bytes: Vec::new(),
            used: 0,
            at: 0,
        }
    }

    /// Address of the block read last.
    pub(super) fn at(&self) -> u64 {
        self.at
    }

    /// The next record. What is left at the end is no record: a file may be cut anywhere.
    pub(super) fn next<R: Read + Seek>(&mut self, blocks: &mut Blocks<R>) -> Result<Option<Record<'_>>, Damage> {
        const VARIABLE_HEAD: usize = 4;
        const VARIABLE_MAX: usize = 1 << 20;
        if !self.fill(blocks, self.id_bytes.max(1))? {
            return self.end(blocks);
        }
        let id = u64_at(&self.bytes[self.used..self.used + self.id_bytes], 0);
        let known = match self.id_bytes {
            0 => Some(0),
            _ => self.formats.iter().position(|(known, _)| *known == id),
        };
        let Some(format) = known else {
            return Err(blocks.damage(self.at, "a record of a known format", &format!("number {id}")));
        };
        let (head, length) = match self.formats[format].1 {
            Some(length) => (self.id_bytes, length),
            None => {
                if !self.fill(blocks, self.id_bytes + VARIABLE_HEAD)? {
                    return self.end(blocks);
                }
                let length = u32_at(&self.bytes[self.used..], self.id_bytes) as usize;
                (self.id_bytes + VARIABLE_HEAD, length)
            }
        };
        if head + length == 0 || length > VARIABLE_MAX {
            return Err(blocks.damage(self.at, "a record of a possible length", &format!("{length} bytes")));
        }
        if !self.fill(blocks, head + length)? {
            return self.end(blocks);
        }
        let start = self.used + head;
        self.used = start + length;
        Ok(Some(Record {
            format,
            bytes: &self.bytes[start..start + length],
            at: self.at,
        }))
    }

    fn end<R: Read + Seek>(&mut self, blocks: &Blocks<R>) -> Result<Option<Record<'_>>, Damage> {
        let left = self.bytes.len() - self.used;
        self.bytes.clear();
        self.used = 0;
        // Only the last record of a file that is not finalised may be cut.
        if left > 0 && !self.is_open {
            return Err(blocks.damage(self.at, "whole records", &format!("{left} bytes of one")));
        }
        Ok(None)
    }

    /// Reads on until `length` bytes wait; false if there are no more.
    fn fill<R: Read + Seek>(&mut self, blocks: &mut Blocks<R>, length: usize) -> Result<bool, Damage> {
        while self.bytes.len() - self.used < length {
            self.bytes.drain(..self.used);
            self.used = 0;
            if let Some((at, end)) = self.piece.take() {
                // Of a file that was cut, what is there comes first.
                let there = blocks.length().saturating_sub(at);
                let size = PIECE.min(end - at).min(if there > 0 { there } else { PIECE });
                self.at = at;
                self.bytes.extend(blocks.read(at, size as usize)?);
                self.piece = Some((at + size, end)).filter(|(at, end)| at < end);
                continue;
            }
            let Some(at) = self.waiting.pop() else { return Ok(false) };
            let block = blocks.once(at)?;
            self.at = at;
            match &block.id {
                b"##DT" | b"##DV" => {
                    let is_last = self.is_open && self.waiting.is_empty();
                    let end = if is_last {
                        blocks.length()
                    } else {
                        block.data.saturating_add(block.data_length)
                    };
                    self.piece = Some((block.data, end)).filter(|(at, end)| at < end);
                }
                b"##DZ" => self.bytes.extend(inflated(blocks, at, &block)?),
                b"##HL" => self.waiting.extend(block.link(0)),
                b"##DL" => {
                    self.waiting.extend(block.link(0));
                    self.waiting
                        .extend(block.links.iter().skip(1).rev().filter(|at| **at != 0));
                }
                _ => return Err(blocks.damage(at, "a block of records", &format!("\"{}\"", block.id.escape_ascii()))),
            }
        }
        Ok(true)
    }
}

fn inflated<R: Read + Seek>(blocks: &mut Blocks<R>, at: u64, block: &Block) -> Result<Vec<u8>, Damage> {
    const HEAD: usize = 24;
    const TRANSPOSED: u8 = 1;
    let head = blocks.data(block, HEAD)?;
    let (kind, columns) = (head[2], u32_at(&head, 4) as usize);
    let (original, stored) = (u64_at(&head, 8), u64_at(&head, 16));
    if kind > TRANSPOSED || original > INFLATED_MAX as u64 || stored > INFLATED_MAX as u64 {
        return Err(blocks.damage(at, "a compressed block of at most 8 MiB", "another"));
    }
    let data = blocks.read(block.data + HEAD as u64, stored as usize)?;
    match decompress_to_vec_zlib_with_limit(&data, INFLATED_MAX) {
        Ok(bytes) if bytes.len() as u64 == original => Ok(if kind == TRANSPOSED {
            transposed_back(&bytes, columns)
        } else {
            bytes
        }),
        Ok(bytes) => Err(blocks.damage(at, "as many bytes as the block says", &bytes.len().to_string())),
        Err(error) => Err(blocks.damage(at, "a block with a right checksum", &error.to_string())),
    }
}

/// Bytes that were stored column by column, in rows again; an incomplete last row stands behind them as it is.
fn transposed_back(bytes: &[u8], columns: usize) -> Vec<u8> {
    let rows = bytes.len().checked_div(columns).unwrap_or(0);
    let mut out = bytes.to_vec();
    for column in 0..if rows == 0 { 0 } else { columns } {
        for row in 0..rows {
            out[row * columns + column] = bytes[column * rows + row];
        }
    }
    out
}
