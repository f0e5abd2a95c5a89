//! [`Channel`]: what one block of the structure says of a value in records.
#![cfg_attr(
    not(feature = "signals"),
    allow(dead_code, reason = "frames need less of a channel than measured signals")
)]

use std::collections::BTreeMap;
use std::io::{Read, Seek};

use super::block::{Block, Blocks, u32_at, u64_at};
use crate::damage::Damage;

/// A value in a record.
#[derive(Debug, Clone, Copy)]
pub(super) struct Field {
    pub(super) byte: usize,
    pub(super) bit: u32,
    pub(super) bits: u32,
    pub(super) data_type: u8,
    /// Physical value = `offset + factor · raw`.
    pub(super) linear: (f64, f64),
}

/// One channel.
#[derive(Debug)]
pub(super) struct Channel {
    pub(super) name: String,
    /// Address of the text of its unit.
    pub(super) unit: Option<u64>,
    kind: u8,
    is_of_time: bool,
    pub(super) field: Field,
    /// Whether `linear` of the field says all of its conversion.
    pub(super) is_linear: bool,
    /// Address of the conversion that has names of its numbers.
    pub(super) names: Option<u64>,
    /// Bit behind the values of a record that tells that the value is none; all of them are none.
    pub(super) invalid_bit: Option<u32>,
    pub(super) all_invalid: bool,
}

impl Channel {
    /// Whether it is the time of its records.
    pub(super) fn is_time(&self) -> bool {
        const MASTER: u8 = 2;
        self.kind == MASTER && self.is_of_time
    }

    /// Whether its values have no length of their own.
    pub(super) fn is_variable(&self) -> bool {
        const VARIABLE_LENGTH: u8 = 1;
        self.kind == VARIABLE_LENGTH
    }

    /// Whether its values are numbers in the records.
    pub(super) fn is_number(&self) -> bool {
        const FIXED_LENGTH: u8 = 0;
        const MASTER: u8 = 2;
        let of_float = matches!(self.field.data_type, 4 | 5) && matches!(self.field.bits, 32 | 64);
        let of_whole = self.field.data_type <= 3 && (1..=64).contains(&self.field.bits);
        matches!(self.kind, FIXED_LENGTH | MASTER) && (of_float || of_whole)
    }
}

/// The channels of a group, `first` and those after it.
pub(super) fn channels<R: Read + Seek>(blocks: &mut Blocks<R>, first: Option<u64>) -> Result<Vec<Channel>, Damage> {
    let mut found = Vec::new();
    let mut waiting: Vec<u64> = first.into_iter().collect();
    while let Some(at) = waiting.pop() {
        let block = blocks.once(at)?;
        waiting.extend(block.link(0));
        // Of a structure, its parts; lists of other blocks (arrays) are left out.
        if let Some(parts) = block.link(1)
            && blocks.block(parts)?.id == *b"##CN"
        {
            waiting.push(parts);
        }
        found.push(channel(blocks, &block)?);
    }
    Ok(found)
}

fn channel<R: Read + Seek>(blocks: &mut Blocks<R>, block: &Block) -> Result<Channel, Damage> {
    const TIME: u8 = 1;
    const ALL_INVALID: u32 = 1;
    const HAS_INVALID_BIT: u32 = 1 << 1;
    let data = blocks.data(block, 20)?;
    let (linear, has_names) = read_linear(blocks, block.link(4))?;
    let flags = u32_at(&data, 12);
    Ok(Channel {
        name: blocks.text(block.link(2))?,
        unit: block.link(6),
        kind: data[0],
        is_of_time: data[1] == TIME,
        field: Field {
            byte: u32_at(&data, 4) as usize,
            bit: u32::from(data[3]),
            bits: u32_at(&data, 8),
            data_type: data[2],
            linear: linear.unwrap_or((0.0, 1.0)),
        },
        is_linear: linear.is_some(),
        names: block.link(4).filter(|_| has_names),
        invalid_bit: (flags & HAS_INVALID_BIT != 0).then(|| u32_at(&data, 16)),
        all_invalid: flags & ALL_INVALID != 0,
    })
}

