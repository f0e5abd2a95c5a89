//! What a start finds: segments of a killed process, damage, files of others.

use super::*;

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

/// A copy without its beginning is what a power cut during a repair leaves; without its source it may be anybody's.
#[test]
fn a_torn_copy_is_ours_only_beside_its_source() {
    let bench = Bench::new();
    let place = |name: &str| bench.folder.path().join(name);
    fs::write(place("hmd-00000007-raw.mcap.part"), cut_segment()).unwrap();
    for number in [7, 8] {
        fs::write(place(&format!("hmd-{number:08}-raw.mcap.repair")), b"").unwrap();
    }
    // What else a power cut may leave of the copy: zeros, or a part of its header.
    for (number, torn) in [(5, &[0; 4096][..]), (6, &cut_segment()[..20])] {
        fs::write(place(&format!("hmd-{number:08}-raw.mcap.part")), cut_segment()).unwrap();
        fs::write(place(&format!("hmd-{number:08}-raw.mcap.repair")), torn).unwrap();
    }
    // Not ours, and in the way: the source stays as it is.
    fs::write(place("hmd-00000009-raw.mcap.part"), cut_segment()).unwrap();
    fs::write(place("hmd-00000009-raw.mcap.repair"), b"a letter").unwrap();
    drop(bench.open());
    assert_eq!(
        bench.names(),
        [
            "hmd-00000005-raw.mcap",
            "hmd-00000006-raw.mcap",
            "hmd-00000007-raw.mcap",
            "hmd-00000008-raw.mcap.repair",
            "hmd-00000009-raw.mcap.part",
            "hmd-00000009-raw.mcap.repair",
            "hmd-00000010-records.mcap.part",
        ]
    );
    assert_eq!(fs::read(place("hmd-00000009-raw.mcap.repair")).unwrap(), b"a letter");
}

/// Whoever made the link may need what it leads to.
#[test]
fn a_link_with_the_name_of_a_torn_copy_is_left_alone() {
    let bench = Bench::new();
    let place = |name: &str| bench.folder.path().join(name);
    fs::write(place("hmd-00000007-raw.mcap.part"), cut_segment()).unwrap();
    fs::write(place("notes"), b"").unwrap();
    let link = place("hmd-00000007-raw.mcap.repair");
    std::os::unix::fs::symlink(place("notes"), &link).unwrap();
    drop(bench.open());
    assert!(link.is_symlink() && place("notes").exists());
    assert!(place("hmd-00000007-raw.mcap.part").exists(), "it waits for its place");
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
