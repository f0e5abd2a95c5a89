//! Which commissioning a replay uses for a unit that a daemon has learnt, and which windows come first where a clock was wrong.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::path::{Path, PathBuf};
use std::sync::Arc;

use hmd::replay::{Replay, Summary};
use hmd_core::config::{Config, Limits};
use hmd_lab::simulate::EPOCH_NS;
use hmd_storage::config_file::load_config;
use hmd_storage::recorder::{Recorder, metadata};
use hmd_storage::segment_store::raw_segments;

use super::folder::Folder;
use super::learning::{CONFIG, MINUTE_NS, SEED, run, run_from};
use super::lines::Lines;

const DAY_NS: u64 = 24 * 60 * MINUTE_NS;

fn configured(folder: &Folder, text: &str) -> Arc<Config> {
    folder.write("hmd.toml", text);
    Arc::new(load_config(folder.path("hmd.toml")).unwrap())
}

fn replayed(config: &Arc<Config>, logs: &[PathBuf]) -> (Lines, Summary) {
    let lines = Lines::default();
    let replay = Replay {
        logs,
        output: None,
        config: config.clone(),
        seed: SEED,
    };
    let summary = replay.run(&mut &lines).unwrap();
    (lines, summary)
}

/// A run that goes on in a folder; its lines.
fn run_into(folder: &Path, from_ns: u64, config: &Arc<Config>, actuations: u32) -> Vec<String> {
    let limits = Limits::new(1_000_000, 3600, 1000, 0);
    let recorder = Recorder::open_folder(folder, &metadata(config, "test", SEED), limits).unwrap();
    run_from(from_ns, config, actuations, recorder).0
}

fn raw_logs(folder: &Path) -> Vec<PathBuf> {
    let raw = raw_segments(folder).unwrap();
    raw.into_values().map(|segment| segment.path).collect()
}

fn reset(t_ns: u64) -> String {
    format!(
        "{}\n",
        serde_json::json!({"t_ns": t_ns, "actuator": "flap", "event": "reset"})
    )
}

/// The windows that a unit was learnt from are in a file of before, or were deleted for room: those that are left may be of a worn unit.
#[test]
#[ignore = "long form: cargo xtask robust"]
fn windows_of_a_unit_that_was_known_are_assessed_by_it_or_not_learnt_from() {
    let folder = Folder::new();
    let config = configured(&folder, CONFIG);
    let kept = folder.path("units").join("flap+S_7.unit.toml");
    let (first, second) = (folder.path("first.mcap"), folder.path("second.mcap"));
    let (of_first, _) = run(&config, 6, &first);
    let recorder = Recorder::create(&second, &metadata(&config, "test", SEED)).unwrap();
    let (of_second, _) = run_from(EPOCH_NS + MINUTE_NS, &config, 7, recorder);
    assert!(!of_second[0].contains("learning"), "{}", of_second[0]);

    let (alone, summary) = replayed(&config, std::slice::from_ref(&second));
    assert_eq!(alone.health(), of_second);
    let told = format!("flap: assessed by what was learnt of it, {}", kept.display());
    assert_eq!((alone.notices(), summary.loss()), (vec![told], None));
    let (both, _) = replayed(&config, &[first, second.clone()]);
    assert_eq!(both.health()[..6], of_first[..]);
    assert!(!both.health()[6..].iter().any(|line| line.contains("learn")));

    // Another unit in its place, or none.
    let unit = std::fs::read_to_string(&kept).unwrap();
    let other = unit.replace("windows = 5", "windows = 6");
    for (text, why) in [(Some(other), "is that of another one"), (None, "is not there")] {
        match text {
            Some(text) => std::fs::write(&kept, text).unwrap(),
            None => std::fs::remove_file(&kept).unwrap(),
        }
        let (lines, summary) = replayed(&config, std::slice::from_ref(&second));
        let reason = "not learnt: its run assessed it by a unit that it had learnt before (SHA-256 ";
        for line in lines.health() {
            assert!(line.contains(reason) && line.contains(why), "{line}");
        }
        let told = lines.notices().iter().filter(|notice| notice.contains(why)).count();
        assert_eq!(told, 1, "{:#?}", lines.notices());
        let loss = summary.loss().unwrap();
        assert_eq!(loss, "7 windows assessed without what was learnt of the unit");
    }
    let ended = folder.hmd("replay second.mcap -c hmd.toml");
    assert_eq!(ended.code, 3, "{}", ended.stderr);
}

