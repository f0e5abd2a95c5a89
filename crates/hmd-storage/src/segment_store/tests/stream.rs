//! The segments of one kind: their numbers, their syncs, and the pause after a failure.

use super::*;
use crate::mcap_writer::METADATA_NAME;

impl Bench {
    /// The numbers in the metadata of the segments of frames, oldest first.
    fn numbers(&self) -> Vec<String> {
        self.metadata("segment").into_iter().flatten().collect()
    }

    /// A value in the metadata of each segment of frames, oldest first.
    fn metadata(&self, key: &str) -> Vec<Option<String>> {
        let names = self.names().into_iter().filter(|name| name.contains("-raw.mcap"));
        let value = |name: String| {
            let file = File::open(self.folder.path().join(&name)).unwrap();
            let mut messages = McapMessages::new(file, &name).unwrap();
            let _ = messages.next();
            messages.metadata(METADATA_NAME).unwrap().get(key).cloned()
        };
        names.map(value).collect()
    }

    /// Some frames, and a disk that then fails for a tick.
    fn fail_once(&mut self, store: &mut SegmentStore) {
        self.put_frames(store, 10);
        self.disk.set(Some(io::ErrorKind::Other));
        self.tick(store, 1);
        self.disk.set(None);
    }
}

#[test]
fn segments_are_numbered_without_a_gap_but_for_one_after_a_failure() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    for _ in 0..3 {
        bench.put_frames(&mut store, 10);
        store.close_segment(Kind::Raw);
    }
    assert_eq!(bench.numbers(), ["0", "1", "2"]);
    bench.fail_once(&mut store);
    bench.tick(&mut store, 1);
    bench.put_frames(&mut store, 10);
    store.finish();
    assert_eq!(bench.numbers(), ["0", "1", "2", "5"], "3 failed");
}

/// Found by the simulated world: a replay of the folder was refused for a segment without frames.
#[test]
fn a_segment_without_frames_is_removed() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    bench.fail_once(&mut store);
    bench.tick(&mut store, 2);
    assert!(bench.names().iter().any(|name| name.ends_with("-raw.mcap.part")));
    store.finish();
    assert!(
        !bench.names().iter().any(|name| name.contains("-raw")),
        "{:?}",
        bench.names()
    );
}

#[test]
fn ticks_without_data_close_no_segment() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    for _ in 0..600 {
        bench.tick(&mut store, 0);
    }
    assert_eq!(bench.names(), ["hmd-00000000-records.mcap.part"]);
}

#[test]
fn after_a_failure_the_next_segment_waits_for_its_time() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    bench.fail_once(&mut store);
    let lost = store.status().lost_frames;
    bench.put_frames(&mut store, 7);
    assert_eq!(store.status().lost_frames, lost + 7, "too early");
    bench.tick(&mut store, 1);
    bench.put_frames(&mut store, 7);
    assert_eq!(store.status().lost_frames, lost + 7);
}

#[test]
fn a_capture_has_segments_of_its_own_with_its_reason_and_run() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    for why in ["worse", "asked for"] {
        store.begin_capture(why);
        bench.put_frames(&mut store, 10);
        store.end_capture();
        assert!(
            bench.names().iter().all(|name| !name.ends_with("-raw.mcap.part")),
            "closed as soon as the capture ends"
        );
    }
    // One that begins before the other has ended.
    store.begin_capture("one");
    bench.put_frames(&mut store, 10);
    store.begin_capture("another");
    bench.put_frames(&mut store, 10);
    store.finish();
    let reasons: Vec<String> = bench.metadata("capture").into_iter().flatten().collect();
    assert_eq!(reasons, ["worse", "asked for", "one", "another"]);
    let mut runs: Vec<String> = bench.metadata("run").into_iter().flatten().collect();
    assert_eq!(runs.len(), 4);
    runs.dedup();
    assert_eq!(
        runs.len(),
        4,
        "frames of two captures do not follow each other: {runs:?}"
    );
}

