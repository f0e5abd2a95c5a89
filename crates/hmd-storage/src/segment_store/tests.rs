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
        store.sync_records()
    }

    fn tick(&mut self, store: &mut SegmentStore, seconds: u64) {
        self.now += Duration::from_secs(seconds);
        let messages = store.tick(self.now);
        self.reported.extend(messages.into_iter().map(|(_, text)| text));
    }

    fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(self.folder.path()).unwrap();
        let mut names: Vec<_> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    /// Frames, and numbers of the health records, that are in the folder; every file must be whole.
    fn read(&self) -> (u64, Vec<u64>) {
        let (mut frames, mut windows) = (0, Vec::new());
        for name in self.names().iter().filter(|name| name.ends_with(".mcap")) {
            let open = || File::open(self.folder.path().join(name)).unwrap();
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
    let raw = |name: &String| name.ends_with("-raw.mcap");
    let decisions = bench.names().into_iter().filter(raw).map(|name| {
        let file = File::open(bench.folder.path().join(&name)).unwrap();
        let messages = McapMessages::new(file, &name).unwrap().flatten();
        messages
            .filter(|message| *message.schema == *Dropped::SCHEMA_NAME)
            .count()
    });
    assert_eq!(decisions.collect::<Vec<_>>(), [1, 0]);
}

#[test]
fn what_a_killed_process_had_synced_is_repaired_and_reported() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    bench.put_frames(&mut store, 100);
    assert!(Bench::put_health(&mut store, 1));
    bench.tick(&mut store, 1);
    // The open segments as a killed process leaves them, one torn in a chunk.
    let copies: Vec<_> = bench
        .names()
        .into_iter()
        .map(|name| (fs::read(bench.folder.path().join(&name)).unwrap(), name))
        .collect();
    drop(store);
    let place = |name: &str| bench.folder.path().join(name);
    for name in bench.names() {
        fs::remove_file(place(&name)).unwrap();
    }
    for (bytes, name) in &copies {
        fs::write(place(name), [bytes.as_slice(), &[6, 200, 0, 0]].concat()).unwrap();
    }
    fs::write(place("hmd-00000001-raw.mcap.repair"), b"").unwrap();

    let mut store = bench.open();
    assert_eq!(
        bench.names(),
        [
            "hmd-00000000-records.mcap",
            "hmd-00000001-raw.mcap",
            "hmd-00000002-records.mcap.part"
        ]
    );
    bench.tick(&mut store, 1);
    assert!(
        bench.reported[0].contains("hmd-00000000-records.mcap.part was cut: 1 record kept"),
        "{:?}",
        bench.reported
    );
    assert!(bench.reported[1].contains("1 damaged place"), "{:?}", bench.reported);
    store.finish();
    assert_eq!(bench.read(), (100, vec![1]));
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
fn a_segment_without_any_record_is_removed() {
    let bench = Bench::new();
    let name = "hmd-00000007-raw.mcap.part";
    let file = cut_segment();
    let first = chunks(&file)[0].0;
    fs::write(bench.folder.path().join(name), &file[..first]).unwrap();
    drop(bench.open());
    assert_eq!(bench.names(), ["hmd-00000008-records.mcap.part"]);
    // With a torn chunk there was something in it.
    fs::write(bench.folder.path().join(name), &file[..first + 100]).unwrap();
    drop(bench.open());
    assert!(bench.names().contains(&"hmd-00000007-raw.mcap.damaged".to_owned()));
}

/// The gravest find: the chunk with the definitions was hit, and the start removed all the others.
#[test]
fn a_flip_in_any_chunk_costs_that_chunk_and_the_source_is_kept() {
    let file = cut_segment();
    let chunks = chunks(&file);
    assert_eq!(chunks.len(), 4);
    for (start, end) in chunks {
        let mut bench = Bench::new();
        let place = bench.folder.path().join("hmd-00000007-raw.mcap.part");
        let mut damaged = file.clone();
        damaged[(start + end) / 2] ^= 1;
        fs::write(place, &damaged).unwrap();
        let mut store = bench.open();
        bench.tick(&mut store, 1);
        store.finish();
        let kept = fs::read(bench.folder.path().join("hmd-00000007-raw.mcap.damaged")).unwrap();
        assert_eq!(kept, damaged);
        let reported = bench.reported.concat();
        assert!(
            reported.contains("hmd-00000007-raw.mcap.part was damaged, and is kept as"),
            "{reported}"
        );
        let repaired = File::open(bench.folder.path().join("hmd-00000007-raw.mcap")).unwrap();
        let frames = McapFrames::new(repaired, "", BusNames::new()).unwrap();
        assert_eq!(frames.filter(Result::is_ok).count(), 1500);
    }
}

#[test]
fn a_start_that_was_cut_after_the_repair_keeps_a_damaged_source_too() {
    let file = cut_segment();
    let mut damaged = file.clone();
    let (start, end) = chunks(&file)[1];
    damaged[(start + end) / 2] ^= 1;
    for (source, kept) in [(&file, 0), (&damaged, 1)] {
        let bench = Bench::new();
        for end in ["", ".part"] {
            let name = format!("hmd-00000007-raw.mcap{end}");
            fs::write(bench.folder.path().join(name), source).unwrap();
        }
        drop(bench.open());
        let names = bench.names();
        assert!(!names.contains(&"hmd-00000007-raw.mcap.part".to_owned()), "{names:?}");
        assert_eq!(
            names.iter().filter(|name| name.ends_with(".damaged")).count(),
            kept,
            "{names:?}"
        );
    }
}

#[test]
fn the_newest_damaged_segments_are_kept() {
    let mut bench = Bench::new();
    let file = cut_segment();
    for number in 0..20 {
        let name = format!("hmd-{number:08}-raw.mcap.damaged");
        fs::write(bench.folder.path().join(name), &file).unwrap();
    }
    fs::write(bench.folder.path().join("hmd-00000020-raw.mcap.damaged"), b"a letter").unwrap();
    let mut store = bench.open();
    bench.tick(&mut store, 1);
    let names = bench.names();
    let left: Vec<_> = names.iter().filter(|name| name.ends_with(".damaged")).collect();
    assert_eq!(left.len(), 9, "{left:?}");
    assert_eq!(left[0], "hmd-00000012-raw.mcap.damaged");
    assert_eq!(
        bench.reported.iter().filter(|text| text.contains("is removed")).count(),
        12
    );
    assert_eq!(names.last().unwrap(), "hmd-00000021-records.mcap.part");
}

/// An empty copy is what a power cut during a repair leaves; without its source it may be anybody's.
#[test]
fn an_empty_copy_is_ours_only_beside_its_source() {
    let bench = Bench::new();
    let place = |name: &str| bench.folder.path().join(name);
    fs::write(place("hmd-00000007-raw.mcap.part"), cut_segment()).unwrap();
    for number in [7, 8] {
        fs::write(place(&format!("hmd-{number:08}-raw.mcap.repair")), b"").unwrap();
    }
    // Not ours, and in the way: the source stays as it is.
    fs::write(place("hmd-00000009-raw.mcap.part"), cut_segment()).unwrap();
    fs::write(place("hmd-00000009-raw.mcap.repair"), b"a letter").unwrap();
    drop(bench.open());
    assert_eq!(
        bench.names(),
        [
            "hmd-00000007-raw.mcap",
            "hmd-00000008-raw.mcap.repair",
            "hmd-00000009-raw.mcap.part",
            "hmd-00000009-raw.mcap.repair",
            "hmd-00000010-records.mcap.part",
        ]
    );
    assert_eq!(fs::read(place("hmd-00000009-raw.mcap.repair")).unwrap(), b"a letter");
}

#[test]
fn unrecognised_files_are_kept() {
    let mut bench = Bench::new();
    let place = |name: &str| bench.folder.path().join(name);
    let foreign = [
        ("hmd-00000003-raw.mcap.part", &b""[..]),
        ("hmd-00000004-raw.mcap.part", b"\x89MCAP0"),
        ("hmd-00000005-records.mcap", mcap::MAGIC),
        ("hmd-00000006-records.mcap.repair", mcap::MAGIC),
        ("hmd-18446744073709551615-raw.mcap", b"x"),
        ("hmd-999999999999999-raw.mcap", b"x"),
    ];
    for (name, content) in foreign {
        fs::write(place(name), content).unwrap();
    }
    let fifo = place("hmd-00000007-raw.mcap.part");
    nix::unistd::mkfifo(&fifo, nix::sys::stat::Mode::S_IRWXU).unwrap();
    for number in 100..130 {
        fs::write(place(&format!("hmd-{number:08}-raw.mcap")), b"x").unwrap();
    }
    let mut store = bench.open();
    bench.tick(&mut store, 1);
    store.finish();
    for (name, content) in foreign {
        assert_eq!(fs::read(bench.folder.path().join(name)).unwrap(), content, "{name}");
    }
    assert!(
        bench.names().contains(&"hmd-00000130-records.mcap".to_owned()),
        "{:?}",
        bench.names()
    );
    let about_others = bench.reported.iter().filter(|text| text.contains("left alone")).count();
    assert_eq!(about_others, 17, "{:?}", bench.reported);
    assert!(
        bench.reported.iter().any(|text| text.contains("20 more files")),
        "{:?}",
        bench.reported
    );
}

#[test]
fn files_of_others_are_never_touched() {
    let mut bench = Bench::new();
    let foreign = [
        "flight.mcap",
        "hmd-00000003-raw.mcap",
        "hmd-00000004-raw.mcap.part",
        "notes.txt",
    ];
    for name in foreign {
        fs::write(bench.folder.path().join(name), vec![7; 300_000]).unwrap();
    }
    std::os::unix::fs::symlink(
        bench.folder.path().join("notes.txt"),
        bench.folder.path().join("hmd-00000005-raw.mcap"),
    )
    .unwrap();
    let mut store = bench.open();
    for _ in 0..20 {
        bench.put_frames(&mut store, 5000);
        bench.tick(&mut store, 1);
    }
    assert!(store.status().deleted > 0);
    assert!(
        bench
            .reported
            .iter()
            .any(|text| text.contains("hmd-00000003-raw.mcap is not one of our segments"))
    );
    store.finish();
    for name in foreign.iter().chain(&["hmd-00000005-raw.mcap"]) {
        assert_eq!(
            fs::read(bench.folder.path().join(name)).unwrap(),
            vec![7; 300_000],
            "{name}"
        );
    }
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
fn a_disk_that_fails_for_a_while_costs_what_is_counted() {
    for kind in [
        io::ErrorKind::StorageFull,
        io::ErrorKind::ReadOnlyFilesystem,
        io::ErrorKind::Other,
    ] {
        let mut bench = Bench::new();
        let mut store = bench.open();
        bench.put_frames(&mut store, 100);
        assert!(Bench::put_health(&mut store, 1));
        bench.tick(&mut store, 1);
        bench.disk.set(Some(kind));
        for window in 2..5 {
            bench.put_frames(&mut store, 100);
            assert!(!Bench::put_health(&mut store, window), "not reported as stored");
            bench.tick(&mut store, 1);
        }
        assert_eq!(store.status().state, StorageState::Failing);
        bench.disk.set(None);
        bench.tick(&mut store, 1);
        assert!(Bench::put_health(&mut store, 5));
        bench.put_frames(&mut store, 100);
        bench.tick(&mut store, 1);
        let status = store.finish().status;
        assert_eq!(
            (status.lost_frames, status.lost_records, status.state),
            (300, 3, StorageState::Ok),
            "{kind:?}"
        );
        let failures = bench
            .reported
            .iter()
            .filter(|text| text.contains("tried again every second"))
            .count();
        assert!(failures <= 2, "each is reported once: {:?}", bench.reported);
        let last = "storage: written again; not stored since the start: 300 frames, 3 records";
        assert_eq!(bench.reported.last().unwrap(), last);
        drop(bench.open());
        assert_eq!(bench.read(), (200, vec![1, 5]), "{kind:?}");
    }
}

#[test]
fn a_disk_that_fails_for_long_leaves_no_file_for_each_attempt() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    for _ in 0..20 {
        // Segments begin well and fail with the first frames.
        bench.disk.set(None);
        bench.put_frames(&mut store, 10);
        bench.disk.set(Some(io::ErrorKind::Other));
        bench.tick(&mut store, 1);
    }
    assert!(store.status().lost_frames >= 100);
    assert!(bench.names().len() <= 1, "{:?}", bench.names());
}

/// Found by the simulated world: both buses fell silent while the disk failed.
#[test]
fn storage_works_again_without_frames() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    bench.put_frames(&mut store, 10);
    bench.disk.set(Some(io::ErrorKind::Other));
    bench.tick(&mut store, 1);
    assert_eq!(store.status().state, StorageState::Failing);
    bench.disk.set(None);
    bench.tick(&mut store, 2);
    assert_eq!(store.status().state, StorageState::Ok);
}