/// The file is that of the newest unit; windows of the one before are not assessed by it.
#[test]
fn a_replaced_unit_is_not_taken_for_the_one_before() {
    let folder = Folder::new();
    let config = configured(
        &folder,
        &format!("[rul]\nstate = \"state\"\nevents = \"events.jsonl\"\n{CONFIG}"),
    );
    let segments = folder.path("segments");
    let from = |minutes: u64| EPOCH_NS + minutes * MINUTE_NS;
    let mut live = run_into(&segments, from(0), &config, 6);
    live.extend(run_into(&segments, from(1), &config, 2));
    folder.write("events.jsonl", reset(from(2) - 1));
    live.extend(run_into(&segments, from(2), &config, 6));
    live.extend(run_into(&segments, from(3), &config, 2));
    assert!(
        live[8].contains("learning, 1 of 5") && !live[13].contains("learning"),
        "{live:#?}"
    );
    let logs = raw_logs(&segments);
    assert_eq!(replayed(&config, &logs).0.health(), live);
    // Without the windows that the units were learnt from.
    let (lines, summary) = replayed(&config, &[logs[1].clone(), logs[3].clone()]);
    let not_learnt: Vec<bool> = lines
        .health()
        .iter()
        .map(|line| line.contains("not learnt: "))
        .collect();
    assert_eq!(not_learnt, [true, true, false, false]);
    assert!(!lines.health().iter().any(|line| line.contains("learning")));
    assert_eq!(summary.windows_without_unit, 2);
}

/// A clock that was ahead, and was set right.
#[test]
fn a_later_run_with_earlier_stamps_is_replayed_too() {
    let folder = Folder::new();
    let config = configured(&folder, CONFIG);
    let segments = folder.path("segments");
    let mut live = run_into(&segments, EPOCH_NS + DAY_NS, &config, 3);
    live.extend(run_into(&segments, EPOCH_NS, &config, 2));
    let logs = raw_logs(&segments);
    let (lines, summary) = replayed(&config, &logs);
    assert_eq!((lines.health(), summary.loss()), (live, None));
    // Names that say nothing leave the stamps.
    let copies = ["one.mcap", "two.mcap"].map(|name| folder.path(name));
    for (log, copy) in logs.iter().zip(&copies) {
        std::fs::copy(log, copy).unwrap();
    }
    let loss = replayed(&config, &copies).1.loss().unwrap();
    assert!(loss.contains("frames out of order"), "{loss}");
}

/// By its stamps every window is later than the replacement, by its run those of the first run are not.
#[test]
fn a_replacement_after_the_clock_was_set_back_is_followed_where_the_run_did() {
    let folder = Folder::new();
    let config = configured(
        &folder,
        &format!("[rul]\nstate = \"state\"\nevents = \"events.jsonl\"\n{CONFIG}"),
    );
    let segments = folder.path("segments");
    let mut live = run_into(&segments, EPOCH_NS + DAY_NS, &config, 6);
    folder.write("events.jsonl", reset(EPOCH_NS - 1));
    live.extend(run_into(&segments, EPOCH_NS, &config, 2));
    assert!(live[6].contains("learning, 1 of 5"), "{}", live[6]);
    let (lines, summary) = replayed(&config, &raw_logs(&segments));
    assert_eq!((lines.health(), summary.loss()), (live, None));
    let followed = lines
        .notices()
        .iter()
        .filter(|notice| notice.contains("history reset"))
        .count();
    assert_eq!(followed, 1, "{:#?}", lines.notices());
}
