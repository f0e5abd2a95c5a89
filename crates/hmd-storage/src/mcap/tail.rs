//! An MCAP file that may still be written, read as it grows.
//!
//! Only whole records are looked at: a chunk is written in one piece, but a reader may come in the middle of it. The file
//! is neither locked nor changed, and it is read on under whatever name it gets when it is closed.

use std::fs::File;
use std::io::{self, Read, Seek};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::time::SystemTime;

use thiserror::Error;

use super::limits::RECORD_BYTES_MAX;
use super::messages::{McapMessage, McapMessages};
use super::{McapLoss, resync_reader};
use crate::regular_file::open_regular;

/// Why a file cannot be followed.
#[derive(Debug, Error)]
pub enum TailError {
    /// The file cannot be opened or read.
    #[error("{file}: {source}")]
    Io {
        /// The file.
        file: String,
        /// Why.
        source: io::Error,
    },
    /// Another kind of file.
    #[error("{file}: expected an MCAP file, found one that begins differently")]
    Foreign {
        /// The file.
        file: String,
    },
}

/// A file that is followed. Iterate over what is there; after [`McapTail::grow`] there may be more.
#[derive(Debug)]
pub struct McapTail {
    name: String,
    /// For lengths and heads of records, read by their places; its position is that of the messages.
    file: File,
    /// As far as whole records go.
    whole: u64,
    /// Its last magic is there: the writer has finished it.
    is_complete: bool,
    messages: McapMessages<File>,
}

impl McapTail {
    /// Begins at the start of a file.
    ///
    /// # Errors
    /// [`TailError`].
    pub fn open(path: &Path) -> Result<Self, TailError> {
        let name = path.display().to_string();
        let io = |source| TailError::Io {
            file: name.clone(),
            source,
        };
        let file = open_regular(path).map_err(io)?;
        let mut start = Vec::new();
        let magic = mcap::MAGIC;
        (&file).take(magic.len() as u64).read_to_end(&mut start).map_err(io)?;
        if start.is_empty() || !magic.starts_with(&start) {
            return Err(TailError::Foreign { file: name });
        }
        let is_complete = ends_in_magic(&file).map_err(io)?;
        // The same file, whatever has its name by now.
        let mut input = file.try_clone().map_err(io)?;
        input.rewind().map_err(io)?;
        let messages = if is_complete {
            // With its summary, which replaces damaged definitions.
            McapMessages::new(input, &name).map_err(io)?
        } else {
            McapMessages::growing(input, &name, 0)
        };
        Ok(Self {
            name,
            file,
            whole: 0,
            is_complete,
            messages,
        })
    }

    /// Checks how far the file has grown. With `last`, its writer has ended: what is incomplete then is damage.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn grow(&mut self, last: bool) -> Result<(), TailError> {
        if self.is_complete {
            return Ok(());
        }
        let whole = self.reach(last).map_err(|source| self.error(source))?;
        self.messages.grow(whole, last || self.is_complete);
        Ok(())
    }

    /// Whether the file was ended by its writer.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.is_complete
    }

    /// How much of what is there was read, 0…1.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn share_read(&self) -> Result<f64, TailError> {
        let length = self.length().map_err(|source| self.error(source))?;
        Ok((self.messages.position() as f64 / length.max(1) as f64).min(1.0))
    }

    /// Place up to which records were read, bytes.
    #[must_use]
    pub fn position(&self) -> u64 {
        self.messages.position()
    }

    /// When something was last written.
    ///
    /// # Errors
    /// When the system does not say.
    pub fn written_at(&self) -> Result<SystemTime, TailError> {
        let modified = self.file.metadata().and_then(|about| about.modified());
        modified.map_err(|source| self.error(source))
    }

    fn length(&self) -> io::Result<u64> {
        Ok(self.file.metadata()?.len())
    }

    fn error(&self, source: io::Error) -> TailError {
        TailError::Io {
            file: self.name.clone(),
            source,
        }
    }

    /// How far may be read now.
    fn reach(&mut self, last: bool) -> io::Result<u64> {
        // Lengths are unreliable in a damaged file, but nothing is written behind the last magic: once that is there, the length is final.
        self.is_complete = ends_in_magic(&self.file)?;
        let length = self.length()?;
        self.whole = self.whole_records(length)?;
        Ok(if last || self.is_complete { length } else { self.whole })
    }

    /// End of the last whole record; the end of the file where its records are broken, for the reader to report.
    fn whole_records(&mut self, length: u64) -> io::Result<u64> {
        let magic = mcap::MAGIC.len() as u64;
        let mut at = self.whole;
        if at == 0 {
            if length < magic {
                return Ok(0);
            }
            at = magic;
        }
        // A file that became shorter has nothing new.
        while length.saturating_sub(at) >= resync_reader::HEAD {
            let mut head = [0; resync_reader::HEAD as usize];
            self.file.read_exact_at(&mut head, at)?;
            if !resync_reader::is_opcode(head[0]) || resync_reader::length_of(&head) > RECORD_BYTES_MAX as u64 {
                return Ok(length);
            }
            // Only the magic follows the footer.
            let is_footer = head[0] == mcap::records::op::FOOTER;
            let end = at + resync_reader::HEAD + resync_reader::length_of(&head) + if is_footer { magic } else { 0 };
            if end > length {
                break;
            }
            at = end;
        }
        Ok(at)
    }
}

