//! Binary logs of Vector's tools, `.blf`.
//!
//! A head with the start of the measurement, then objects. Those of type 10 are containers: compressed blocks whose contents, one
//! after the other, are objects again, which may begin in one container and end in the next. Of the objects frames and error frames
//! are used. Layouts: Vector_BLF of Lorenz, python-can.
//!
//! Memory is bounded: a container holds at most 16 MiB, an object 64 KiB. A container without a right
//! checksum is not used; where an object should begin and does not, the next is searched for.
//!
//! The start is taken as UTC, as python-can writes it. Stamps are rounded to whole microseconds.

mod object;

use std::io::{self, BufRead, Read};
use std::sync::Arc;

use hmd_core::frame::{BusNames, RawFrame};
use jiff::civil::DateTime;
use jiff::tz::Offset;
use miniz_oxide::inflate::decompress_to_vec_zlib_with_limit;

use crate::damage::{Damage, Place};
use object::Object;

/// First bytes of such a file.
pub const MAGIC: &[u8] = b"LOGG";

/// Most bytes of a container, as stored and as it contains. Writers make some of 128 KiB.
const CONTAINER_MAX: usize = 1 << 24;
/// Most bytes of an object.
const OBJECT_MAX: usize = 1 << 16;
/// Most padding between two objects.
const PADDING_MAX: usize = 8;

const SIGNATURE: &[u8] = b"LOBJ";
const BASE_HEADER: usize = 16;
const CONTAINER: u32 = 10;
const CONTAINER_HEADER: usize = 16;

/// Reads frames from a log, container by container.
#[derive(Debug)]
pub struct BlfReader<R> {
    input: R,
    /// Bytes read.
    at: u64,
    file: Arc<str>,
    names: BusNames,
    start_ns: u64,
    /// Contents of the containers that are not used yet: from `used` on.
    contents: Vec<u8>,
    used: usize,
    ended: bool,
}

