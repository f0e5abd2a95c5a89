//! Live equals replay: what a run records, replayed, gives the same health records, dropped windows included.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::future::pending;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use ema_models::reference::{Actuations, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::ActuatorId;
use hmd::daemon::Daemon;
use hmd::replay::Replay;
use hmd_core::assess::AssessedWindow;
use hmd_core::config::Config;
use hmd_core::config::Limits;
use hmd_core::frame::{BusNames, FrameFlags, RawFrame};
use hmd_core::record::Status;
use hmd_ingest::feed::Input;
use hmd_ingest::live::LiveSource;
use hmd_lab::simulate::{EPOCH_NS, traffic};
use hmd_storage::clock::now_ns;
use hmd_storage::recorder::{ASSESSED_KEY, Recorder, metadata};

use super::lines::Lines;

const SEED: u64 = 7;

fn config() -> Arc<Config> {
    config_and("")
}

/// The same with further sections.
fn config_and(more: &str) -> Arc<Config> {
    let text = "[type.slow]\nbased_on = \"bench\"\n[type.slow.sensors]\nsample_rate_hz = 400\n\
                [[actuator]]\nid = 0\nname = \"b\"\nbus = \"can1\"\ntype = \"slow\"\n\
                [[actuator]]\nid = 1\nname = \"a\"\nbus = \"can0\"\ntype = \"slow\"\n\
                [identification]\npopulation = 8\ngenerations = 1\n";
    Arc::new(Config::from_toml_str(&format!("{text}{more}"), "hmd.toml").unwrap())
}

/// Traffic of one actuator; its last actuation is cut short.
fn frames(id: u8, actuations: u32) -> Vec<RawFrame> {
    let mut params = ActuatorParams::bench();
    params.sensors.sample_rate = 400.0;
    let scenario = Scenario {
        actuations: Actuations {
            count: actuations,
            ..Actuations::single(Profile::Step)
        },
        ..Scenario::new(params, FaultVector::NOMINAL, u64::from(id))
    };
    let mut frames: Vec<RawFrame> = traffic(&scenario, ActuatorId::new(id).unwrap(), EPOCH_NS).collect();
    frames.truncate(frames.len() - frames.len() / actuations as usize / 3);
    frames
}

fn run(sources: Vec<(&str, Vec<RawFrame>)>, output: &Path) -> (Lines, Status) {
    run_with(config(), sources, output)
}

fn run_with(config: Arc<Config>, sources: Vec<(&str, Vec<RawFrame>)>, output: &Path) -> (Lines, Status) {
    let lines = Lines::default();
    let daemon = Daemon {
        sources: sources
            .into_iter()
            .map(|(name, frames)| {
                let inputs = frames.into_iter().map(Input::Frame);
                (name.to_owned(), LiveSource::Playback(Box::new(inputs)))
            })
            .collect(),
        recorder: Some(Recorder::create(output, &metadata(&config, "test", SEED)).unwrap()),
        watch: Some((config, SEED)),
    };
    let status = daemon.run(pending(), &lines).unwrap();
    (lines, status)
}

fn replayed(log: &Path, output: &Path) -> (Lines, Status) {
    let logs = [PathBuf::from(log)];
    let lines = Lines::default();
    let replay = Replay {
        logs: &logs,
        output: Some(output),
        config: config(),
        seed: SEED,
    };
    let summary = replay.run(&mut &lines).unwrap();
    (lines, summary.status)
}

/// `can1` is named first to the daemon; a replay meets the interfaces in the order of their first frames.
fn sources(actuations: u32) -> Vec<(&'static str, Vec<RawFrame>)> {
    vec![("can1", frames(0, actuations)), ("can0", frames(1, actuations))]
}

fn compare(actuations: u32) -> Status {
    let folder = tempfile::tempdir().unwrap();
    let [live, once, twice] = ["live", "once", "twice"].map(|name| folder.path().join(name).with_extension("mcap"));
    let (lines, status) = run(sources(actuations), &live);
    let health = lines.health();
    assert!(!health.is_empty());
    assert_eq!(status.lost_socket_queue, 0);
    let mut log = live;
    for again in [once, twice] {
        let (lines, replayed) = replayed(&log, &again);
        assert_eq!(lines.health(), health);
        assert_eq!(replayed.lost_windows, status.lost_windows);
        assert_eq!(replayed.frames_received, status.frames_received);
        log = again;
    }
    status
}

#[test]
fn a_run_replays_to_the_same_lines() {
    let status = compare(3);
    assert_eq!(status.lost_windows, 0);
    assert_eq!(
        status.windows_ok + status.windows_degraded + status.windows_invalid + status.windows_unmodelled,
        6
    );
}

/// Health lines of a replay of several logs.
fn lines_of(logs: &[PathBuf]) -> Vec<String> {
    let lines = Lines::default();
    let replay = Replay {
        logs,
        output: None,
        config: config(),
        seed: SEED,
    };
    replay.run(&mut &lines).unwrap();
    lines.health()
}

