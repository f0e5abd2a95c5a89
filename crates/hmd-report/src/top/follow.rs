//! Where the records come from: the segments that a daemon writes, or one file.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use hmd_storage::mcap::{McapTail, TailError};
use hmd_storage::segment_store::{Segment, current_path, records_segments};

use super::state::State;

/// Segments that are read at the start, the newest: the others are too old to say anything of the present.
const SEGMENTS_AT_START: usize = 4;

/// Bytes read before the keys are polled.
const BYTES_AT_ONCE: u64 = 8 << 20;

/// Why there is nothing to follow.
#[derive(Debug, thiserror::Error)]
pub enum FollowError {
    /// A file that cannot be read or is none of ours.
    #[error(transparent)]
    Tail(#[from] TailError),
    /// A folder that cannot be listed.
    #[error("{folder}: {source}")]
    Folder {
        /// The folder.
        folder: String,
        /// Why.
        source: io::Error,
    },
    /// A folder that no daemon wrote to.
    #[error("{folder}: expected a folder that hmd run writes to, found no segment with records in it")]
    Empty {
        /// The folder.
        folder: String,
    },
    /// A file without anything of an actuator.
    #[error("{file}: expected records of windows or of a live run, found none")]
    NoRecords {
        /// The file.
        file: String,
    },
}

/// How far the reading has come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress {
    /// There is more to read at once; the share of the file that was read, 0…1.
    Reading(f64),
    /// All that was there was read, and more may come.
    Waiting,
    /// Of a folder: all was read, and its last segment was closed in order.
    Closed,
    /// Of a file: its writer has ended it, and all was read.
    Finished,
}

/// What is followed. Nothing is locked or changed.
#[derive(Debug)]
pub struct Follow {
    place: PathBuf,
    is_folder: bool,
    tail: McapTail,
    /// Of the segment that is read; 0 for a file.
    number: u64,
    /// No newer segment was there when it was last looked.
    is_newest: bool,
    is_closed: bool,
}

impl Follow {
    /// Begins with a folder's newest segments, or at the start of a file.
    ///
    /// # Errors
    /// [`FollowError`].
    pub fn open(place: &Path) -> Result<Self, FollowError> {
        if !place.is_dir() {
            return Ok(Self {
                place: place.to_owned(),
                is_folder: false,
                tail: McapTail::open(place)?,
                number: 0,
                is_newest: true,
                is_closed: false,
            });
        }
        let segments = list(place, 0)?;
        let newest = segments.iter().rev().take(SEGMENTS_AT_START);
        // One that is deleted in this moment gives way to the next.
        let mut oldest_first: Vec<_> = newest.collect();
        oldest_first.reverse();
        for (number, segment) in oldest_first {
            if let Some(tail) = open(segment)? {
                return Ok(Self {
                    place: place.to_owned(),
                    is_folder: true,
                    tail,
                    number: *number,
                    is_newest: false,
                    is_closed: !segment.is_open,
                });
            }
        }
        Err(FollowError::Empty {
            folder: place.display().to_string(),
        })
    }

    /// Reads on for a while, and puts what comes into `state`. How far it came.
    ///
    /// # Errors
    /// When the folder or a file cannot be read any more, or a finished file has nothing of an actuator.
    pub fn read(&mut self, state: &mut State) -> Result<Progress, FollowError> {
        if self.is_folder {
            self.find_newer_segments()?;
        }
        self.tail.grow(!self.is_newest)?;
        let until = self.tail.position().saturating_add(BYTES_AT_ONCE);
        while let Some(item) = self.tail.next() {
            match item {
                Ok(message) => state.add_message(&message),
                Err(_) => state.damaged += 1,
            }
            if self.tail.position() >= until {
                return Ok(Progress::Reading(self.tail.share_read()?));
            }
        }
        if !self.is_newest && self.next_segment()? {
            return Ok(Progress::Reading(0.0));
        }
        if self.tail.is_complete() && !self.is_folder {
            if state.names().is_empty() {
                let file = self.place.display().to_string();
                return Err(FollowError::NoRecords { file });
            }
            return Ok(Progress::Finished);
        }
        Ok(if self.is_closed {
            Progress::Closed
        } else {
            Progress::Waiting
        })
    }

    /// When something was last written.
    ///
    /// # Errors
    /// When the system does not say.
    pub fn written_at(&self) -> Result<SystemTime, FollowError> {
        Ok(self.tail.written_at()?)
    }

    /// Whether the segment that is read was closed, and whether there is a newer one.
    fn find_newer_segments(&mut self) -> Result<(), FollowError> {
        let segments = list(&self.place, self.number)?;
        self.is_newest = segments
            .last_key_value()
            .is_none_or(|(number, _)| *number <= self.number);
        self.is_closed = segments.get(&self.number).is_none_or(|segment| !segment.is_open);
        Ok(())
    }

    /// Whether there was one that could be opened.
    fn next_segment(&mut self) -> Result<bool, FollowError> {
        let segments = list(&self.place, self.number)?;
        for (number, segment) in segments.range(self.number + 1..) {
            if let Some(tail) = open(segment)? {
                (self.tail, self.number) = (tail, *number);
                return Ok(true);
            }
        }
        Ok(false)
    }
}

fn list(folder: &Path, first: u64) -> Result<BTreeMap<u64, Segment>, FollowError> {
    records_segments(folder, first).map_err(|source| FollowError::Folder {
        folder: folder.display().to_string(),
        source,
    })
}

/// `None` for one that has gone, or whose header is not written yet.
fn open(segment: &Segment) -> Result<Option<McapTail>, FollowError> {
    let path = &current_path(&segment.path);
    match McapTail::open(path) {
        Ok(tail) => Ok(Some(tail)),
        Err(TailError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(TailError::Foreign { .. }) if fs::metadata(path).is_ok_and(|about| about.len() == 0) => Ok(None),
        Err(error) => Err(error.into()),
    }
}
