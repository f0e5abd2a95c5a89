//! A folder of segments: storage that survives kill -9, power cuts, full and failing disks.
//!
//! Raw frames and records go to segments of their own, so that old frames can go while the records stay. A segment is
//! written under a name with `.part`, in whole chunks, each synced: everything at once with a health record, and
//! within a second ([`SegmentStore::tick`]). Full or old, it gets its summary and its closed name. A start repairs what a cut
//! left behind ([`repair`](self)). `docs/storage.md` is the page for operators.
//!
//! A write that fails costs the segment, never the process: what it had not synced is counted as lost, and the next
//! segment is tried after a pause of at most a second.

mod background;
mod disk;
mod list;
mod name;
mod repair;
mod segment_stream;

pub use disk::{Disk, Out, RealDisk};
pub use list::{Segment, current_path, raw_segment_number, raw_segments, records_segments};

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io;
use std::os::fd::AsRawFd;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use crate::clock::now_ns;
use crate::held_lock::HeldLock;
use crate::is_full;
use crate::mcap_writer::McapWriteError;
use crate::output_file::create_folder;
use background::BackgroundRepair;
use hmd_core::config::Limits;
use hmd_core::counted::counted;
use hmd_core::frame::{BusNames, RawFrame};
use hmd_core::record::{LogLevel, Record, StorageState, StoreStatus};
use name::{Kind, Name, Stage};
use segment_stream::{SegmentStart, SegmentStream, now_named};

/// Whether a file name is one that a store gives.
#[must_use]
pub fn is_segment_name(name: &str) -> bool {
    Name::parse(name).is_some()
}

/// Why a store cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum SegmentStoreError {
    /// The folder cannot be made, opened or listed.
    #[error("{folder}: expected a folder for segments, found: {cause}")]
    Folder {
        /// The folder.
        folder: String,
        /// Error of the operating system.
        cause: io::Error,
    },
    /// No segment can be begun in it.
    #[error("{folder}: expected a folder that segments can be written to, found: {cause}")]
    Unwritable {
        /// The folder.
        folder: String,
        /// Why.
        cause: McapWriteError,
    },
    /// Another process writes to it.
    #[error("{folder}: expected a folder that nobody writes to, found one in use by another process")]
    InUse {
        /// The folder.
        folder: String,
    },
}

/// Final state of a store.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SegmentStoreEnd {
    /// State at the end.
    pub status: StoreStatus,
    /// Notices for an operator.
    pub messages: Vec<(LogLevel, String)>,
}

/// Frames of a time, which follow none before.
struct Capture {
    /// From 0.
    number: u64,
    why: String,
    is_ended: bool,
}

/// The folder. Call [`SegmentStore::finish`]; a store that is only dropped leaves its segments to the next start.
pub struct SegmentStore {
    folder: PathBuf,
    limits: Limits,
    metadata: BTreeMap<String, String>,
    /// The newest capture, where not all frames are stored.
    capture: Option<Capture>,
    disk: Arc<dyn Disk>,
    /// The folder, locked; none as long as it cannot be had.
    lock: Option<HeldLock>,
    /// The folder's name was a link when it was first locked.
    is_link: bool,
    repair: Option<BackgroundRepair>,
    now: Instant,
    next_number: u64,
    raw: SegmentStream,
    records: SegmentStream,
    /// All segments but those in progress, oldest first.
    closed: BTreeMap<(Kind, u64), (Stage, u64)>,
    free_bytes: u64,
    deleted: u64,
    raw_paused: bool,
    /// A segment could not be deleted when room was made last.
    undeletable: bool,
    /// Failures reported already: each is reported once until everything is stored again; at most [`MESSAGES_MAX`].
    reported: Vec<String>,
    messages: Vec<(LogLevel, String)>,
}