#[test]
fn a_capture_that_ends_while_the_disk_fails_loses_what_was_not_synced() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    store.begin_capture("worse");
    bench.put_frames(&mut store, 10);
    bench.tick(&mut store, 1);
    bench.put_frames(&mut store, 5);
    bench.disk.set(Some(io::ErrorKind::Other));
    store.end_capture();
    let status = store.status();
    assert_eq!(
        (status.lost_frames, status.segments, status.state),
        (5, 2, StorageState::Failing)
    );
    bench.disk.set(None);
    bench.tick(&mut store, 1);
    assert_eq!(store.finish().status.lost_frames, 5);
    drop(bench.open());
    assert_eq!(bench.read(), (10, Vec::new()));
}

#[test]
fn a_decision_on_a_window_without_frames_makes_no_segment_of_them() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    let dropped = Dropped {
        actuator: "ema0".to_owned(),
        ..Dropped::default()
    };
    store.write_to_raw(1, &dropped);
    bench.tick(&mut store, 1);
    assert_eq!(bench.names(), ["hmd-00000000-records.mcap.part"]);
    // Between two captures it belongs to neither.
    for _ in 0..2 {
        store.begin_capture("worse");
        bench.put_frames(&mut store, 10);
        store.end_capture();
        store.write_to_raw(2, &dropped);
    }
    store.finish();
    assert_eq!(bench.marks(), [0, 0]);
}

#[test]
fn a_run_without_frames_says_nothing_of_them_at_its_end() {
    let bench = Bench::new();
    let store = bench.open();
    bench.disk.set(Some(io::ErrorKind::Other));
    let messages = store.finish().messages;
    assert_eq!(messages.len(), 1, "{messages:?}");
    assert!(messages[0].1.starts_with("storage: records:"), "{messages:?}");
}

#[test]
fn a_decision_that_a_failing_disk_did_not_take_is_not_among_the_frames_of_the_next_capture() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    store.begin_capture("worse");
    bench.put_frames(&mut store, 10);
    bench.tick(&mut store, 1);
    bench.disk.set(Some(io::ErrorKind::Other));
    let dropped = Dropped {
        actuator: "ema0".to_owned(),
        ..Dropped::default()
    };
    store.write_to_raw(1, &dropped);
    store.end_capture();
    bench.disk.set(None);
    bench.tick(&mut store, 1);
    store.begin_capture("asked for");
    bench.put_frames(&mut store, 10);
    store.finish();
    drop(bench.open());
    assert_eq!(bench.marks(), [0, 0]);
}

/// A disk on which nothing waits for a sync.
struct PromptDisk;

impl Disk for PromptDisk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn Out>> {
        Ok(Box::new(File::create_new(path)?))
    }

    fn free_bytes(&self, _: &Path) -> io::Result<u64> {
        Ok(u64::MAX)
    }
}

/// Each sync adds an entry to the index, which is held in memory until the segment ends.
#[test]
fn a_segment_ends_after_512_syncs() {
    let mut bench = Bench::new();
    let limits = Limits {
        segment_bytes: 1 << 30,
        budget_bytes: 1 << 30,
        ..LIMITS
    };
    let disk = Box::new(PromptDisk);
    let mut store = SegmentStore::open(bench.folder.path(), &BTreeMap::new(), limits, disk, bench.now).unwrap();
    (0..511).for_each(|window| assert!(Bench::put_health(&mut store, window)));
    bench.tick(&mut store, 1);
    assert_eq!(bench.names(), ["hmd-00000000-records.mcap.part"]);
    assert!(Bench::put_health(&mut store, 511));
    bench.tick(&mut store, 1);
    assert_eq!(
        bench.names(),
        ["hmd-00000000-records.mcap", "hmd-00000001-records.mcap.part"]
    );
    assert_eq!(bench.read().1.len(), 512);
}
