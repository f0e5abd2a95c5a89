//! A folder that a daemon is writing to is read like any other.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::collections::BTreeMap;
use std::process::Command;
use std::time::{Duration, Instant};

use hmd_core::frame::BusNames;
use hmd_core::record::{Health, Rul};
use hmd_storage::segment_store::{RealDisk, SegmentStore};

use super::hmd;

#[test]
fn segments_in_progress_are_read_and_what_is_torn_at_their_end_is_no_loss() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("segments");
    let limits = hmd_core::config::Config::default().output().limits();
    let mut now = Instant::now();
    let mut store = SegmentStore::open(&folder, &BTreeMap::new(), limits, Box::new(RealDisk), now).unwrap();
    let health = |window| Health {
        actuator: "ema0".to_owned(),
        window,
        t_start_ns: 1_700_000_000_000_000_000 + window,
        status: "ok".to_owned(),
        health: "nominal".to_owned(),
        ..Health::default()
    };
    let put = |store: &mut SegmentStore, window| {
        let health = health(window);
        let rul = Rul {
            actuator: health.actuator.clone(),
            window,
            t_start_ns: health.t_start_ns,
            ..Rul::default()
        };
        store.write(health.t_start_ns, &health);
        store.write(health.t_start_ns, &rul);
        assert!(store.sync_window());
    };
    let windows = || hmd(root.path(), "inspect --json segments/").lines().count();
    put(&mut store, 0);
    assert_eq!(windows(), 1, "the first segment is still open");
    // It is closed for its age, and the next has no window yet.
    now += limits.segment_age + Duration::from_secs(1);
    store.tick(now);
    assert_eq!(windows(), 1);
    put(&mut store, 1);
    assert_eq!(windows(), 2);
    hmd(root.path(), "report segments/ -o page.html");
    hmd(root.path(), "export segments/ -o table.csv");

    let mut names = BusNames::new();
    names.intern("can0").unwrap();
    let log = hmd(root.path(), "simulate -o log.log --rate 400");
    assert_eq!(log, "");
    let mut source = hmd_ingest::file::open(&root.path().join("log.log")).unwrap();
    let frames: Vec<_> = source.by_ref().map(Result::unwrap).collect();
    for frame in &frames {
        store.write_frame(frame, &names);
    }
    store.tick(now);
    let replayed = || hmd(root.path(), "replay --json segments/").lines().count();
    assert_eq!(replayed(), 1);
    // The next segment is begun with a frame that is not on the disk yet.
    now += limits.segment_age + Duration::from_secs(1);
    store.tick(now);
    store.write_frame(&frames[0], &names);
    assert_eq!(replayed(), 1);
    // The writer was seen in the middle of a chunk.
    put(&mut store, 2);
    let mut paths = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
    let part = paths.find(|path| path.to_str().unwrap().ends_with("-records.mcap.part"));
    let part = part.unwrap();
    let whole = std::fs::read(&part).unwrap();
    put(&mut store, 3);
    let longer = std::fs::read(&part).unwrap();
    for cut in whole.len()..=longer.len() {
        std::fs::write(root.path().join("cut.mcap.part"), &longer[..cut]).unwrap();
        let windows = hmd(root.path(), "inspect --json cut.mcap.part").lines().count();
        assert!(windows == 1 || windows == 2, "{cut}: {windows}");
    }
    // Under another name it is a file that was cut.
    std::fs::write(root.path().join("cut.mcap"), &longer).unwrap();
    let code = |name: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hmd"));
        let ended = command.args(["inspect", name]).current_dir(root.path()).output();
        ended.unwrap().status.code()
    };
    assert_eq!(code("cut.mcap"), Some(3));
    // Damage before the end is one in both.
    let mut damaged = longer.clone();
    damaged[whole.len() - 40] ^= 1;
    std::fs::write(root.path().join("damaged.mcap.part"), damaged).unwrap();
    assert_eq!(code("damaged.mcap.part"), Some(3));
}