impl SegmentStore {
    /// Opens a folder, made if need be, repairs what an earlier run left cut, and begins.
    ///
    /// `metadata` goes into each segment. A disk that fails from here on is reported by [`SegmentStore::tick`].
    ///
    /// # Errors
    /// [`SegmentStoreError`] when there is no such folder for us.
    pub fn open(
        folder: &Path,
        metadata: &BTreeMap<String, String>,
        limits: Limits,
        disk: Box<dyn Disk>,
        now: Instant,
    ) -> Result<Self, SegmentStoreError> {
        let name = || folder.display().to_string();
        let error = |cause| SegmentStoreError::Folder { folder: name(), cause };
        let mut store = Self::without_folder(folder, metadata, limits, disk, now);
        let taken = hold(folder).and_then(|lock| match lock {
            Some(lock) => store.take_folder(lock).map(|()| true),
            None => Ok(false),
        });
        match taken {
            Ok(true) => {}
            Ok(false) => return Err(SegmentStoreError::InUse { folder: name() }),
            // Taken with the first segment.
            Err(cause) if is_full(&cause) => {}
            Err(cause) => return Err(error(cause)),
        }
        store.make_room();
        // Who waits for the start may rely on the output from here on.
        match store.try_begin(Kind::Records) {
            Ok(()) => Ok(store),
            // Room may come; what is not stored until then is counted.
            Err(cause) if cause.io().is_some_and(is_full) => {
                store.check(Kind::Records, Err(cause));
                Ok(store)
            }
            Err(cause) => Err(SegmentStoreError::Unwritable { folder: name(), cause }),
        }
    }

    /// The same for a process that used the folder before, and goes on whatever became of it: without a folder for us, everything is
    /// counted as lost, and [`SegmentStore::tick`] tries again.
    #[must_use]
    pub fn reopen(
        folder: &Path,
        metadata: &BTreeMap<String, String>,
        limits: Limits,
        disk: Box<dyn Disk>,
        now: Instant,
    ) -> Self {
        let mut store = Self::without_folder(folder, metadata, limits, disk, now);
        store.begin(Kind::Records);
        store.make_room();
        store
    }

    fn without_folder(
        folder: &Path,
        metadata: &BTreeMap<String, String>,
        limits: Limits,
        disk: Box<dyn Disk>,
        now: Instant,
    ) -> Self {
        Self {
            folder: folder.to_owned(),
            limits,
            metadata: metadata.clone(),
            capture: None,
            disk: Arc::from(disk),
            lock: None,
            is_link: false,
            repair: None,
            now,
            next_number: 0,
            raw: SegmentStream::new(Kind::Raw),
            records: SegmentStream::new(Kind::Records),
            closed: BTreeMap::new(),
            free_bytes: 0,
            deleted: 0,
            raw_paused: false,
            undeletable: false,
            reported: Vec::new(),
            messages: Vec::new(),
        }
    }

    /// Makes the locked folder ours: repairs what is in it.
    fn take_folder(&mut self, lock: HeldLock) -> io::Result<()> {
        let found = repair::repair_folder(&self.folder, &*self.disk)?;
        if self.lock.is_none() {
            self.is_link = is_link(&self.folder);
            // Which segments belong together: no two runs have both numbers in common.
            let run = format!("{}-{}", found.next_number, now_ns());
            self.metadata.insert("run".to_owned(), run);
        }
        self.lock = Some(lock);
        self.closed.clear();
        self.add_found(found);
        Ok(())
    }

    /// Takes one frame as received.
    pub fn write_frame(&mut self, frame: &RawFrame, names: &BusNames) {
        if self.raw_paused {
            self.raw.lost += 1;
            return;
        }
        if self.raw.is_due(&self.limits, self.now) {
            self.close_segment(Kind::Raw);
        }
        self.begin(Kind::Raw);
        let put = self.raw.write(|writer| writer.write_frame(frame, names));
        self.check(Kind::Raw, put);
    }

