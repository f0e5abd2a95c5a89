//! Disks and folders that fail, fill or go while the store writes.

use super::*;

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

/// A store whose disk failed and works again.
fn after_a_failure() -> (Bench, SegmentStore) {
    let mut bench = Bench::new();
    let mut store = bench.open();
    bench.put_frames(&mut store, 10);
    bench.disk.set(Some(io::ErrorKind::Other));
    bench.tick(&mut store, 1);
    assert_eq!(store.status().state, StorageState::Failing);
    bench.disk.set(None);
    (bench, store)
}

/// Found by the simulated world: both buses fell silent while the disk failed.
#[test]
fn storage_works_again_without_frames() {
    let (mut bench, mut store) = after_a_failure();
    bench.tick(&mut store, 2);
    assert_eq!(store.status().state, StorageState::Ok);
}

/// A window was assessed, or dropped, while the disk failed, or what it took was lost with the segment.
#[test]
fn marks_among_the_frames_wait_for_a_disk_that_fails() {
    let mark = |store: &mut SegmentStore, window| {
        let dropped = Dropped {
            actuator: "ema0".to_owned(),
            window,
            ..Dropped::default()
        };
        store.write_to_raw(window, &dropped);
        store.sync_window();
    };
    // The frames go on; the run ends before the next tick; without room.
    for case in ["frames", "end", "no room"] {
        let mut bench = Bench::new();
        let mut store = bench.open();
        bench.put_frames(&mut store, 10);
        bench.tick(&mut store, 1);
        mark(&mut store, 0);
        if case == "no room" {
            bench.disk.free.store(LIMITS.free_bytes_min - 1, Relaxed);
            bench.tick(&mut store, 1);
        } else {
            bench.disk.set(Some(io::ErrorKind::Other));
        }
        mark(&mut store, 1);
        mark(&mut store, 2);
        bench.disk.set(None);
        if case == "frames" {
            bench.tick(&mut store, 1);
            bench.put_frames(&mut store, 10);
        }
        let status = store.finish().status;
        assert_eq!(status.lost_frames, 0, "{case}: no frame was lost");
        bench.disk.free.store(0, Relaxed);
        drop(bench.open());
        let expected: &[usize] = if case == "no room" { &[2] } else { &[1, 2] };
        assert_eq!(bench.marks(), expected, "{case}");
    }
    // A disk that fails for long.
    let (mut bench, mut store) = after_a_failure();
    bench.disk.set(Some(io::ErrorKind::Other));
    (0..1030).for_each(|window| mark(&mut store, window));
    bench.disk.set(None);
    bench.tick(&mut store, 1);
    let status = store.finish().status;
    assert_eq!((bench.marks(), status.lost_frames), (vec![1024], 10 + 6));
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

/// `mv out out.old` while segments are open, also just before the end, or before frames find theirs full.
#[test]
fn a_folder_that_was_moved_keeps_what_was_written_and_another_is_made() {
    for case in ["tick", "full", "end", "replaced"] {
        let mut bench = Bench::new();
        let (folder, aside) = (
            bench.folder.path().to_owned(),
            bench.folder.path().with_extension("old"),
        );
        let mut store = bench.open();
        bench.put_frames(&mut store, 100);
        assert!(Bench::put_health(&mut store, 1));
        bench.tick(&mut store, 1);
        fs::rename(&folder, &aside).unwrap();
        if case == "replaced" {
            fs::create_dir(&folder).unwrap();
        }
        bench.put_frames(&mut store, 10);
        assert!(Bench::put_health(&mut store, 2), "{case}: its file is still there");
        let mut in_new = (0, Vec::new());
        if case != "end" {
            if case == "full" {
                store.now += Duration::from_secs(60);
            } else {
                bench.tick(&mut store, 1);
            }
            bench.put_frames(&mut store, 7);
            assert!(Bench::put_health(&mut store, 3), "{case}: {:?}", bench.reported);
            bench.tick(&mut store, 61);
            in_new = (7, vec![3]);
            let told = match case {
                "replaced" => format!("go on; what was written before is in {}", aside.display()),
                _ => format!("was moved to {}; it is created again", aside.display()),
            };
            let reported = bench.reported.join("\n");
            assert!(reported.contains(&told), "{case}: {reported}");
        }
        let status = store.finish().status;
        assert_eq!(
            (status.lost_frames, status.lost_records, status.state),
            (0, 0, StorageState::Ok),
            "{case}"
        );
        assert_eq!(Bench::read_in(&aside), (110, vec![1, 2]), "{case}");
        assert!(Bench::names_in(&aside).iter().all(|name| name.ends_with(".mcap")));
        fs::create_dir_all(&folder).unwrap();
        assert_eq!(bench.read(), in_new, "{case}");
        fs::remove_dir_all(aside).unwrap();
    }
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

/// A link to a folder in which somebody, or another run, has files of the same names.
#[test]
fn nothing_is_deleted_or_renamed_through_a_link() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    bench.put_frames(&mut store, 5000);
    store.close_segment(Kind::Raw);
    bench.put_frames(&mut store, 10);
    let (folder, aside) = (
        bench.folder.path().to_owned(),
        bench.folder.path().with_extension("aside"),
    );
    let other = tempfile::tempdir().unwrap();
    for name in bench.names() {
        fs::write(other.path().join(name), "a letter").unwrap();
    }
    let before = fs::read_dir(other.path()).unwrap().count();
    fs::rename(&folder, &aside).unwrap();
    std::os::unix::fs::symlink(other.path(), &folder).unwrap();
    bench.disk.free.store(LIMITS.free_bytes_min - 1, Relaxed);
    store.end_capture();
    for _ in 0..3 {
        bench.tick(&mut store, 1);
    }
    store.finish();
    let letters = fs::read_dir(other.path()).unwrap().filter(|entry| {
        entry
            .as_ref()
            .is_ok_and(|entry| fs::read(entry.path()).unwrap() == b"a letter")
    });
    assert_eq!(letters.count(), before);
    assert!(before >= 3, "records, and frames of both stages");
    fs::remove_file(&folder).unwrap();
    fs::rename(&aside, &folder).unwrap();
}

/// Frames that are not stored for want of room say nothing about the disk.
#[test]
fn frames_that_failed_and_then_paused_are_paused() {
    let (mut bench, mut store) = after_a_failure();
    bench.disk.free.store(LIMITS.free_bytes_min - 1, Relaxed);
    bench.tick(&mut store, 2);
    assert_eq!(store.status().state, StorageState::RawPaused);
    bench.disk.free.store(0, Relaxed);
    bench.tick(&mut store, 1);
    assert_eq!(store.status().state, StorageState::Ok, "{:?}", bench.reported);
}

#[test]
fn a_file_in_place_of_the_folder_is_refused() {
    let bench = Bench::new();
    let place = bench.folder.path().join("segments");
    fs::write(&place, "a letter").unwrap();
    let opened = SegmentStore::open(&place, &BTreeMap::new(), LIMITS, Box::new(RealDisk), bench.now);
    let refused = opened.err().map(|error| error.to_string()).unwrap_or_default();
    assert!(refused.contains("expected a folder for segments"), "{refused}");
    assert_eq!(fs::read(place).unwrap(), b"a letter");
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
