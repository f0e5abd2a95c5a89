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