    /// The next frame does not follow the last one, and begins a capture; its segments tell why it was made.
    pub fn begin_capture(&mut self, why: &str) {
        self.end_capture();
        let number = self.capture.as_ref().map_or(0, |capture| capture.number + 1);
        self.capture = Some(Capture {
            number,
            why: why.to_owned(),
            is_ended: false,
        });
    }

    /// Closes the segment of a capture.
    pub fn end_capture(&mut self) {
        self.close_segment(Kind::Raw);
        self.raw.forget_marks();
        if let Some(capture) = &mut self.capture {
            capture.is_ended = true;
        }
    }

    /// Writes one record; it is on the disk after the next [`SegmentStore::sync_window`] or [`SegmentStore::tick`].
    pub fn write<R: Record>(&mut self, log_time_ns: u64, record: &R) {
        self.begin(Kind::Records);
        let put = self.records.write(|writer| writer.write(log_time_ns, record));
        self.check(Kind::Records, put);
    }

    /// Writes a record that a replay of the raw frames needs as well.
    pub fn write_to_both<R: Record + Clone + Send + 'static>(&mut self, log_time_ns: u64, record: &R) {
        self.write(log_time_ns, record);
        self.write_to_raw(log_time_ns, record);
    }

    /// Writes a record that a replay of the raw frames alone needs: into their segment, or one that is begun for it. It waits where the disk
    /// fails or has no room, and is of no use without frames, or between two captures.
    pub fn write_to_raw<R: Record + Clone + Send + 'static>(&mut self, log_time_ns: u64, record: &R) {
        if self.raw.name().is_some() || self.is_amid_frames() {
            if !self.raw_paused {
                self.begin(Kind::Raw);
            }
            let record = record.clone();
            let put = self
                .raw
                .mark(Box::new(move |writer| writer.write(log_time_ns, &record)));
            self.check(Kind::Raw, put);
        }
    }

    /// Whether the next frame goes on with those before.
    fn is_amid_frames(&self) -> bool {
        self.raw.has_begun() && self.capture.as_ref().is_none_or(|capture| !capture.is_ended)
    }

    /// Brings all frames to the disk, then all records, so that no record is there without its frames. Whether the records are there.
    pub fn sync_window(&mut self) -> bool {
        let synced = self.raw.sync();
        self.check(Kind::Raw, synced);
        let synced = self.records.sync();
        self.check(Kind::Records, synced);
        !self.records.has_failed()
    }

    /// To be called every second: syncs, closes what is full or old, makes room, tries again what failed.
    /// Returns the notices for an operator.
    pub fn tick(&mut self, now: Instant) -> Vec<(LogLevel, String)> {
        self.now = now;
        let limits = self.limits;
        self.take_repaired();
        self.leave_moved_folder();
        for kind in [Kind::Records, Kind::Raw] {
            let synced = self.stream(kind).sync();
            self.check(kind, synced);
            if self.stream(kind).is_due(&limits, now) {
                self.close_segment(kind);
            }
        }
        self.make_room();
        self.begin(Kind::Records);
        // Without frames nothing else would find out that the disk is back.
        if self.raw.has_failed() && !self.raw_paused {
            self.begin(Kind::Raw);
        }
        if !self.reported.is_empty() && !self.undeletable && !self.records.has_failed() && !self.raw.has_failed() {
            self.reported.clear();
            let text = format!(
                "storage: written again; not stored since the start: {}, {}",
                counted(self.raw.lost, "frame", "frames"),
                counted(self.records.lost, "record", "records")
            );
            self.messages.push((LogLevel::Info, text));
        }
        self.take_messages()
    }

    /// Notices for an operator, since the last call.
    pub fn take_messages(&mut self) -> Vec<(LogLevel, String)> {
        std::mem::take(&mut self.messages)
    }

    /// Ends all segments. What could not be ended is repaired by the next start.
    pub fn finish(mut self) -> SegmentStoreEnd {
        if let Some(repair) = &mut self.repair {
            repair.stop();
        }
        self.take_repaired();
        if self.raw.has_waiting_marks() {
            self.raw.end_pause();
            self.begin(Kind::Raw);
        }
        self.close_segment(Kind::Raw);
        self.close_segment(Kind::Records);
        SegmentStoreEnd {
            status: self.status(),
            messages: self.take_messages(),
        }
    }

    /// Where the segments are.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// State of the store.
    #[must_use]
    pub fn status(&self) -> StoreStatus {
        let open = [&self.raw, &self.records];
        StoreStatus {
            lost_frames: self.raw.lost,
            lost_records: self.records.lost,
            used_bytes: self.used_bytes(),
            free_bytes: self.free_bytes,
            segments: (self.closed.len() + open.iter().filter(|stream| stream.name().is_some()).count()) as u64,
            deleted: self.deleted,
            // As long as frames are paused, no attempt can show that their disk is back.
            state: if self.records.has_failed() || self.raw.has_failed() && !self.raw_paused {
                StorageState::Failing
            } else if self.raw_paused {
                StorageState::RawPaused
            } else {
                StorageState::Ok
            },
        }
    }

    fn stream(&mut self, kind: Kind) -> &mut SegmentStream {
        match kind {
            Kind::Raw => &mut self.raw,
            Kind::Records => &mut self.records,
        }
    }

    fn used_bytes(&self) -> u64 {
        let closed: u64 = self.closed.values().map(|(_, bytes)| bytes).sum();
        closed + self.raw.bytes() + self.records.bytes()
    }

    fn add_closed(&mut self, name: Name, bytes: u64) {
        self.closed.insert((name.kind, name.number), (name.stage, bytes));
    }

    /// Begins a segment if there is none and it is time.
    fn begin(&mut self, kind: Kind) {
        let begun = self.try_begin(kind);
        self.check(kind, begun);
    }

    fn try_begin(&mut self, kind: Kind) -> Result<(), McapWriteError> {
        let now = self.now;
        if !self.stream(kind).may_begin(now) {
            return Ok(());
        }
        self.hold_folder()?;
        let number = self.next_number;
        self.next_number += 1;
        let mut metadata = self.metadata.clone();
        if let (Kind::Raw, Some(Capture { number, why, .. })) = (kind, &self.capture) {
            // Their frames are no continuation of those of another capture.
            metadata
                .entry("run".to_owned())
                .and_modify(|run| run.push_str(&format!("-{number}")));
            metadata.insert("capture".to_owned(), why.clone());
        }
        let with = SegmentStart {
            folder: &self.folder,
            disk: &*self.disk,
            metadata: &metadata,
            number,
            now,
        };
        let stream = match kind {
            Kind::Raw => &mut self.raw,
            Kind::Records => &mut self.records,
        };
        stream.begin(&with)?;
        if let (Kind::Raw, Some(name), Some(Capture { why, .. })) = (kind, self.raw.name(), &self.capture) {
            let closed = name.with_stage(Stage::Closed);
            self.messages
                .push((LogLevel::Info, format!("storage: frames kept in {closed}: {why}")));
        }
        Ok(())
    }

    /// Whether the folder is the one that is held, under its name.
    fn is_held(&self) -> bool {
        let held = self.lock.as_ref().map(|lock| lock.file().metadata());
        let held = matches!((fs::metadata(&self.folder), held), (Ok(found), Some(Ok(held))) if is_same(&found, &held));
        held && (self.is_link || !is_link(&self.folder))
    }

    /// Where the segments in progress are: in the folder, or where it was moved to.
    fn place(&self) -> PathBuf {
        let moved = self.lock.as_ref().filter(|_| !self.is_held());
        moved.map_or_else(|| self.folder.clone(), |lock| path_of(lock.file()))
    }

    /// Takes the folder if it is not held yet, and continues in a new one when it was moved, removed or replaced.
    fn hold_folder(&mut self) -> io::Result<()> {
        if self.is_held() {
            return Ok(());
        }
        self.leave_moved_folder();
        let is_new = self.lock.is_none();
        if !is_new && !self.is_link && is_link(&self.folder) {
            return Err(became_link());
        }
        let became = match (
            self.lock.as_ref().and_then(|lock| moved_to(lock.file())),
            self.folder.exists(),
        ) {
            (Some(place), true) => {
                let place = place.display();
                format!(
                    "was replaced by another folder, to which segments go on; what was written before is in {place}"
                )
            }
            (None, true) => "was replaced by another folder, to which segments go on".to_owned(),
            (Some(place), false) => format!("was moved to {}; it is created again", place.display()),
            (None, false) => "was removed; it is created again".to_owned(),
        };
        // Its thread works in the folder as it was.
        self.repair = None;
        let lock = hold(&self.folder)?.ok_or(io::ErrorKind::ResourceBusy)?;
        self.take_folder(lock)?;
        if !is_new {
            let text = format!("storage: {} {became}", self.folder.display());
            self.messages.push((LogLevel::Error, text));
        }
        Ok(())
    }

    fn add_found(&mut self, found: repair::Found) {
        self.next_number = self.next_number.max(found.next_number);
        self.messages.extend(found.messages);
        for (name, bytes) in found.segments {
            self.add_closed(name, bytes);
        }
        if !found.pending.is_empty() {
            let begun = BackgroundRepair::begin(self.folder.clone(), found.pending, self.disk.clone());
            self.repair = Some(begun);
        }
    }

    /// Takes over what was repaired in the background.
    fn take_repaired(&mut self) {
        let repaired = self.repair.as_ref().map(BackgroundRepair::take).unwrap_or_default();
        for (name, found) in repaired {
            let key = (name.kind, name.number);
            // One that had its copy is counted by that.
            if self.closed.get(&key).is_some_and(|(stage, _)| *stage == name.stage) {
                self.closed.remove(&key);
            }
            self.add_found(found);
        }
    }

    /// Ends the segments of a folder that is no longer at its place, though they could be written: they are whole where it was moved to.
    fn leave_moved_folder(&mut self) {
        if self.lock.is_none() || self.is_held() {
            return;
        }
        for kind in [Kind::Records, Kind::Raw] {
            self.close_segment(kind);
        }
        // Those are not in the folder that comes.
        self.closed.clear();
    }

    fn close_segment(&mut self, kind: Kind) {
        let (folder, disk) = (self.place(), self.disk.clone());
        let before = self.stream(kind).name().map(|name| (name, self.stream(kind).bytes()));
        match self.stream(kind).close(&folder, &*disk) {
            Ok(Some((name, bytes))) => self.add_closed(name, bytes),
            Ok(None) => {}
            Err(error) => {
                if let (Some((name, bytes)), None) = (before, self.stream(kind).name())
                    && let Some(name) = now_named(&folder, name)
                {
                    self.add_closed(name, bytes);
                }
                self.check(kind, Err(error));
            }
        }
    }

    /// After a failed step the stream gives its segment up.
    fn check(&mut self, kind: Kind, step: Result<(), McapWriteError>) {
        let Err(error) = step else { return };
        let (now, folder, disk) = (self.now, self.place(), self.disk.clone());
        // What is at the place of one that was never had is not ours.
        let held = self.lock.is_some();
        if let Some((name, bytes)) = self.stream(kind).fail(&folder, held, &*disk, now) {
            self.add_closed(name, bytes);
        }
        self.report_once(format!(
            "storage: {kind}: {error}; tried again every second, and what is not stored is counted"
        ));
    }

    fn report_once(&mut self, text: String) {
        if self.reported.len() < MESSAGES_MAX && !self.reported.contains(&text) {
            self.reported.push(text.clone());
            self.messages.push((LogLevel::Error, text));
        }
    }

    /// Deletes the oldest segments until budget and free space are kept: raw frames first, records last, and those only
    /// for the budget: the history is not given up for what others write.
    fn make_room(&mut self) {
        if !self.is_held() {
            // Files of these names in another folder are not ours.
            return;
        }
        let mut free = self.disk.free_bytes(&self.folder).ok();
        let too_little = |free: Option<u64>, least: u64| free.is_some_and(|free| free < least);
        let mut stays = BTreeSet::new();
        loop {
            let over = self.used_bytes() > self.limits.budget_bytes;
            if !over && !too_little(free, self.limits.free_bytes_min) {
                break;
            }
            let has_raw = |key: &(Kind, u64)| key.0 == Kind::Raw && !stays.contains(key);
            if !self.closed.keys().any(has_raw) && self.raw.name().is_some() {
                self.close_segment(Kind::Raw);
            }
            // Raw sorts before records, and small numbers before large ones.
            let mut left = self.closed.iter().filter(|(key, _)| !stays.contains(*key));
            let oldest = left.next().map(|(key, (stage, _))| (*key, *stage));
            let Some((key, stage)) = oldest.filter(|(key, _)| over || key.0 == Kind::Raw) else {
                break;
            };
            if !self.delete(key, stage) {
                stays.insert(key);
            }
            free = self.disk.free_bytes(&self.folder).ok();
        }
        self.undeletable = !stays.is_empty();
        let used = self.used_bytes();
        let short = used > self.limits.budget_bytes || too_little(free, self.limits.free_bytes_min);
        let room = used + self.limits.segment_bytes <= self.limits.budget_bytes
            && !too_little(free, self.limits.free_bytes_min + self.limits.segment_bytes);
        if short != self.raw_paused && (short || room) {
            self.raw_paused = short;
            let (level, text) = if short {
                (LogLevel::Error, "no room: raw frames are not stored, and counted")
            } else {
                (LogLevel::Info, "room again: raw frames are stored")
            };
            self.messages.push((level, format!("storage: {text}")));
        }
        self.free_bytes = free.unwrap_or(0);
    }

    fn delete(&mut self, key: (Kind, u64), stage: Stage) -> bool {
        let (kind, number) = key;
        let name = Name { number, kind, stage };
        match self.disk.remove(&self.folder.join(name.to_string())) {
            Ok(()) => self.deleted += 1,
            // It is gone already.
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => {}
            Err(cause) => {
                self.report_once(format!("storage: {name} cannot be deleted: {cause}"));
                return false;
            }
        }
        self.closed.remove(&key);
        true
    }
}

