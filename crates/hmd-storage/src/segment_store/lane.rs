//! The segments of one kind: at most one in progress.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use super::disk::{Disk, Out, rename, sync_folder};
use super::name::{Kind, Name, PROFILE, Stage};
use crate::mcap_writer::{Sink, SinkError};
use crate::retry_delay::RetryDelay;
use hmd_core::config::Limits;

/// Where a lane stands.
pub(super) struct Lane {
    pub(super) kind: Kind,
    open: Option<Open>,
    /// Of this kind, since the start, one more after each failure: a gap in it is a gap in the frames.
    segment: u64,
    pause: RetryDelay,
    retry_at: Option<Instant>,
    /// Frames or records that were not stored.
    pub(super) lost: u64,
}

struct Open {
    name: Name,
    sink: Sink<Box<dyn Out>>,
    since: Instant,
    /// Frames or records taken.
    taken: u64,
    /// Those of them that are not yet known to be on the disk.
    unsynced: u64,
    /// How often something was; each time adds a chunk, and an entry to the index that is held until the end.
    syncs: u32,
}

/// Most syncs of a segment, which bounds its index to some 0.3 MB.
const SYNCS_MAX: u32 = 512;

/// What a lane needs to begin a segment.
pub(super) struct Begin<'a> {
    pub(super) folder: &'a Path,
    pub(super) disk: &'a dyn Disk,
    pub(super) metadata: &'a BTreeMap<String, String>,
    pub(super) number: u64,
    pub(super) now: Instant,
}

impl Lane {
    pub(super) fn new(kind: Kind) -> Self {
        Self {
            kind,
            open: None,
            segment: 0,
            pause: RetryDelay::default(),
            retry_at: None,
            lost: 0,
        }
    }

    /// Name of the segment in progress.
    pub(super) fn name(&self) -> Option<Name> {
        self.open.as_ref().map(|open| open.name)
    }

    /// Bytes of the segment in progress.
    pub(super) fn bytes(&self) -> u64 {
        self.open.as_ref().map_or(0, |open| open.sink.bytes())
    }

    /// Whether the last attempt failed.
    pub(super) fn has_failed(&self) -> bool {
        self.retry_at.is_some()
    }

    /// Whether a segment may be begun now.
    pub(super) fn may_begin(&self, now: Instant) -> bool {
        self.open.is_none() && self.retry_at.is_none_or(|at| at <= now)
    }

    /// Whether the segment in progress is full or old.
    pub(super) fn is_due(&self, limits: &Limits, now: Instant) -> bool {
        self.open.as_ref().is_some_and(|open| {
            open.sink.bytes() >= limits.segment_bytes
                || open.syncs >= SYNCS_MAX
                || now.duration_since(open.since) >= limits.segment_age
        })
    }

    /// Begins a segment; its name is on the disk when this returns.
    pub(super) fn begin(&mut self, with: &Begin<'_>) -> Result<(), SinkError> {
        let name = Name {
            number: with.number,
            kind: self.kind,
            stage: Stage::Open,
        };
        let mut metadata = with.metadata.clone();
        metadata.insert("segment_kind".to_owned(), self.kind.to_string());
        metadata.insert("segment".to_owned(), self.segment.to_string());
        let path = with.folder.join(name.to_string());
        let out = with.disk.create(&path)?;
        let sink = match started(out, with.folder, &metadata) {
            Ok(sink) => sink,
            Err(error) => {
                // Nothing is in it.
                let _ = std::fs::remove_file(path);
                return Err(error);
            }
        };
        self.open = Some(Open {
            name,
            sink,
            since: with.now,
            taken: 0,
            unsynced: 0,
            syncs: 0,
        });
        self.segment += 1;
        self.retry_at = None;
        Ok(())
    }

    /// Hands one item to the segment in progress; without one it is lost.
    pub(super) fn put(
        &mut self,
        put: impl FnOnce(&mut Sink<Box<dyn Out>>) -> Result<(), SinkError>,
    ) -> Result<(), SinkError> {
        let Some(open) = &mut self.open else {
            self.lost += 1;
            return Ok(());
        };
        open.taken += 1;
        open.unsynced += 1;
        put(&mut open.sink)
    }

    /// Brings everything taken so far to the disk.
    pub(super) fn sync(&mut self) -> Result<(), SinkError> {
        if let Some(open) = self.open.as_mut().filter(|open| open.unsynced > 0) {
            open.sink.flush_window()?;
            open.unsynced = 0;
            open.syncs += 1;
            // Only what came to the disk shows that the disk is back.
            self.pause.reset();
        }
        Ok(())
    }

    /// Ends the segment in progress; its closed name and its size.
    pub(super) fn end(&mut self, folder: &Path) -> Result<Option<(Name, u64)>, SinkError> {
        self.sync()?;
        let Some(open) = self.open.take() else { return Ok(None) };
        let closed = open.name.at(Stage::Closed);
        // What is in it is on the disk already; without its end it is repaired by the next start.
        let ended = open.sink.finish().map(|_| ());
        if let Err(error) = ended.and_then(|()| Ok(rename(folder, open.name, closed)?)) {
            if is_gone(folder, open.name) {
                self.lost += open.taken;
            }
            return Err(error);
        }
        let bytes = std::fs::metadata(folder.join(closed.to_string()))
            .map_err(SinkError::Io)?
            .len();
        Ok(Some((closed, bytes)))
    }

    /// After a failure: gives the segment up and waits before the next. Whatever is not known to be on the disk is lost,
    /// though a repair may still find some of it; all that it held, where somebody has removed it. The segment's name and
    /// size, if anything in it is worth a repair; else it is removed, so that a disk that fails for days leaves no file for
    /// each attempt.
    pub(super) fn fail(&mut self, folder: &Path, now: Instant) -> Option<(Name, u64)> {
        self.segment += 1;
        self.retry_at = Some(now + self.pause.next_delay());
        let open = self.open.take()?;
        let (name, bytes, gone) = (open.name, open.sink.bytes(), is_gone(folder, open.name));
        self.lost += if gone { open.taken } else { open.unsynced };
        let kept = open.syncs > 0 && !gone;
        drop(open);
        if !kept {
            let _ = std::fs::remove_file(folder.join(name.to_string()));
        }
        kept.then_some((name, bytes))
    }
}

/// Whether there is no file of that name any more.
pub(super) fn is_gone(folder: &Path, name: Name) -> bool {
    matches!(folder.join(name.to_string()).try_exists(), Ok(false))
}

/// A segment with its header and metadata, all of it and its name on the disk.
fn started(
    out: Box<dyn Out>,
    folder: &Path,
    metadata: &BTreeMap<String, String>,
) -> Result<Sink<Box<dyn Out>>, SinkError> {
    let mut sink = Sink::with_profile(out, metadata, PROFILE)?;
    sink.flush_window()?;
    sync_folder(folder)?;
    Ok(sink)
}
