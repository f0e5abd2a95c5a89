mod failing_disk;
mod repair;
mod room;
mod starts;
mod stream;

use super::*;
use crate::mcap::{McapFrames, McapMessages};
use hmd_core::frame::FrameFlags;
use hmd_core::record::{Dropped, Health, Log, RawBatch};
use std::io::{Seek, SeekFrom, Write};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// A disk that can be made to fail; what it holds is real.
#[derive(Clone, Default)]
struct BadDisk {
    /// What the next writes and syncs say; all is well without it.
    error: Arc<Mutex<Option<io::ErrorKind>>>,
    /// Free bytes reported; plenty when 0.
    free: Arc<AtomicU64>,
    /// No file can be removed.
    keeps: Arc<AtomicBool>,
    /// No name can be brought to the disk.
    loses_names: Arc<AtomicBool>,
    /// Files are made all the same, as on a disk that has room for names alone.
    creates: Arc<AtomicBool>,
}

impl BadDisk {
    fn set(&self, error: Option<io::ErrorKind>) {
        *self.error.lock().unwrap() = error;
    }

    fn check(&self) -> io::Result<()> {
        self.error.lock().unwrap().map_or(Ok(()), |kind| Err(kind.into()))
    }
}

struct BadFile(BadDisk, Box<dyn Out>);

impl Write for BadFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.check()?;
        self.1.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.check()?;
        self.1.flush()
    }
}

impl Seek for BadFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.1.seek(to)
    }
}

impl Disk for BadDisk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn Out>> {
        if !self.creates.load(Relaxed) {
            self.check()?;
        }
        Ok(Box::new(BadFile(self.clone(), RealDisk.create(path)?)))
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        if self.keeps.load(Relaxed) {
            return Err(io::ErrorKind::PermissionDenied.into());
        }
        RealDisk.remove(path)
    }

    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        if self.loses_names.load(Relaxed) {
            return Err(io::ErrorKind::Other.into());
        }
        RealDisk.sync_folder(folder)
    }

    fn free_bytes(&self, _: &Path) -> io::Result<u64> {
        let free = self.free.load(Relaxed);
        Ok(if free == 0 { u64::MAX } else { free })
    }
}

/// A store, with a clock that the test turns.
struct Bench {
    folder: tempfile::TempDir,
    disk: BadDisk,
    names: BusNames,
    now: Instant,
    frames: u64,
    reported: Vec<String>,
}

const LIMITS: Limits = Limits {
    segment_bytes: 20_000,
    segment_age: Duration::from_secs(60),
    budget_bytes: 200_000,
    free_bytes_min: 1_000_000,
};

impl Bench {
    fn new() -> Self {
        let mut names = BusNames::new();
        names.intern("can0").unwrap();
        Self {
            folder: tempfile::tempdir().unwrap(),
            disk: BadDisk::default(),
            names,
            now: Instant::now(),
            frames: 0,
            reported: Vec::new(),
        }
    }

    fn open(&self) -> SegmentStore {
        let disk = Box::new(self.disk.clone());
        SegmentStore::open(self.folder.path(), &BTreeMap::new(), LIMITS, disk, self.now).unwrap()
    }

    fn put_frames(&mut self, store: &mut SegmentStore, count: u64) {
        for _ in 0..count {
            let data = hmd_core::seed::mix(3, &[self.frames]).to_le_bytes();
            let frame = RawFrame::new(self.frames * 1000, 0, 0x100, FrameFlags::NONE, &data).unwrap();
            store.write_frame(&frame, &self.names);
            self.frames += 1;
        }
    }

    fn put_health(store: &mut SegmentStore, window: u64) -> bool {
        let health = Health {
            actuator: "ema0".to_owned(),
            window,
            ..Health::default()
        };
        store.write(window, &health);
        store.sync_window()
    }

    fn tick(&mut self, store: &mut SegmentStore, seconds: u64) {
        self.now += Duration::from_secs(seconds);
        let messages = store.tick(self.now);
        self.reported.extend(messages.into_iter().map(|(_, text)| text));
    }

    fn names(&self) -> Vec<String> {
        Self::names_in(self.folder.path())
    }