/// Names of numbers, where the number stays.
const VALUE_TO_TEXT: u8 = 7;

/// Offset and factor of a conversion, none of one that is not linear; and whether it has names of numbers.
fn read_linear<R: Read + Seek>(blocks: &mut Blocks<R>, at: Option<u64>) -> Result<(Option<(f64, f64)>, bool), Damage> {
    const NONE: u8 = 0;
    const LINEAR: u8 = 1;
    let same = Some((0.0, 1.0));
    let Some(at) = at else { return Ok((same, false)) };
    let block = blocks.block(at)?;
    let data = blocks.data(&block, 40)?;
    let linear = match data[0] {
        NONE | VALUE_TO_TEXT => same,
        LINEAR => Some((f64::from_bits(u64_at(&data, 24)), f64::from_bits(u64_at(&data, 32)))),
        _ => None,
    };
    Ok((linear, data[0] == VALUE_TO_TEXT))
}

/// The names of a conversion from numbers to texts, by the bits of their numbers.
pub(super) fn names<R: Read + Seek>(blocks: &mut Blocks<R>, at: u64) -> Result<BTreeMap<u64, String>, Damage> {
    /// More numbers than any mode has.
    const NAMES_MAX: usize = 256;
    /// Links before those to the names, and bytes before the numbers.
    const OTHER_LINKS: usize = 4;
    const OTHER_BYTES: usize = 24;
    let block = blocks.block(at)?;
    let head = blocks.data(&block, OTHER_BYTES)?;
    let count = (u64_at(&head, 6) as u16 as usize).min(NAMES_MAX);
    let data = blocks.data(&block, OTHER_BYTES + 8 * count)?;
    let mut names = BTreeMap::new();
    for n in 0..count {
        let Some(text) = block.link(OTHER_LINKS + n) else {
            continue;
        };
        if blocks.block(text)?.id == *b"##TX" {
            names.insert(
                bits(f64::from_bits(u64_at(&data, OTHER_BYTES + 8 * n))),
                blocks.text(Some(text))?,
            );
        }
    }
    Ok(names)
}

/// Bits of a number, the same of both zeros.
pub(super) fn bits(number: f64) -> u64 {
    (number + 0.0).to_bits()
}

impl Field {
    /// Whether it lies within a record of this length.
    pub(super) fn fits(&self, length: usize) -> bool {
        let bits = u64::from(self.bit) + u64::from(self.bits);
        self.bit < 8 && self.bits > 0 && self.byte as u64 + bits.div_ceil(8) <= length as u64
    }

    /// Unsigned bits, at most 64.
    pub(super) fn raw(&self, record: &[u8]) -> u64 {
        let bytes = (self.bit + self.bits).div_ceil(8).min(16) as usize;
        let bytes = &record[self.byte..self.byte + bytes];
        let is_big_endian = self.data_type & 1 == 1;
        let value = if is_big_endian {
            bytes.iter().fold(0_u128, |value, &byte| value << 8 | u128::from(byte))
        } else {
            bytes
                .iter()
                .rev()
                .fold(0_u128, |value, &byte| value << 8 | u128::from(byte))
        };
        (value >> self.bit) as u64 & (u64::MAX >> (64 - self.bits.min(64)))
    }

    /// Its physical value.
    pub(super) fn number(&self, record: &[u8]) -> f64 {
        let raw = self.raw(record);
        let value = match (self.data_type, self.bits) {
            (4 | 5, 64) => f64::from_bits(raw),
            (4 | 5, 32) => f64::from(f32::from_bits(raw as u32)),
            (2 | 3, bits) if bits <= 64 => (raw << (64 - bits)).cast_signed() as f64 / f64::powi(2.0, 64 - bits as i32),
            _ => raw as f64,
        };
        self.linear.0 + self.linear.1 * value
    }
}
