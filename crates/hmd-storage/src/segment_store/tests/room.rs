//! Room is made, paused and found again at exactly the limits.

use super::*;

#[test]
fn the_real_disk_says_how_much_is_free() {
    let folder = tempfile::tempdir().unwrap();
    assert!(RealDisk.free_bytes(folder.path()).unwrap() > 1 << 20);
    assert!(RealDisk.free_bytes(&folder.path().join("none")).is_err());
}

#[test]
fn names_of_segments_are_told_from_others() {
    for name in ["hmd-00000012-raw.mcap", "hmd-00000013-records.mcap.part"] {
        assert!(is_segment_name(name), "{name}");
    }
    for name in ["flight.mcap", "hmd-raw.mcap", "hmd-00000012-raw.mcap~"] {
        assert!(!is_segment_name(name), "{name}");
    }
}

#[test]
fn the_status_counts_segments_in_progress_and_closed_ones() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    assert_eq!(store.status().segments, 1);
    bench.put_frames(&mut store, 1);
    assert_eq!(store.status().segments, 2);
    bench.tick(&mut store, 61);
    assert_eq!(store.status().segments, 3, "old records, new ones, and frames");
    assert_eq!(store.finish().status.segments, 3);
}

#[test]
fn nothing_is_removed_within_the_budget_and_frames_go_one_byte_beyond() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    bench.put_frames(&mut store, 3000);
    store.finish();
    let open = |budget_bytes: u64| {
        let limits = Limits {
            segment_bytes: 1000,
            budget_bytes,
            ..LIMITS
        };
        let disk = Box::new(bench.disk.clone());
        SegmentStore::open(bench.folder.path(), &BTreeMap::new(), limits, disk, bench.now).unwrap()
    };
    let used = {
        let mut store = open(u64::MAX);
        store.tick(bench.now);
        store.status().used_bytes
    };
    // The store before left its records as one more segment, without any record: they are removed at the start.
    let mut store = open(used);
    store.tick(bench.now);
    let status = store.status();
    assert_eq!(
        (status.used_bytes, status.deleted, status.state),
        (used, 0, StorageState::Ok)
    );
    drop(store);
    let mut store = open(used - 1);
    store.tick(bench.now);
    let status = store.status();
    assert!(status.used_bytes < used && status.deleted == 1, "{status:?}");
}

#[test]
fn the_least_free_space_is_enough_and_frames_return_with_room_for_a_segment() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    let mut state_at = |free: u64, store: &mut SegmentStore| {
        bench.disk.free.store(free, Relaxed);
        bench.tick(store, 1);
        store.status().state
    };
    let (least, segment) = (LIMITS.free_bytes_min, LIMITS.segment_bytes);
    assert_eq!(state_at(least, &mut store), StorageState::Ok);
    assert_eq!(state_at(least - 1, &mut store), StorageState::RawPaused);
    assert_eq!(state_at(least + segment - 1, &mut store), StorageState::RawPaused);
    assert_eq!(state_at(least + segment, &mut store), StorageState::Ok);
}

#[test]
fn the_frames_in_progress_go_before_the_oldest_records_and_not_before_older_frames() {
    let limits = Limits {
        segment_bytes: 50_000,
        budget_bytes: 60_000,
        ..LIMITS
    };
    let mut bench = Bench::new();
    let disk = Box::new(bench.disk.clone());
    let mut store = SegmentStore::open(bench.folder.path(), &BTreeMap::new(), limits, disk, bench.now).unwrap();
    assert!(Bench::put_health(&mut store, 1));
    bench.tick(&mut store, 61);
    while store.status().used_bytes <= limits.budget_bytes {
        bench.put_frames(&mut store, 500);
        bench.disk.set(None);
        store.raw.sync().unwrap();
        if store.raw.bytes() > 45_000 && !bench.names().iter().any(|name| name.ends_with("-raw.mcap")) {
            store.close_segment(Kind::Raw);
        }
    }
    let newest = bench.names().into_iter().rfind(|name| name.contains("-raw.mcap"));
    bench.tick(&mut store, 0);
    // The older segment of frames was enough.
    assert_eq!(store.status().deleted, 1);
    assert!(newest.is_some_and(|name| bench.names().contains(&name)));
    while store.status().used_bytes <= limits.budget_bytes {
        bench.put_frames(&mut store, 500);
        store.raw.sync().unwrap();
    }
    bench.tick(&mut store, 0);
    assert_eq!(store.status().deleted, 2);
    assert_eq!(bench.read(), (0, vec![1]), "records stay");
}

#[test]
fn a_segment_that_somebody_removed_is_forgotten_and_one_that_cannot_be_deleted_is_told_once() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    bench.put_frames(&mut store, 5000);
    store.close_segment(Kind::Raw);
    bench.put_frames(&mut store, 1);
    store.close_segment(Kind::Raw);
    let raw = || bench.names().into_iter().filter(|name| name.ends_with("-raw.mcap"));
    let first = raw().next().unwrap();
    fs::remove_file(bench.folder.path().join(first)).unwrap();
    bench.disk.free.store(LIMITS.free_bytes_min - 1, Relaxed);
    bench.tick(&mut store, 1);
    assert_eq!(store.status().deleted, 1, "the other one alone");
    assert_eq!(
        bench.reported,
        ["storage: no room: raw frames are not stored, and counted"]
    );

    let mut bench = Bench::new();
    let mut store = bench.open();
    bench.put_frames(&mut store, 5000);
    store.close_segment(Kind::Raw);
    bench.disk.free.store(LIMITS.free_bytes_min - 1, Relaxed);
    bench.disk.keeps.store(true, Relaxed);
    for _ in 0..3 {
        bench.tick(&mut store, 1);
    }
    assert_eq!(
        (store.status().deleted, store.status().state),
        (0, StorageState::RawPaused)
    );
    let told = bench.reported.iter().filter(|text| text.contains("cannot be deleted"));
    assert_eq!(told.count(), 1, "{:?}", bench.reported);
    bench.disk.keeps.store(false, Relaxed);
    bench.tick(&mut store, 1);
    assert_eq!(store.status().deleted, 1);
}