impl Iterator for McapTail {
    type Item = Result<McapMessage, McapLoss>;

    fn next(&mut self) -> Option<Self::Item> {
        // Nothing is there yet; the reader would take that for the end.
        if self.whole == 0 && !self.is_complete {
            return None;
        }
        self.messages.next()
    }
}

/// Whether it does, and has something before that.
fn ends_in_magic(file: &File) -> io::Result<bool> {
    let mut end = [0; mcap::MAGIC.len()];
    let length = file.metadata()?.len();
    if length <= end.len() as u64 {
        return Ok(false);
    }
    let at = length - end.len() as u64;
    file.read_exact_at(&mut end, at)?;
    Ok(end == mcap::MAGIC)
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::Write;

    use super::*;
    use crate::mcap_writer::McapWriter;
    use hmd_core::record::{Log, LogLevel};

    /// A finished file of `lines` chunks.
    fn file(lines: u64) -> Vec<u8> {
        let mut writer = McapWriter::new(io::Cursor::new(Vec::new()), &Default::default()).unwrap();
        for n in 0..lines {
            writer
                .write(n, &Log::new(n, LogLevel::Info, "hmd", &format!("line {n}")))
                .unwrap();
            writer.flush_window().unwrap();
        }
        writer.finish().unwrap().0.into_inner()
    }

    fn times(tail: &mut McapTail, last: bool) -> Vec<u64> {
        tail.grow(last).unwrap();
        tail.map(|message| message.unwrap().log_time_ns).collect()
    }

    #[test]
    fn a_file_is_read_as_it_grows_whatever_the_pieces() {
        let whole = file(5);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        for piece in [1, 7, 100, 1000, whole.len()] {
            let mut out = File::create(&path).unwrap();
            let mut pieces = whole.chunks(piece);
            out.write_all(pieces.next().unwrap()).unwrap();
            let mut tail = McapTail::open(&path).unwrap();
            let mut found = times(&mut tail, false);
            for piece in pieces {
                assert!(!tail.is_complete());
                out.write_all(piece).unwrap();
                found.extend(times(&mut tail, false));
            }
            assert_eq!(found, [0, 1, 2, 3, 4], "pieces of {piece} bytes");
            assert!(tail.is_complete());
            assert!(times(&mut tail, true).is_empty(), "no complaint behind the footer");
        }
    }

    #[test]
    fn a_file_that_becomes_shorter_gives_no_more() {
        let whole = file(5);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        fs::write(&path, &whole[..whole.len() - 50]).unwrap();
        let mut tail = McapTail::open(&path).unwrap();
        assert_eq!(times(&mut tail, false), [0, 1, 2, 3, 4]);
        for length in [whole.len() as u64 / 2, 0] {
            File::options()
                .write(true)
                .open(&path)
                .unwrap()
                .set_len(length)
                .unwrap();
            assert!(times(&mut tail, false).is_empty());
            assert!(tail.share_read().unwrap() >= 1.0);
        }
    }

    #[test]
    fn a_torn_chunk_is_damage_only_when_the_writer_has_ended() {
        let whole = file(3);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        fs::write(&path, &whole[..whole.len() / 3]).unwrap();
        let mut tail = McapTail::open(&path).unwrap();
        let before = times(&mut tail, false);
        tail.grow(true).unwrap();
        let after: Vec<_> = tail.collect();
        assert!(after.iter().any(Result::is_err), "{before:?}, then {after:?}");
    }

    #[test]
    fn broken_records_are_reported_and_skipped() {
        let mut damaged = file(4);
        let at = damaged.len() / 4;
        damaged[at..at + 40].fill(0xff);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        fs::write(&path, &damaged).unwrap();
        let mut tail = McapTail::open(&path).unwrap();
        tail.grow(false).unwrap();
        let (found, lost): (Vec<_>, Vec<_>) = tail.by_ref().partition(Result::is_ok);
        assert!(!found.is_empty() && !lost.is_empty(), "{found:?} {lost:?}");
    }

    #[test]
    fn other_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        for content in ["", "(1700000000.0) can0 100#00\n"] {
            fs::write(&path, content).unwrap();
            let text = McapTail::open(&path).unwrap_err().to_string();
            assert!(
                text.ends_with("expected an MCAP file, found one that begins differently"),
                "{text}"
            );
        }
        assert!(
            McapTail::open(&folder.path().join("none"))
                .unwrap_err()
                .to_string()
                .contains("No such file")
        );
    }
}