/// Whether the name itself, without a slash behind it, is a link.
fn is_link(folder: &Path) -> bool {
    let bare: PathBuf = folder.components().collect();
    fs::symlink_metadata(bare).is_ok_and(|about| about.is_symlink())
}

/// A path to a folder that is open, wherever it is.
fn path_of(folder: &File) -> PathBuf {
    PathBuf::from(format!("/proc/self/fd/{}", folder.as_raw_fd()))
}

/// The name under which a folder that is open is found now; `None` of one that was removed.
fn moved_to(folder: &File) -> Option<PathBuf> {
    let place = fs::read_link(path_of(folder)).ok()?;
    let (found, open) = (fs::metadata(&place).ok()?, folder.metadata().ok()?);
    is_same(&found, &open).then_some(place)
}

fn is_same(one: &fs::Metadata, other: &fs::Metadata) -> bool {
    (one.dev(), one.ino()) == (other.dev(), other.ino())
}

fn became_link() -> io::Error {
    io::Error::new(
        io::ErrorKind::NotADirectory,
        "the folder has become a link, which is not followed",
    )
}

/// The folder, made if need be and locked; `None` if another process has it.
fn hold(folder: &Path) -> io::Result<Option<HeldLock>> {
    create_folder(folder)?;
    HeldLock::take(File::open(folder)?)
}

/// Most different failures that are reported before everything is stored again.
const MESSAGES_MAX: usize = 64;

#[cfg(test)]
mod tests;
