//! The segments of one kind: their numbers, their syncs, and the pause after a failure.

use super::*;
use crate::mcap_writer::METADATA_NAME;

impl Bench {
    /// The numbers in the metadata of the segments of frames, oldest first.
    fn numbers(&self) -> Vec<String> {
        let names = self.names().into_iter().filter(|name| name.contains("-raw.mcap"));
        let number = |name: String| {
            let file = File::open(self.folder.path().join(&name)).unwrap();
            let mut messages = McapMessages::new(file, &name).unwrap();
            let _ = messages.next();
            messages.metadata(METADATA_NAME).unwrap()["segment"].clone()
        };
        names.map(number).collect()
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
