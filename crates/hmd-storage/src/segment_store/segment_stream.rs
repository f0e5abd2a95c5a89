//! The segments of one kind: at most one in progress.

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;
use std::time::{Duration, Instant};

use super::disk::{Disk, Out, rename};
use super::name::{Kind, Name, PROFILE, Stage, is_segment};
use crate::mcap_writer::{McapWriteError, McapWriter};
use crate::retry_delay::RetryDelay;
use hmd_core::config::Limits;

/// The segments of one kind, and the one in progress.
pub(super) struct SegmentStream {
    pub(super) kind: Kind,
    open: Option<Open>,
    /// Of this kind, since the start, one more after each failure: a gap in it is a gap in the frames.
    segment: u64,
    pause: RetryDelay,
    retry_at: Option<Instant>,
    /// Frames or records that were not stored.
    pub(super) lost: u64,
    /// Marks that are not known to be on the disk, in their order: at most [`MARKS_MAX`].
    marks: VecDeque<Mark>,
}

/// Writes a record that belongs to no frame, as often as a failing disk asks for it.
pub(super) type Mark = Box<dyn Fn(&mut McapWriter<Box<dyn Out>>) -> Result<(), McapWriteError> + Send>;

struct Open {
    name: Name,
    writer: McapWriter<Box<dyn Out>>,
    since: Instant,
    /// Frames or records taken.
    taken: u64,
    /// Those of them that are not yet known to be on the disk.
    unsynced: u64,
    has_marks: bool,
    /// Number of syncs with unsynced data; each adds a chunk, and an entry to the index that is held until the end.
    syncs: u32,
}

/// Longest pause before a segment is begun again after a failure.
const RETRIED_WITHIN: Duration = Duration::from_secs(1);

/// Most marks that wait for a disk; the oldest goes, and is counted as lost. The newest says how far a run came.
pub(super) const MARKS_MAX: usize = 1024;

/// Most syncs of a segment, which bounds its index to some 0.3 MB.
const SYNCS_MAX: u32 = 512;

/// What a stream needs to begin a segment.
pub(super) struct SegmentStart<'a> {
    pub(super) folder: &'a Path,
    pub(super) disk: &'a dyn Disk,
    pub(super) metadata: &'a BTreeMap<String, String>,
    pub(super) number: u64,
    pub(super) now: Instant,
}

impl SegmentStream {
    pub(super) fn new(kind: Kind) -> Self {
        Self {
            kind,
            open: None,
            segment: 0,
            pause: RetryDelay::up_to(RETRIED_WITHIN),
            retry_at: None,
            lost: 0,
            marks: VecDeque::new(),
        }
    }

    /// Whether a segment was ever begun, or tried.
    pub(super) fn has_begun(&self) -> bool {
        self.segment > 0
    }

    /// Whether marks wait for a segment.
    pub(super) fn has_waiting_marks(&self) -> bool {
        self.open.is_none() && !self.marks.is_empty()
    }

    /// The pause after a failure is over.
    pub(super) fn end_pause(&mut self) {
        self.retry_at = None;
    }

    /// Name of the segment in progress.
    pub(super) fn name(&self) -> Option<Name> {
        self.open.as_ref().map(|open| open.name)
    }