/// Windows lie across the ends of segments, and the clock steps back at one of them.
#[test]
fn segments_of_one_run_replay_like_one_file() {
    let folder = tempfile::tempdir().unwrap();
    let one = folder.path().join("one.mcap");
    let several = folder.path().join("several");
    let limits = Limits {
        segment_bytes: 1,
        ..Limits::new(1, 3600, 1000, 0)
    };
    // Frames that nothing has assessed.
    let mut metadata = metadata(&config(), "test", SEED);
    metadata.remove(ASSESSED_KEY);
    let mut recorders = [
        Recorder::create(&one, &metadata).unwrap(),
        Recorder::open_folder(&several, &metadata, limits).unwrap(),
    ];
    let mut names = BusNames::new();
    names.intern("can1").unwrap();
    let mut now = Instant::now();
    let mut traffic = frames(0, 4);
    for frame in &mut traffic[800..] {
        frame.stamp_ns -= 100_000_000;
    }
    for part in traffic.chunks(400) {
        for recorder in &mut recorders {
            for frame in part {
                recorder.write_frame(frame, &names).unwrap();
            }
            assert_eq!(recorder.tick(now).unwrap(), []);
        }
        now += Duration::from_secs(1);
    }
    for recorder in recorders {
        recorder.finish().unwrap();
    }
    let entries = std::fs::read_dir(&several).unwrap();
    let mut logs: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    logs.retain(|log| log.to_string_lossy().ends_with("-raw.mcap"));
    logs.sort();
    assert!(logs.len() > 5, "{logs:?}");
    let expected = lines_of(&[one]);
    assert_eq!(expected.len(), 4);
    assert_eq!(lines_of(&logs), expected);
    // Without one of them, what was open ends there.
    logs.remove(logs.len() / 2);
    assert_ne!(lines_of(&logs), expected);
}

#[test]
fn windows_that_were_dropped_are_left_out_by_replay() {
    // Far more at once than can wait: the playback is faster than any identification.
    let status = compare(60);
    assert!(status.lost_windows > 0, "{status:?}");
    assert!(status.data_lost());
}

#[test]
fn a_sample_that_was_filled_in_is_in_no_array_of_the_window() {
    let folder = tempfile::tempdir().unwrap();
    let mut traffic = frames(0, 2);
    let trigger = traffic.len() / 5;
    traffic.remove(trigger);
    // The observer compares the lengths.
    let (lines, status) = run(vec![("can1", traffic)], &folder.path().join("live.mcap"));
    assert_eq!(status.lost_samples, 1);
    let health = lines.health();
    assert!(health[0].contains("1 samples lost"), "{}", health[0]);
}

#[test]
fn a_host_that_reads_late_and_then_a_lot_at_once_spoils_no_window() {
    let folder = tempfile::tempdir().unwrap();
    let mut traffic = frames(0, 2);
    // What came in 300 ms is read at their end; no sample is torn apart.
    const PERIOD_NS: u64 = 2_500_000;
    const STALL_NS: u64 = 300_000_000;
    for frame in &mut traffic {
        let sampled_ns = (frame.stamp_ns - EPOCH_NS) / PERIOD_NS * PERIOD_NS;
        frame.stamp_ns = EPOCH_NS + sampled_ns.next_multiple_of(STALL_NS);
    }
    let (lines, _) = run(vec![("can1", traffic)], &folder.path().join("live.mcap"));
    let health = lines.health();
    let reason = &health[0];
    // A step at 400 Hz shows no friction before the unit is commissioned; nothing else may be said.
    let said = reason.contains("\"reason\":");
    let friction = reason.contains("\"reason\":\"too uncertain: friction ");
    assert!((friction || !said) && !reason.contains("; "), "{reason}");
}

#[test]
fn a_bus_state_is_reported_live_and_in_replay() {
    let folder = tempfile::tempdir().unwrap();
    let [live, again] = ["live", "again"].map(|name| folder.path().join(name).with_extension("mcap"));
    let mut traffic = frames(0, 1);
    let bus_off = RawFrame::new(traffic[9].stamp_ns, 0, 0x40, FrameFlags::ERROR, &[0; 8]).unwrap();
    traffic.insert(10, bus_off);
    let (lines, status) = run(vec![("can1", traffic)], &live);
    let reported = ["can1: bus bus-off", "can1: bus error-active"];
    assert_eq!(lines.notices(), reported);
    assert_eq!(
        (status.frames_error, status.interfaces[0].bus_state.as_str()),
        (1, "error-active")
    );
    let (lines, _) = replayed(&live, &again);
    assert_eq!(lines.notices(), reported);
}