#[test]
fn store_retries_when_disk_full_at_start() {
    for creates in [false, true] {
        let mut bench = Bench::new();
        bench.disk.creates.store(creates, Relaxed);
        bench.disk.set(Some(io::ErrorKind::StorageFull));
        let mut store = bench.open();
        assert!(!Bench::put_health(&mut store, 1));
        bench.disk.set(None);
        bench.tick(&mut store, 1);
        assert!(Bench::put_health(&mut store, 2));
        assert_eq!(store.finish().status.lost_records, 1);
        assert_eq!(bench.read(), (0, vec![2]));
    }
}

#[test]
fn removed_segments_are_lost_and_reported() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    bench.put_frames(&mut store, 100);
    assert!(Bench::put_health(&mut store, 1));
    bench.tick(&mut store, 1);
    fs::remove_dir_all(bench.folder.path()).unwrap();
    bench.put_frames(&mut store, 10);
    assert!(!Bench::put_health(&mut store, 2), "not reported as stored");
    bench.tick(&mut store, 1);
    assert_eq!((store.status().lost_frames, store.status().lost_records), (110, 2));
    bench.tick(&mut store, 1);
    assert!(Bench::put_health(&mut store, 3), "goes on in a new folder");
    bench.put_frames(&mut store, 10);
    bench.tick(&mut store, 1);
    let reported = bench.reported.join("\n");
    assert!(reported.contains("somebody has removed it"), "{reported}");
    assert!(reported.contains("was removed; it is created again"), "{reported}");
    let status = store.finish().status;
    assert_eq!((status.lost_frames, status.lost_records), (110, 2));
    assert_eq!(bench.read(), (10, vec![3]));
    // Once more, with nothing that could fail before the end.
    let mut store = bench.open();
    bench.put_frames(&mut store, 10);
    assert!(Bench::put_health(&mut store, 4));
    bench.tick(&mut store, 1);
    fs::remove_dir_all(bench.folder.path()).unwrap();
    let SegmentStoreEnd { status, messages } = store.finish();
    assert_eq!((status.lost_frames, status.lost_records), (10, 1));
    assert!(
        messages
            .iter()
            .any(|(_, text)| text.contains("somebody has removed it")),
        "{messages:?}"
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

#[test]
fn a_folder_that_is_replaced_or_becomes_a_link_is_told_as_that() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    assert!(Bench::put_health(&mut store, 1));
    let (folder, aside) = (
        bench.folder.path().to_owned(),
        bench.folder.path().with_extension("aside"),
    );
    fs::rename(&folder, &aside).unwrap();
    std::os::unix::fs::symlink(&aside, &folder).unwrap();
    bench.tick(&mut store, 1);
    assert!(!Bench::put_health(&mut store, 2), "nothing goes through the link");
    bench.tick(&mut store, 1);
    assert!(
        bench.reported.iter().any(|text| text.contains("has become a link")),
        "{:?}",
        bench.reported
    );
    assert_eq!(store.status().state, StorageState::Failing);
    fs::remove_file(&folder).unwrap();
    fs::create_dir(&folder).unwrap();
    for _ in 0..3 {
        bench.tick(&mut store, 1);
    }
    assert!(Bench::put_health(&mut store, 3), "{:?}", bench.reported);
    bench.tick(&mut store, 1);
    // Replaced by another folder at once.
    fs::rename(&folder, aside.join("first")).unwrap();
    fs::create_dir(&folder).unwrap();
    for _ in 0..3 {
        bench.tick(&mut store, 1);
    }
    assert!(Bench::put_health(&mut store, 4), "{:?}", bench.reported);
    assert!(
        bench
            .reported
            .iter()
            .any(|text| text.contains("was replaced by another")),
        "{:?}",
        bench.reported
    );
    bench.tick(&mut store, 1);
    assert_eq!(store.status().state, StorageState::Ok);
    store.finish();
    fs::remove_dir_all(aside).unwrap();
}