    /// Bytes of the segment in progress.
    pub(super) fn bytes(&self) -> u64 {
        self.open.as_ref().map_or(0, |open| open.writer.bytes())
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
            open.writer.bytes() >= limits.segment_bytes
                || open.syncs >= SYNCS_MAX
                || now.duration_since(open.since) >= limits.segment_age
        })
    }

    /// Begins a segment; its name is on the disk when this returns.
    pub(super) fn begin(&mut self, with: &SegmentStart<'_>) -> Result<(), McapWriteError> {
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
        let writer = match started(out, with, &metadata) {
            Ok(writer) => writer,
            Err(error) => {
                // Nothing is in it.
                let _ = with.disk.remove(&path);
                return Err(error);
            }
        };
        let open = self.open.insert(Open {
            name,
            writer,
            since: with.now,
            taken: 0,
            unsynced: 0,
            has_marks: !self.marks.is_empty(),
            syncs: 0,
        });
        self.segment += 1;
        self.retry_at = None;
        self.marks.iter().try_for_each(|mark| mark(&mut open.writer))
    }

    /// Hands a mark to the segment in progress; until it is known to be on the disk, each further segment gets it.
    pub(super) fn mark(&mut self, mark: Mark) -> Result<(), McapWriteError> {
        let put = self.open.as_mut().map_or(Ok(()), |open| {
            open.has_marks = true;
            mark(&mut open.writer)
        });
        if self.marks.len() == MARKS_MAX {
            self.marks.pop_front();
            self.lost += 1;
        }
        self.marks.push_back(mark);
        put
    }

    /// The frames that come belong to nothing that was marked.
    pub(super) fn forget_marks(&mut self) {
        self.marks.clear();
    }

    /// Hands one item to the segment in progress; without one it is lost.
    pub(super) fn write(
        &mut self,
        write: impl FnOnce(&mut McapWriter<Box<dyn Out>>) -> Result<(), McapWriteError>,
    ) -> Result<(), McapWriteError> {
        let Some(open) = &mut self.open else {
            self.lost += 1;
            return Ok(());
        };
        open.taken += 1;
        open.unsynced += 1;
        write(&mut open.writer)
    }

    /// Brings everything taken so far to the disk.
    pub(super) fn sync(&mut self) -> Result<(), McapWriteError> {
        let has_marks = !self.marks.is_empty();
        if let Some(open) = self.open.as_mut().filter(|open| open.unsynced > 0 || has_marks) {
            open.writer.flush_window()?;
            open.unsynced = 0;
            open.syncs += 1;
            self.marks.clear();
            // Only what came to the disk shows that the disk is back.
            self.pause.reset();
        }
        Ok(())
    }

    /// Ends the segment in progress; its closed name and its size.
    pub(super) fn close(&mut self, folder: &Path, disk: &dyn Disk) -> Result<Option<(Name, u64)>, McapWriteError> {
        self.sync()?;
        let Some(open) = self.open.take() else { return Ok(None) };
        if self.kind == Kind::Raw && open.taken == 0 && !open.has_marks {
            // Begun to find out whether the disk is back; a replay would find nothing in it.
            disk.remove(&folder.join(open.name.to_string()))?;
            return Ok(None);
        }
        let closed = open.name.with_stage(Stage::Closed);
        // What is in it is on the disk already; without its end it is repaired by the next start.
        let ended = open.writer.finish().map(|_| ());
        if let Err(error) = ended.and_then(|()| Ok(rename(disk, folder, open.name, closed)?)) {
            if now_named(folder, open.name).is_none() {
                self.lost += open.taken;
            }
            return Err(error);
        }
        let bytes = std::fs::metadata(folder.join(closed.to_string()))
            .map_err(McapWriteError::Io)?
            .len();
        Ok(Some((closed, bytes)))
    }

    /// After a failure: gives the segment up and waits before the next. Whatever is not known to be on the disk is lost,
    /// though a repair may still find some of it; all that it held, when its file was removed. The segment's name and
    /// size, if anything in it is worth a repair; else it is removed, so that a disk that fails for days leaves no file for
    /// each attempt. In a folder that is not `held`, a file of that name is another's, and stays.
    pub(super) fn fail(&mut self, folder: &Path, held: bool, disk: &dyn Disk, now: Instant) -> Option<(Name, u64)> {
        self.segment += 1;
        self.retry_at = Some(now + self.pause.next_delay());
        let open = self.open.take()?;
        let (name, bytes, gone) = (open.name, open.writer.bytes(), is_removed(folder, open.name));
        self.lost += if gone { open.taken } else { open.unsynced };
        let kept = open.syncs > 0 && !gone;
        drop(open);
        if !kept && held {
            let _ = disk.remove(&folder.join(name.to_string()));
        }
        kept.then_some((name, bytes))
    }
}

/// The name of a segment that could not be closed: the new one may be there, and not safe yet. `None` when it was removed.
pub(super) fn now_named(folder: &Path, open: Name) -> Option<Name> {
    let closed = open.with_stage(Stage::Closed);
    let is_closed = || is_segment(&folder.join(closed.to_string())).unwrap_or(false);
    match is_removed(folder, open) {
        false => Some(open),
        true => is_closed().then_some(closed),
    }
}

/// Whether there is no file of that name any more.
fn is_removed(folder: &Path, name: Name) -> bool {
    matches!(folder.join(name.to_string()).try_exists(), Ok(false))
}

/// A segment with its header and metadata, all of it and its name on the disk.
fn started(
    out: Box<dyn Out>,
    with: &SegmentStart<'_>,
    metadata: &BTreeMap<String, String>,
) -> Result<McapWriter<Box<dyn Out>>, McapWriteError> {
    let mut writer = McapWriter::with_profile(out, metadata, PROFILE)?;
    writer.flush_window()?;
    with.disk.sync_folder(with.folder)?;
    Ok(writer)
}
