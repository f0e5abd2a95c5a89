//! What a start finds: how it is counted, what waits for the background, and what it says.

use super::*;

#[test]
fn everything_found_is_counted_with_its_size() {
    let mut bench = Bench::new();
    let mut store = bench.open();
    bench.put_frames(&mut store, 3000);
    bench.tick(&mut store, 1);
    assert!(Bench::put_health(&mut store, 1));
    // Killed: both are cut.
    drop(store);
    let store = bench.open();
    let sizes = bench
        .names()
        .iter()
        .map(|name| fs::metadata(bench.folder.path().join(name)).unwrap().len())
        .sum::<u64>();
    assert_eq!(store.status().used_bytes, sizes);
    assert_eq!(store.status().segments, 3);
}

#[test]
fn a_long_cut_segment_is_repaired_beside_the_watch() {
    let mut bench = Bench::new();
    let limits = Limits {
        segment_bytes: 64 << 20,
        budget_bytes: 1 << 30,
        ..LIMITS
    };
    let open = |bench: &Bench| {
        let disk = Box::new(bench.disk.clone());
        SegmentStore::open(bench.folder.path(), &BTreeMap::new(), limits, disk, bench.now).unwrap()
    };
    let mut store = open(&bench);
    for n in 0..150_000u64 {
        let data: Vec<u8> = (0..8)
            .flat_map(|part| hmd_core::seed::mix(7, &[n, part]).to_le_bytes())
            .collect();
        let frame = RawFrame::new(n * 1000, 0, 0x100, FrameFlags::FD, &data).unwrap();
        store.write_frame(&frame, &bench.names);
    }
    bench.tick(&mut store, 1);
    drop(store);
    let part = bench.folder.path().join("hmd-00000001-raw.mcap.part");
    assert!(fs::metadata(&part).unwrap().len() > 8 << 20);
    let source = fs::read(&part).unwrap();
    let mut store = open(&bench);
    assert!(part.exists(), "the start does not wait for it");
    let at_start = store.status();
    let begun = Instant::now();
    let mut said = Vec::new();
    while !said
        .iter()
        .any(|text: &String| text.contains("hmd-00000001-raw.mcap.part was cut"))
    {
        assert!(begun.elapsed() < Duration::from_secs(60), "{said:?}");
        std::thread::sleep(Duration::from_millis(20));
        said.extend(store.tick(bench.now).into_iter().map(|(_, text)| text));
    }
    assert!(
        said.iter()
            .any(|text| text.contains("1 cut segment is repaired in the background")),
        "{said:?}"
    );
    assert!(!part.exists());
    assert_eq!(at_start.segments, store.status().segments, "it was counted before, too");
    assert!(store.status().used_bytes > 8 << 20);
    store.finish();
    // Once more, where the copy is there already: it is counted from the start on.
    fs::write(&part, source).unwrap();
    let mut store = open(&bench);
    let at_start = store.status();
    assert!(at_start.used_bytes > 8 << 20);
    let begun = Instant::now();
    while part.exists() {
        assert!(begun.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(20));
        store.tick(bench.now);
    }
    let bytes = || {
        bench
            .names()
            .into_iter()
            .map(|name| fs::metadata(bench.folder.path().join(name)).unwrap().len())
    };
    if let Some(repair) = &mut store.repair {
        repair.stop();
    }
    store.tick(bench.now);
    assert_eq!(at_start.segments, store.status().segments);
    assert_eq!(store.status().used_bytes, bytes().sum::<u64>());
    store.finish();
    assert_eq!(bench.read().0, 150_000);
}

#[test]
fn as_many_foreign_files_as_are_named_are_not_counted_as_more() {
    for (files, more) in [(16, None), (17, Some("storage: 1 more file"))] {
        let mut bench = Bench::new();
        for n in 0..files {
            let name = format!("hmd-{n:08}-raw.mcap");
            fs::write(bench.folder.path().join(name), "not ours").unwrap();
        }
        let mut store = bench.open();
        bench.tick(&mut store, 1);
        let said = bench.reported.iter().find(|text| text.contains("more file"));
        assert_eq!(said.is_some(), more.is_some(), "{said:?}");
        assert!(more.is_none_or(|more| said.is_some_and(|said| said.starts_with(more))));
    }
}