#[test]
fn a_folder_that_takes_no_segment_is_refused() {
    let bench = Bench::new();
    bench.disk.set(Some(io::ErrorKind::PermissionDenied));
    let disk = Box::new(bench.disk.clone());
    let opened = SegmentStore::open(bench.folder.path(), &BTreeMap::new(), LIMITS, disk, bench.now);
    assert!(matches!(opened, Err(SegmentStoreError::Unwritable { .. })));
}

/// After a reload the run goes on whatever became of the folder, and stores again when it is back.
#[test]
fn a_folder_that_fails_at_a_reload_costs_what_is_counted() {
    let mut bench = Bench::new();
    let folder = bench.folder.path().join("segments");
    let reopen = |bench: &Bench| {
        let disk = Box::new(bench.disk.clone());
        SegmentStore::reopen(&folder, &BTreeMap::new(), LIMITS, disk, bench.now)
    };
    // A file at its place, another writer, a disk that fails.
    for case in 0..3 {
        let _ = fs::remove_dir_all(&folder);
        let mut other = None;
        match case {
            0 => fs::write(&folder, "no folder").unwrap(),
            1 => other = hold(&folder).unwrap(),
            _ => bench.disk.set(Some(io::ErrorKind::PermissionDenied)),
        }
        let mut store = reopen(&bench);
        assert!(!Bench::put_health(&mut store, 1), "case {case}");
        bench.put_frames(&mut store, 3);
        bench.tick(&mut store, 1);
        let failing = store.status();
        assert_eq!(
            (failing.lost_records, failing.lost_frames, failing.state),
            (1, 3, StorageState::Failing),
            "case {case}"
        );
        let reported = bench.reported.join("\n");
        assert!(reported.contains("tried again every second"), "case {case}: {reported}");
        bench.disk.set(None);
        drop(other);
        if case == 0 {
            fs::remove_file(&folder).unwrap();
        }
        bench.reported.clear();
        bench.tick(&mut store, 2);
        bench.put_frames(&mut store, 2);
        assert!(Bench::put_health(&mut store, 2), "case {case}: {:?}", bench.reported);
        bench.tick(&mut store, 2);
        assert_eq!(
            bench.reported,
            ["storage: written again; not stored since the start: 3 frames, 1 record"],
            "case {case}"
        );
        let end = store.finish();
        assert_eq!(
            (end.status.lost_records, end.status.state),
            (1, StorageState::Ok),
            "case {case}"
        );
        let segments = fs::read_dir(&folder).unwrap().count();
        assert_eq!(segments, 2, "case {case}");
    }
}