#[test]
fn a_trouble_that_comes_with_every_window_is_reported_ten_times_a_minute() {
    let folder = tempfile::tempdir().unwrap();
    let events = folder.path().join("events.jsonl");
    std::fs::write(&events, "no event\n").unwrap();
    let config = config_and(&format!("[rul]\nevents = \"{}\"\n", events.display()));
    let (mut traffic, now_ns) = (frames(0, 14), now_ns());
    for frame in &mut traffic {
        frame.stamp_ns = frame.stamp_ns - EPOCH_NS + now_ns;
    }
    let (lines, _) = run_with(config, vec![("can1", traffic)], &folder.path().join("live.mcap"));
    assert_eq!(lines.health().len(), 14);
    let notices = lines.notices();
    let reported: Vec<_> = notices
        .iter()
        .filter(|text| text.contains("maintenance event"))
        .collect();
    assert_eq!(reported.len(), 11, "{reported:?}");
    assert!(
        reported[10].contains("(the last of 4 not reported)"),
        "{}",
        reported[10]
    );
}

#[test]
fn a_stopped_daemon_ends_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let live = folder.path().join("live.mcap");
    let lines = Lines::default();
    let daemon = Daemon {
        sources: Vec::new(),
        recorder: Some(Recorder::create(&live, &metadata(&config(), "test", SEED)).unwrap()),
        watch: Some((config(), SEED)),
    };
    daemon.run(async {}, &lines).unwrap();
    let bytes = std::fs::read(&live).unwrap();
    assert!(bytes.ends_with(mcap::MAGIC), "a footer stands at the end");
}

/// A restart or a reload begins another run in the folder: what is stored is what a replay of all its raw frames gives.
#[test]
fn a_folder_with_two_runs_replays_to_the_lines_of_both() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("segments");
    let state = root.path().join("state");
    let config = config_and(&format!("[rul]\nstate = \"{}\"\n", state.display()));
    let mut live = Vec::new();
    for later_ns in [0, 60_000_000_000] {
        let mut traffic = frames(0, 3);
        for frame in &mut traffic {
            frame.stamp_ns += later_ns;
        }
        let inputs = traffic.into_iter().map(Input::Frame);
        let lines = Lines::default();
        let limits = Limits::new(1, 3600, 1000, 0);
        let daemon = Daemon {
            sources: vec![("can1".to_owned(), LiveSource::Playback(Box::new(inputs)))],
            recorder: Some(Recorder::open_folder(&folder, &metadata(&config, "test", SEED), limits).unwrap()),
            watch: Some((config.clone(), SEED)),
        };
        daemon.run(pending(), &lines).unwrap();
        live.extend(lines.health());
    }
    assert_eq!(
        live.iter().filter(|line| line.contains("\"window\":0,")).count(),
        2,
        "{live:?}"
    );
    let entries = std::fs::read_dir(&folder).unwrap();
    let mut logs: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    logs.retain(|log| log.to_string_lossy().ends_with("-raw.mcap"));
    logs.sort();
    assert_eq!(logs.len(), 2);
    assert_eq!(lines_of(&logs), live);
}

/// Hours of operation after each window.
#[derive(Default)]
struct Hours(Mutex<Vec<f64>>);

impl hmd::daemon::Observer for Hours {
    fn assessed(&self, assessed: &AssessedWindow) -> io::Result<()> {
        self.0.lock().unwrap().extend(assessed.rul.operating_h);
        Ok(())
    }
    fn notice(&self, _: &str) {}
}

impl hmd::replay::Observer for &Hours {
    fn assessed(&mut self, assessed: &AssessedWindow) -> io::Result<()> {
        hmd::daemon::Observer::assessed(*self, assessed)
    }
    fn notice(&mut self, _: &str) {}
    fn progress(&mut self, _: u64) {}
}

/// Operation goes on after the last window of a run.
#[test]
fn hours_of_operation_go_on_from_run_to_run_as_in_a_replay() {
    let folder = tempfile::tempdir().unwrap();
    let (segments, state) = (folder.path().join("segments"), folder.path().join("state"));
    let config = config_and(&format!("[rul]\nstate = {state:?}\n"));
    let live = Hours::default();
    for n in 0..3 {
        let mut traffic = frames(0, 3);
        for frame in &mut traffic {
            frame.stamp_ns += n * 60_000_000_000;
        }
        let playback = LiveSource::Playback(Box::new(traffic.into_iter().map(Input::Frame)));
        let limits = Limits::new(1_000_000, 3600, 1000, 0);
        let daemon = Daemon {
            sources: vec![("can1".to_owned(), playback)],
            recorder: Some(Recorder::open_folder(&segments, &metadata(&config, "test", SEED), limits).unwrap()),
            watch: Some((config.clone(), SEED)),
        };
        daemon.run(pending(), &live).unwrap();
    }
    let entries = std::fs::read_dir(&segments).unwrap();
    let mut logs: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    logs.retain(|log| log.to_string_lossy().ends_with("-raw.mcap"));
    logs.sort();
    let replayed = Hours::default();
    let replay = Replay {
        logs: &logs,
        output: None,
        config,
        seed: SEED,
    };
    replay.run(&mut &replayed).unwrap();
    let (live, replayed) = (live.0.into_inner().unwrap(), replayed.0.into_inner().unwrap());
    assert_eq!(live, replayed);
    // Each run is like the first, and longer than to its last window.
    let [first, second, third] = [live[2], live[5] - live[2], live[8] - live[5]];
    assert!((third - second).abs() < 1e-9 && second >= first, "{live:?}");
}