impl<R: BufRead> BlfReader<R> {
    /// A reader of `input`; `file` names it in errors, `names` is the table of interfaces to go on with.
    pub fn new(input: R, file: &str, names: BusNames) -> Self {
        Self {
            input,
            at: 0,
            file: file.into(),
            names,
            start_ns: 0,
            contents: Vec::new(),
            used: 0,
            ended: false,
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

    fn damage(&self, expected: &'static str, found: impl ToString) -> Damage {
        Damage {
            file: self.file.clone(),
            place: Place::Byte(self.at),
            expected,
            found: found.to_string(),
        }
    }

    /// Up to `length` bytes; memory grows with what there is.
    fn take(&mut self, length: usize) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let read = self.input.by_ref().take(length as u64).read_to_end(&mut bytes)?;
        self.at += read as u64;
        Ok(bytes)
    }

    fn read_head(&mut self) -> Result<(), Damage> {
        const FIXED: usize = 56;
        const HEAD_MAX: usize = 4096;
        let head = self.take(FIXED).map_err(|error| self.damage("to read on", error))?;
        let size = le_u32(&head, 4).unwrap_or(0) as usize;
        if head.len() < FIXED || !head.starts_with(MAGIC) || !(FIXED..=HEAD_MAX).contains(&size) {
            return Err(self.damage("the head of a BLF file", "something else"));
        }
        self.start_ns = start_ns(&head[40..]).unwrap_or(0);
        self.take(size - FIXED)
            .map_err(|error| self.damage("to read on", error))?;
        Ok(())
    }

    /// The next object of the contents; `None` when the next container is needed.
    fn next_object(&mut self) -> Option<Result<RawFrame, Damage>> {
        loop {
            let rest = &self.contents[self.used..];
            let near = &rest[..rest.len().min(PADDING_MAX + SIGNATURE.len())];
            let Some(skipped) = find(near, SIGNATURE) else {
                if rest.len() <= PADDING_MAX {
                    return None;
                }
                // What may be the beginning of a signature stays.
                let skipped = find(rest, SIGNATURE).unwrap_or(rest.len() - (SIGNATURE.len() - 1));
                self.used += skipped;
                return Some(Err(
                    self.damage("an object in a container", format_args!("{skipped} other bytes"))
                ));
            };
            self.used += skipped;
            let rest = &rest[skipped..];
            if rest.len() < BASE_HEADER {
                return None;
            }
            let size = le_u32(rest, 8).unwrap_or(0) as usize;
            if !(BASE_HEADER..=OBJECT_MAX).contains(&size) {
                self.used += SIGNATURE.len();
                return Some(Err(
                    self.damage("an object of a possible size", format_args!("{size} bytes"))
                ));
            }
            let object = rest.get(..size)?;
            // Its length has no checksum: another object must follow, as far as that can be seen.
            let behind = &rest[size..];
            let behind = &behind[..behind.len().min(PADDING_MAX + SIGNATURE.len())];
            if behind.len() > PADDING_MAX && find(behind, SIGNATURE).is_none() {
                self.used += SIGNATURE.len();
                return Some(Err(
                    self.damage("an object that another follows", "none behind its length")
                ));
            }
            let parsed = Object::parse(object, self.start_ns, &mut self.names);
            self.used += size;
            match parsed {
                Ok(Some(frame)) => return Some(Ok(frame)),
                Ok(None) => {}
                Err(found) => {
                    let place = Place::Frame(self.at);
                    return Some(Err(self.damage("a frame that can be", found).at(place)));
                }
            }
        }
    }

    /// Reads the next object of the file into the contents; false at the end.
    fn next_block(&mut self) -> Result<bool, Damage> {
        let header = self.next_header()?;
        if header.is_empty() {
            let left = self.contents.len() - self.used;
            self.contents.clear();
            self.used = 0;
            self.ended = true;
            return if left > PADDING_MAX {
                Err(self.damage("the rest of an object", "the end of the file: it was cut"))
            } else {
                Ok(false)
            };
        }
        let size = le_u32(&header, 8).unwrap_or(0) as usize;
        let kind = le_u32(&header, 12).unwrap_or(0);
        let most = if kind == CONTAINER { CONTAINER_MAX } else { OBJECT_MAX };
        if header.len() < BASE_HEADER || size < BASE_HEADER || size > most {
            return Err(self.damage("an object of a possible size", format_args!("{size} bytes")));
        }
        let body = self
            .take(size - BASE_HEADER)
            .map_err(|error| self.damage("to read on", error))?;
        if body.len() < size - BASE_HEADER {
            return Err(self.damage("the rest of an object", "the end of the file: it was cut"));
        }
        self.contents.drain(..self.used);
        self.used = 0;
        if kind != CONTAINER {
            self.contents.extend_from_slice(&header);
            self.contents.extend_from_slice(&body);
            return Ok(true);
        }
        match inflated(&body) {
            Ok(contents) => {
                self.contents.extend_from_slice(&contents);
                Ok(true)
            }
            Err(found) => {
                // What began before it does not go on behind it.
                self.contents.clear();
                Err(self.damage("a container with a right checksum", found))
            }
        }
    }

    /// The next 16 bytes from a signature on; nothing at the end.
    fn next_header(&mut self) -> Result<Vec<u8>, Damage> {
        let mut skipped = 0_u64;
        let mut matched = 0;
        while matched < SIGNATURE.len() {
            let block = match self.input.fill_buf() {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(self.failed(&error)),
                Ok(block) => block,
            };
            let Some(&byte) = block.first() else {
                return if skipped > PADDING_MAX as u64 {
                    Err(self.damage("an object", format_args!("{skipped} other bytes")))
                } else {
                    Ok(Vec::new())
                };
            };
            // A first byte occurs once in the signature, so that a failed match begins anew with this byte or the next.
            if byte == SIGNATURE[matched] {
                matched += 1;
            } else {
                skipped += matched as u64;
                matched = usize::from(byte == SIGNATURE[0]);
                skipped += u64::from(matched == 0);
            }
            self.input.consume(1);
            self.at += 1;
        }
        let rest = self
            .take(BASE_HEADER - SIGNATURE.len())
            .map_err(|error| self.damage("to read on", error))?;
        Ok([SIGNATURE, &rest].concat())
    }

    fn failed(&mut self, error: &io::Error) -> Damage {
        self.ended = true;
        self.damage("to read on", error)
    }
}

impl<R: BufRead> Iterator for BlfReader<R> {
    type Item = Result<RawFrame, Damage>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.at == 0
            && !self.ended
            && let Err(damage) = self.read_head()
        {
            self.ended = true;
            return Some(Err(damage));
        }
        loop {
            if let Some(item) = self.next_object() {
                return Some(item);
            }
            if self.ended {
                return None;
            }
            match self.next_block() {
                Ok(true) => {}
                Ok(false) => return None,
                Err(damage) => return Some(Err(damage)),
            }
        }
    }
}

fn inflated(body: &[u8]) -> Result<Vec<u8>, String> {
    let (method, data) = match (body.get(..2), body.get(CONTAINER_HEADER..)) {
        (Some(&[low, high]), Some(data)) => (u16::from_le_bytes([low, high]), data),
        _ => return Err("one without its header".to_owned()),
    };
    match method {
        0 => Ok(data.to_vec()),
        2 => decompress_to_vec_zlib_with_limit(data, CONTAINER_MAX).map_err(|error| error.to_string()),
        other => Err(format!("compression {other}")),
    }
}

/// A `SYSTEMTIME` of Windows as ns since 1970; `None` where there is none.
fn start_ns(bytes: &[u8]) -> Option<u64> {
    let word = |n: usize| i16::from_le_bytes([bytes[2 * n], bytes[2 * n + 1]]);
    let small = |n: usize| i8::try_from(word(n)).ok();
    let civil = DateTime::new(
        word(0),
        small(1)?,
        small(3)?,
        small(4)?,
        small(5)?,
        small(6)?,
        i32::from(word(7)).checked_mul(1_000_000)?,
    );
    u64::try_from(Offset::UTC.to_timestamp(civil.ok()?).ok()?.as_nanosecond()).ok()
}

fn find(bytes: &[u8], what: &[u8]) -> Option<usize> {
    bytes.windows(what.len()).position(|window| window == what)
}

fn le_u32(bytes: &[u8], at: usize) -> Option<u32> {
    let bytes = bytes.get(at..at + 4)?;
    Some(u32::from_le_bytes(bytes.try_into().ok()?))
}

#[cfg(test)]
mod tests;