#[test]
fn a_segment_that_cannot_get_its_closed_name_is_counted_as_long_as_it_is_there() {
    for is_removed in [false, true] {
        let mut bench = Bench::new();
        let mut store = bench.open();
        bench.put_frames(&mut store, 100);
        store.raw.sync().unwrap();
        // Its closed name is in use.
        fs::write(bench.folder.path().join("hmd-00000001-raw.mcap"), "a letter").unwrap();
        let part = bench.folder.path().join("hmd-00000001-raw.mcap.part");
        if is_removed {
            fs::remove_file(&part).unwrap();
        }
        let records = store.records.bytes();
        store.end_capture();
        let status = store.status();
        let (segments, lost) = if is_removed { (1, 100) } else { (2, 0) };
        assert_eq!((status.segments, status.lost_frames), (segments, lost), "{is_removed}");
        assert_eq!(status.used_bytes > records, !is_removed, "{is_removed}");
    }
}

#[test]
fn a_closed_name_that_is_not_safe_yet_is_no_removed_segment() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    bench.put_frames(&mut store, 100);
    bench.disk.loses_names.store(true, Relaxed);
    store.end_capture();
    assert!(bench.names().contains(&"hmd-00000001-raw.mcap".to_owned()));
    let status = store.status();
    assert_eq!((status.segments, status.lost_frames), (2, 0));
    assert!(status.used_bytes > store.records.bytes());
}

#[test]
fn at_most_64_different_failures_are_told_until_all_is_stored_again() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    for _ in 0..70 {
        bench.put_frames(&mut store, 1);
        store.close_segment(Kind::Raw);
    }
    bench.disk.free.store(LIMITS.free_bytes_min - 1, Relaxed);
    bench.disk.keeps.store(true, Relaxed);
    for _ in 0..3 {
        bench.tick(&mut store, 1);
    }
    let told = |bench: &Bench| {
        let about = bench.reported.iter().filter(|text| text.contains("cannot be deleted"));
        about.count()
    };
    assert_eq!(told(&bench), 64);
    // All is stored again; then the same is told once more.
    bench.disk.free.store(0, Relaxed);
    bench.tick(&mut store, 1);
    assert!(
        bench.reported.iter().any(|text| text.contains("written again")),
        "{:?}",
        bench.reported.last()
    );
    bench.disk.free.store(LIMITS.free_bytes_min - 1, Relaxed);
    bench.tick(&mut store, 1);
    assert_eq!(told(&bench), 128);
}

#[test]
fn frames_in_progress_alone_go_before_closed_records() {
    let limits = Limits {
        segment_bytes: 500_000,
        budget_bytes: 60_000,
        ..LIMITS
    };
    let mut bench = Bench::new();
    let disk = Box::new(bench.disk.clone());
    let mut store = SegmentStore::open(bench.folder.path(), &BTreeMap::new(), limits, disk, bench.now).unwrap();
    assert!(Bench::put_health(&mut store, 1));
    bench.tick(&mut store, 61);
    while store.status().used_bytes <= limits.budget_bytes {
        bench.put_frames(&mut store, 500);
        store.raw.sync().unwrap();
    }
    let closed = |bench: &Bench| bench.names().into_iter().filter(|name| name.ends_with(".mcap"));
    assert_eq!(closed(&bench).collect::<Vec<_>>(), ["hmd-00000000-records.mcap"]);
    bench.tick(&mut store, 0);
    assert_eq!(store.status().deleted, 1);
    assert_eq!(closed(&bench).collect::<Vec<_>>(), ["hmd-00000000-records.mcap"]);
    assert_eq!(store.finish().status.state, StorageState::Ok);
}

#[test]
fn frames_pause_while_what_cannot_be_deleted_exceeds_the_budget() {
    let limits = Limits {
        segment_bytes: 1000,
        budget_bytes: 60_000,
        ..LIMITS
    };
    let mut bench = Bench::new();
    let disk = Box::new(bench.disk.clone());
    let mut store = SegmentStore::open(bench.folder.path(), &BTreeMap::new(), limits, disk, bench.now).unwrap();
    while store.status().used_bytes <= limits.budget_bytes {
        bench.put_frames(&mut store, 500);
        store.close_segment(Kind::Raw);
    }
    bench.disk.keeps.store(true, Relaxed);
    bench.tick(&mut store, 1);
    assert_eq!(
        (store.status().deleted, store.status().state),
        (0, StorageState::RawPaused)
    );
    bench.put_frames(&mut store, 3);
    assert_eq!(store.status().lost_frames, 3);
    bench.disk.keeps.store(false, Relaxed);
    bench.tick(&mut store, 1);
    let status = store.status();
    assert!(
        status.deleted > 0 && status.used_bytes <= limits.budget_bytes,
        "{status:?}"
    );
}