    fn names_in(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    /// Decisions on windows in each segment of raw frames.
    fn marks(&self) -> Vec<usize> {
        let raw = self.names().into_iter().filter(|name| name.ends_with("-raw.mcap"));
        let marks = raw.map(|name| {
            let file = File::open(self.folder.path().join(&name)).unwrap();
            let messages = McapMessages::new(file, &name).unwrap().flatten();
            messages
                .filter(|message| *message.schema == *Dropped::SCHEMA_NAME)
                .count()
        });
        marks.collect()
    }

    /// Frames, and numbers of the health records, that are in the folder; every file must be whole.
    fn read(&self) -> (u64, Vec<u64>) {
        Self::read_in(self.folder.path())
    }

    fn read_in(folder: &Path) -> (u64, Vec<u64>) {
        let (mut frames, mut windows) = (0, Vec::new());
        for name in Self::names_in(folder).iter().filter(|name| name.ends_with(".mcap")) {
            let open = || File::open(folder.join(name)).unwrap();
            for message in McapMessages::new(open(), name).unwrap() {
                let message = message.unwrap();
                if *message.schema == *Health::SCHEMA_NAME {
                    windows.push(message.log_time_ns);
                } else if *message.schema == *RawBatch::SCHEMA_NAME {
                    assert!(name.ends_with("-raw.mcap"));
                }
            }
            frames += McapFrames::new(open(), name, BusNames::new())
                .unwrap()
                .map(Result::unwrap)
                .count() as u64;
        }
        (frames, windows)
    }
}

/// What a killed process leaves of a raw segment of 4 chunks with 2000 frames each.
pub(super) fn cut_segment() -> Vec<u8> {
    let mut bench = Bench::new();
    let mut store = bench.open();
    for _ in 0..4 {
        bench.put_frames(&mut store, 500);
        store.raw.sync().unwrap();
    }
    fs::read(bench.folder.path().join("hmd-00000001-raw.mcap.part")).unwrap()
}

/// Places of the chunks.
pub(super) fn chunks(file: &[u8]) -> Vec<(usize, usize)> {
    let (mut at, mut chunks) = (mcap::MAGIC.len(), Vec::new());
    while let Some(head) = file.get(at..at + 9) {
        let end = at + 9 + u64::from_le_bytes(head[1..].try_into().unwrap()) as usize;
        if head[0] == mcap::records::op::CHUNK {
            chunks.push((at, end));
        }
        at = end;
    }
    chunks
}

#[test]
fn segments_are_closed_by_size_and_by_age() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    assert_eq!(
        bench.names(),
        ["hmd-00000000-records.mcap.part"],
        "open from the start; raw with the first frame"
    );
    for _ in 0..10 {
        bench.put_frames(&mut store, 1000);
        bench.tick(&mut store, 1);
    }
    let by_size = bench.names().len();
    assert!(by_size > 3, "{:?}", bench.names());
    bench.tick(&mut store, 60);
    bench.put_frames(&mut store, 1);
    assert!(bench.names().len() > by_size);
    assert!(Bench::put_health(&mut store, 1));
    let status = store.finish().status;
    assert!(!bench.names().iter().any(|name| name.ends_with(".part")));
    assert_eq!(bench.read(), (10_001, vec![1]));
    assert_eq!(
        (status.lost_frames, status.lost_records, status.state),
        (0, 0, StorageState::Ok)
    );
    let sizes = bench
        .names()
        .iter()
        .map(|name| fs::metadata(bench.folder.path().join(name)).unwrap().len())
        .max();
    assert!(sizes.unwrap() < 2 * LIMITS.segment_bytes, "{sizes:?}");
}

/// Found by the simulated world: a replay of the raw frames assessed a window that was dropped just after a segment had become old.
#[test]
fn a_decision_on_a_window_is_among_the_raw_frames_between_two_segments() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    bench.put_frames(&mut store, 10);
    bench.tick(&mut store, 60);
    let dropped = Dropped {
        actuator: "ema0".to_owned(),
        ..Dropped::default()
    };
    store.write_to_both(1, &dropped);
    bench.put_frames(&mut store, 10);
    store.finish();
    assert_eq!(bench.marks(), [0, 1], "in the one that the next frames continue");
}

#[test]
fn the_budget_is_kept_and_raw_frames_go_before_records() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    for window in 0..100 {
        bench.put_frames(&mut store, 2000);
        assert!(Bench::put_health(&mut store, window));
        bench.tick(&mut store, 5);
        let used: u64 = bench
            .names()
            .iter()
            .map(|name| fs::metadata(bench.folder.path().join(name)).unwrap().len())
            .sum();
        assert!(used <= LIMITS.budget_bytes, "{used} bytes");
        assert_eq!(store.status().used_bytes, used);
    }
    let status = store.finish().status;
    assert!(status.deleted > 5, "{status:?}");
    let (frames, windows) = bench.read();
    assert!(frames < bench.frames / 2);
    assert_eq!(windows, (0..100).collect::<Vec<_>>(), "records go last");
}

#[test]
fn too_little_free_space_costs_raw_frames_and_never_the_records() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    bench.put_frames(&mut store, 5000);
    assert!(Bench::put_health(&mut store, 1));
    bench.disk.free.store(LIMITS.free_bytes_min - 1, Relaxed);
    bench.tick(&mut store, 1);
    assert_eq!(store.status().state, StorageState::RawPaused);
    bench.put_frames(&mut store, 10);
    assert_eq!(store.status().lost_frames, 10);
    assert!(Bench::put_health(&mut store, 2));
    bench
        .disk
        .free
        .store(LIMITS.free_bytes_min + LIMITS.segment_bytes, Relaxed);
    bench.tick(&mut store, 1);
    bench.put_frames(&mut store, 10);
    let status = store.finish().status;
    assert_eq!((status.state, status.lost_frames), (StorageState::Ok, 10));
    assert_eq!(bench.read(), (10, vec![1, 2]));
    assert_eq!(
        bench.reported,
        [
            "storage: no room: raw frames are not stored, and counted",
            "storage: room again: raw frames are stored"
        ]
    );
}

#[test]
fn a_folder_has_one_writer() {
    let bench = Bench::new();
    let _store = bench.open();
    let second = SegmentStore::open(
        bench.folder.path(),
        &BTreeMap::new(),
        LIMITS,
        Box::new(RealDisk),
        bench.now,
    );
    assert!(matches!(second, Err(SegmentStoreError::InUse { .. })));
}

#[test]
fn a_record_is_on_the_disk_within_a_tick() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    bench.put_frames(&mut store, 3);
    store.write(1, &Log::new(1, LogLevel::Info, "hmd", "a line"));
    bench.tick(&mut store, 1);
    // As another process sees it, before anything is closed.
    let (mut messages, mut frames) = (0, 0);
    for name in bench.names() {
        let open = || File::open(bench.folder.path().join(&name)).unwrap();
        messages += McapMessages::new(open(), &name).unwrap().flatten().count();
        frames += McapFrames::new(open(), &name, BusNames::new())
            .unwrap()
            .flatten()
            .count();
    }
    assert_eq!((messages, frames), (2, 3));
}