#[test]
fn a_cut_before_the_first_record_is_told_from_one_with_damage() {
    let bench = Bench::new();
    drop(bench.open());
    let name = "hmd-00000000-records.mcap.part";
    let header = fs::read(bench.folder.path().join(name)).unwrap();
    let mut again = Bench::new();
    fs::write(again.folder.path().join(name), &header).unwrap();
    let mut store = again.open();
    again.tick(&mut store, 1);
    let text = format!(
        "storage: {name} was cut: before its first record, after {} bytes",
        header.len()
    );
    assert!(again.reported.contains(&text), "{:?}", again.reported);
    let mut again = Bench::new();
    fs::write(again.folder.path().join(name), [header.as_slice(), &[6; 100]].concat()).unwrap();
    let mut store = again.open();
    again.tick(&mut store, 1);
    let text = format!("storage: {name} was cut: none of its {} bytes", header.len() + 100);
    assert!(
        again.reported.iter().any(|said| said.starts_with(&text)),
        "{:?}",
        again.reported
    );
}

#[test]
fn a_segment_cut_before_its_first_record_is_not_counted() {
    let bench = Bench::new();
    drop(bench.open());
    let store = bench.open();
    assert_eq!(bench.names(), ["hmd-00000001-records.mcap.part"]);
    assert_eq!(store.status().segments, 1);
}

#[test]
fn numbers_go_on_behind_any_name_but_one_that_would_use_them_up() {
    // Half of the largest number that is read from a name.
    for (number, next) in [
        (499_999_999_999_998_u64, 499_999_999_999_999_u64),
        (499_999_999_999_999, 0),
    ] {
        let bench = Bench::new();
        fs::write(bench.folder.path().join(format!("hmd-{number}-raw.mcap")), b"x").unwrap();
        drop(bench.open());
        let ours = format!("hmd-{next:08}-records.mcap.part");
        assert!(bench.names().contains(&ours), "{:?}", bench.names());
    }
}

#[test]
fn closed_segments_and_folders_with_the_name_of_a_damaged_one_are_not_thinned_out() {
    let bench = Bench::new();
    let file = cut_segment();
    // More than are kept of damaged ones, and within the budget.
    let names: Vec<String> = (0..9).map(|n| format!("hmd-{n:08}-raw.mcap")).collect();
    for name in &names {
        fs::write(bench.folder.path().join(name), &file).unwrap();
    }
    fs::create_dir(bench.folder.path().join("hmd-00000020-raw.mcap.damaged")).unwrap();
    for number in 21..29 {
        fs::write(
            bench.folder.path().join(format!("hmd-{number:08}-raw.mcap.damaged")),
            &file,
        )
        .unwrap();
    }
    let before = bench.names();
    drop(bench.open());
    let after = bench.names();
    assert!(before.iter().all(|name| after.contains(name)), "{after:?}");
}

/// A mechanic's link to a bigger disk.
#[test]
fn a_folder_that_was_a_link_from_the_start_is_used_and_may_be_replaced() {
    let base = tempfile::tempdir().unwrap();
    let (folder, target) = (base.path().join("segments"), base.path().join("disk"));
    fs::create_dir(&target).unwrap();
    std::os::unix::fs::symlink(&target, &folder).unwrap();
    for reopened in [false, true] {
        let now = Instant::now();
        let disk = Box::new(RealDisk);
        let limits = Limits {
            free_bytes_min: 0,
            ..LIMITS
        };
        let mut store = if reopened {
            SegmentStore::reopen(&folder, &BTreeMap::new(), limits, disk, now)
        } else {
            SegmentStore::open(&folder, &BTreeMap::new(), limits, disk, now).unwrap()
        };
        assert!(Bench::put_health(&mut store, 1), "{:?}", store.take_messages());
        // The folder behind the link goes, and comes back empty.
        fs::remove_dir_all(&target).unwrap();
        fs::create_dir(&target).unwrap();
        store.tick(now + Duration::from_secs(1));
        store.tick(now + Duration::from_secs(2));
        assert!(Bench::put_health(&mut store, 2), "{:?}", store.take_messages());
        assert_eq!(store.finish().status.state, StorageState::Ok);
        assert_eq!(fs::read_dir(&target).unwrap().count(), 1);
    }
}
