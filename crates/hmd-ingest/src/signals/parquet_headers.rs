//! Parquet files whose pages are of a size that can be.
//!
//! The crate that decodes makes room for as many bytes as the header of a page says that it has when it is expanded: a file of 27 kB took 1.7 GB.
//! Before that it reads the header, and here its size is read first.

use std::io::Read;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use parquet::errors::{ParquetError, Result};
use parquet::file::reader::{ChunkReader, Length};

/// Largest expanded page, bytes. Writers make pages of 1 MiB, unless a single value is longer.
const PAGE_MAX: u32 = 64 << 20;

/// Bytes at the beginning of a header that hold its size: two fields of at most six bytes each.
const HEAD: u64 = 12;

/// Beginning of a field of 32 bits whose number is one more than that of the field before, in Thrift's compact protocol.
const NEXT_I32: u8 = 0x15;

/// A file that is read page by page as soon as its metadata are known.
pub(super) struct BoundedPages<R> {
    inner: R,
    /// Whether what is read are pages.
    are_pages: Arc<AtomicBool>,
}

impl<R> BoundedPages<R> {
    /// The file, and what is set once its metadata are read.
    pub(super) fn new(inner: R) -> (Self, Arc<AtomicBool>) {
        let are_pages = Arc::new(AtomicBool::new(false));
        let file = Self {
            inner,
            are_pages: are_pages.clone(),
        };
        (file, are_pages)
    }
}

impl<R: Length> Length for BoundedPages<R> {
    fn len(&self) -> u64 {
        self.inner.len()
    }
}

impl<R: ChunkReader> ChunkReader for BoundedPages<R> {
    type T = R::T;

    fn get_read(&self, start: u64) -> Result<Self::T> {
        if self.are_pages.load(Relaxed) {
            let mut head = Vec::new();
            self.inner.get_read(start)?.take(HEAD).read_to_end(&mut head)?;
            if !is_bounded(&head) {
                return Err(ParquetError::General("a page of an impossible size".to_owned()));
            }
        }
        self.inner.get_read(start)
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<bytes::Bytes> {
        self.inner.get_bytes(start, length)
    }
}

/// Whether the header of a page begins with its kind and an expanded size that can be, in the order in which all writers put them.
fn is_bounded(head: &[u8]) -> bool {
    let field = |bytes| -> Option<(u32, &[u8])> {
        let (&NEXT_I32, rest) = <[u8]>::split_first(bytes)? else {
            return None;
        };
        let length = rest.iter().position(|byte| *byte < 0x80)? + 1;
        let (number, rest) = rest.split_at(length);
        let bits = number.iter().rev().try_fold(0_u32, |bits, byte| {
            let shifted = bits.checked_mul(0x80)?;
            Some(shifted | u32::from(byte & 0x7F))
        })?;
        // Zigzag: a negative number is odd.
        (bits % 2 == 0).then_some((bits / 2, rest))
    };
    let size = field(head).and_then(|(_, rest)| field(rest));
    size.is_some_and(|(size, _)| size <= PAGE_MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_of_an_impossible_size_is_told_by_its_header() {
        // Kind 0, expanded to 4, 64 Mi and 64 Mi + 1 bytes.
        assert!(is_bounded(&[0x15, 0, 0x15, 8, 0x15]));
        assert!(is_bounded(&[0x15, 4, 0x15, 0x80, 0x80, 0x80, 0x40, 0x15]));
        assert!(!is_bounded(&[0x15, 4, 0x15, 0x82, 0x80, 0x80, 0x40, 0x15]));
        // Beyond 32 bits, negative, cut, or in another order.
        assert!(!is_bounded(&[0x15, 4, 0x15, 0xFE, 0xFF, 0xFF, 0xFF, 0x7F, 0x15]));
        assert!(!is_bounded(&[0x15, 4, 0x15, 1, 0x15]));
        assert!(!is_bounded(&[0x15, 4, 0x15, 0x82]));
        assert!(!is_bounded(&[0x25, 4, 0x15, 8, 0x15]));
        assert!(!is_bounded(&[]));
    }

    #[test]
    fn what_is_read_before_the_pages_is_not_looked_at() {
        let (file, are_pages) = BoundedPages::new(bytes::Bytes::from_static(b"PAR1 is no page"));
        assert_eq!(file.len(), 15);
        assert!(file.get_read(0).is_ok());
        are_pages.store(true, Relaxed);
        assert!(file.get_read(0).is_err());
        assert_eq!(file.get_bytes(0, 4).ok().as_deref(), Some(&b"PAR1"[..]));
    }
}
