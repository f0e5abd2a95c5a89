//! A file whose readers fail behind its end.
//!
//! The crate that decodes Parquet skips a list of the numbers that a header claims, 2³¹ at most, number by number, also where the file has ended:
//! each read then finds nothing, and that is no error to it. A file of 25 kB took 8 s so, a worse one takes an hour.

use std::io::{self, Read};

use parquet::errors::Result;
use parquet::file::reader::{ChunkReader, Length};

/// A file whose readers tell of the end once, and fail when they are read again.
pub(super) struct EndedOnce<R>(pub(super) R);

impl<R: Length> Length for EndedOnce<R> {
    fn len(&self) -> u64 {
        self.0.len()
    }
}

impl<R: ChunkReader> ChunkReader for EndedOnce<R> {
    type T = Reader<R::T>;

    fn get_read(&self, start: u64) -> Result<Self::T> {
        let inner = self.0.get_read(start)?;
        Ok(Reader {
            inner,
            has_ended: false,
        })
    }

    fn get_bytes(&self, start: u64, length: usize) -> Result<bytes::Bytes> {
        self.0.get_bytes(start, length)
    }
}

/// See [`EndedOnce`].
pub(super) struct Reader<R> {
    inner: R,
    has_ended: bool,
}

impl<R: Read> Read for Reader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        if read == 0 && !buffer.is_empty() && std::mem::replace(&mut self.has_ended, true) {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_is_told_once() {
        let file = EndedOnce(bytes::Bytes::from_static(b"abc"));
        assert_eq!(file.len(), 3);
        let mut reader = file.get_read(1).expect("two bytes");
        let mut rest = Vec::new();
        assert_eq!(reader.read_to_end(&mut rest).ok(), Some(2));
        assert_eq!(rest, b"bc");
        assert!(reader.read(&mut [0; 1]).is_err());
        assert_eq!(file.get_bytes(0, 2).ok().as_deref(), Some(&b"ab"[..]));
    }
}
