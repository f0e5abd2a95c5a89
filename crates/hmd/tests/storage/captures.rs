//! Frames around windows that matter, of a run that does not store all.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use hmd::daemon::{ENDING_MAX, HostClock, Observer, Steps};
use hmd_core::assess::{AssessedWindow, Identification};
use hmd_core::deadline::Clock;
use hmd_core::frame::{BusNames, RawFrame};
use hmd_core::history::{Event, EventKind};
use hmd_core::record::{Health, Status};
use hmd_ingest::feed::Input;
use hmd_ingest::file::open;
use hmd_storage::config_file::load_config;
use hmd_storage::event_file;
use hmd_storage::mcap_writer::METADATA_NAME;
use hmd_storage::recorder::{Recorder, metadata};

use super::{hmd, hmd_with_code};

/// Time of the frames that were given.
pub(super) struct FrameClock {
    start: Instant,
    start_ns: u64,
    pub(super) now_ns: AtomicU64,
}

impl Clock for FrameClock {
    fn now(&self) -> Duration {
        Duration::from_nanos(self.now_ns.load(Relaxed) - self.start_ns)
    }
}

impl HostClock for FrameClock {
    fn instant(&self) -> Instant {
        self.start + self.now()
    }

    fn utc_ns(&self) -> u64 {
        self.now_ns.load(Relaxed)
    }
}

/// Such a clock that stands at a time, UTC ns.
pub(super) fn clock_from(start_ns: u64) -> FrameClock {
    FrameClock {
        start: Instant::now(),
        start_ns,
        now_ns: AtomicU64::new(start_ns),
    }
}

/// What a run said.
#[derive(Default)]
struct Said {
    healths: Mutex<Vec<Health>>,
    notices: Mutex<Vec<String>>,
    /// Samples so far and health, in each status record.
    statuses: Mutex<Vec<(u64, String)>>,
}

impl Observer for Said {
    fn assessed(&self, assessed: &AssessedWindow) -> io::Result<()> {
        self.healths.lock().unwrap().push(assessed.health.clone());
        Ok(())
    }

    fn notice(&self, message: &str) {
        self.notices.lock().unwrap().push(message.to_owned());
    }

    fn status(&self, status: &Status) {
        let health = status.actuators.first().map(|actuator| actuator.health.clone());
        self.statuses
            .lock()
            .unwrap()
            .push((status.samples, health.unwrap_or_default()));
    }
}

/// Segments of raw frames, each with the reason of its capture and its frames.
fn captures(folder: &Path) -> Vec<(PathBuf, String, Vec<RawFrame>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.to_str().is_some_and(|path| path.ends_with("-raw.mcap")) {
            let mut source = open(&path).unwrap();
            let frames = source.by_ref().map(Result::unwrap).collect();
            let why = source.metadata(METADATA_NAME).unwrap()["capture"].clone();
            found.push((path, why, frames));
        }
    }
    found.sort_by(|a, b| a.0.cmp(&b.0));
    found
}

/// Runs the daemon over the frames of a log, with a request for frames when so much of it has passed.
fn run(root: &Path, log: &Path, request_at: Duration) -> (Said, Vec<RawFrame>) {
    let config = Arc::new(load_config(root.join("hmd.toml")).unwrap());
    let mut source = open(log).unwrap();
    let frames: Vec<RawFrame> = source.by_ref().map(Result::unwrap).collect();
    let names = source.into_bus_names();
    let start_ns = frames[0].stamp_ns;
    let clock = clock_from(start_ns);
    let said = Said::default();
    let recorder = Recorder::open_folder(
        &root.join("segments"),
        &metadata(&config, "host", 1),
        config.output().limits(),
    )
    .unwrap();
    let watch = Some((config, 1));
    let mut steps = Steps::new(names, Some(recorder), watch, Arc::new(Identification), &clock, &said).unwrap();
    let (mut tick_ns, mut asked) = (start_ns, false);
    for frame in &frames {
        clock.now_ns.store(frame.stamp_ns, Relaxed);
        let mut inputs = vec![Input::Frame(*frame)];
        if !asked && clock.now() >= request_at {
            asked = true;
            let event = Event {
                t_ns: clock.utc_ns(),
                actuator: "ema0".to_owned(),
                event: EventKind::Keep,
                part: None,
                note: Some("noise heard".to_owned()),
            };
            event_file::append(&root.join("events.jsonl"), &event).unwrap();
        }
        if frame.stamp_ns >= tick_ns {
            tick_ns += 1_000_000_000;
            inputs.push(Input::Tick {
                stamp_ns: frame.stamp_ns,
            });
        }
        steps.take(&mut inputs).unwrap();
        while steps.assess().unwrap() {}
    }
    let status = steps.finish(ENDING_MAX).unwrap();
    assert_eq!((status.lost_storage_frames, status.lost_storage_records), (0, 0));
    (said, frames)
}

#[test]
fn frames_around_a_window_whose_health_got_worse_are_kept_and_those_asked_for_and_no_others() {
    let root = tempfile::tempdir().unwrap();
    let text = "[output]\nraw_frames = false\ncapture_before_s = 0.5\ncapture_after_s = 0.2\n\
                [rul]\nevents = \"events.jsonl\"\nstate = \"histories\"\n\
                [type.slow]\nbased_on = \"bench\"\n[type.slow.sensors]\nsample_rate_hz = 400\n\
                [[actuator]]\nid = 0\nname = \"ema0\"\ntype = \"slow\"\n";
    std::fs::write(root.path().join("hmd.toml"), text).unwrap();
    hmd(
        root.path(),
        "simulate --rate 400 --windows 20 --fault backlash=0.7 --seed 4 -o worn.log",
    );
    let (said, all) = run(root.path(), &root.path().join("worn.log"), Duration::from_secs(12));
    let healths = said.healths.into_inner().unwrap();
    assert_eq!(healths.len(), 20);

    let kept = captures(&root.path().join("segments"));
    let reasons: Vec<&str> = kept.iter().map(|(_, why, _)| why.as_str()).collect();
    let expected = [
        "ema0: window 0: unknown to critical",
        "ema0: asked for by hmd event --keep: noise heard",
    ];
    assert_eq!(reasons, expected);
    let around = |from_ns: u64, to_ns: u64| {
        let wanted = from_ns - 500_000_000..=to_ns + 200_000_000;
        let within = all.iter().filter(|frame| wanted.contains(&frame.stamp_ns));
        within.copied().collect::<Vec<_>>()
    };
    let first = &healths[0];
    // Up to the sample after the last.
    assert_eq!(kept[0].2, around(first.t_start_ns, first.t_start_ns + 502_400_000));
    let asked = event_file::read(&root.path().join("events.jsonl")).unwrap().list[0].t_ns;
    assert_eq!(kept[1].2, around(asked, asked));

    let notices = said.notices.into_inner().unwrap();
    for (path, why, _) in &kept {
        let name = path.file_name().unwrap().to_str().unwrap();
        let told = format!("storage: frames kept in {name}: {why}");
        assert!(notices.contains(&told), "{told}: {notices:?}");
    }
    // A changed health is not held back until the next status record is due, ten seconds after the first.
    let statuses = said.statuses.into_inner().unwrap();
    let critical = statuses.iter().find(|(_, health)| health == "critical").unwrap();
    assert!(
        critical.0 < 3 * 400,
        "after {} samples at 400 Hz: {statuses:?}",
        critical.0
    );

    // The daemon that starts next knows it before it sees any window, and a replay does not.
    let config = Arc::new(load_config(root.path().join("hmd.toml")).unwrap());
    let clock = clock_from(0);
    let (names, next) = (BusNames::new(), Said::default());
    let steps = Steps::new(names, None, Some((config, 1)), Arc::new(Identification), &clock, &next).unwrap();
    let resumed = steps.status().actuators;
    assert_eq!(
        resumed.iter().map(|actuator| &actuator.health).collect::<Vec<_>>(),
        [&healths[19].health]
    );
    assert_ne!(healths[19].health, "unknown");

    // The capture alone is enough for the same verdict.
    let line = format!("replay --json -c hmd.toml {}", kept[0].0.display());
    let again: serde_json::Value = serde_json::from_str(hmd(root.path(), &line).trim()).unwrap();
    assert_eq!(again["t_start_ns"], first.t_start_ns);
    assert_eq!(again["k"][0], first.k1.unwrap());
    assert_eq!(again["health"], "critical");
    // All captures in one replay: what was not kept between them is not lost.
    let both = hmd(root.path(), "replay --json -c hmd.toml segments/");
    let starts: Vec<u64> = healths.iter().map(|health| health.t_start_ns).collect();
    for line in both.lines() {
        let window: serde_json::Value = serde_json::from_str(line).unwrap();
        // A capture may begin in the motion before.
        let reason = window["reason"].as_str().unwrap_or_default();
        let is_cut = window["status"] == "invalid" && reason.starts_with("start in motion");
        assert!(
            is_cut || starts.contains(&window["t_start_ns"].as_u64().unwrap()),
            "{line}"
        );
        assert_eq!(window["suspects"], serde_json::Value::Null, "{line}");
    }
}

#[test]
fn windows_left_at_the_end_of_a_run_are_recorded_and_a_replay_leaves_them_out() {
    let root = tempfile::tempdir().unwrap();
    let text = "[type.slow]\nbased_on = \"bench\"\n[type.slow.sensors]\nsample_rate_hz = 400\n\
                [[actuator]]\nid = 0\nname = \"ema0\"\ntype = \"slow\"\n";
    std::fs::write(root.path().join("hmd.toml"), text).unwrap();
    hmd(root.path(), "simulate --rate 400 --windows 5 --seed 4 -o some.log");
    let config = Arc::new(load_config(root.path().join("hmd.toml")).unwrap());
    let mut source = open(&root.path().join("some.log")).unwrap();
    let mut inputs: Vec<Input> = source.by_ref().map(|frame| Input::Frame(frame.unwrap())).collect();
    let (clock, said) = (clock_from(1), Said::default());
    let about = metadata(&config, "host", 1);
    let recorder = Recorder::open_folder(&root.path().join("segments"), &about, config.output().limits()).unwrap();
    let (names, watch) = (source.into_bus_names(), Some((config, 1)));
    let mut steps = Steps::new(names, Some(recorder), watch, Arc::new(Identification), &clock, &said).unwrap();
    steps.take(&mut inputs).unwrap();
    for _ in 0..2 {
        assert!(steps.assess().unwrap());
    }
    let status = steps.finish(Duration::ZERO).unwrap();
    assert_eq!(status.lost_windows, 3);
    let starts = said
        .healths
        .lock()
        .unwrap()
        .iter()
        .map(|health| health.t_start_ns)
        .collect::<Vec<_>>();
    assert_eq!(starts.len(), 2);
    let again = hmd_with_code(root.path(), "replay --json -c hmd.toml segments/", 3);
    let again = again
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let again: Vec<u64> = again.map(|window| window["t_start_ns"].as_u64().unwrap()).collect();
    assert_eq!(again, starts);
}

#[test]
fn a_request_that_no_daemon_saw_is_answered_by_the_next_and_by_no_other() {
    let root = tempfile::tempdir().unwrap();
    let text = "[output]\nraw_frames = false\n[rul]\nevents = \"events.jsonl\"\n\
                [type.slow]\nbased_on = \"bench\"\n[type.slow.sensors]\nsample_rate_hz = 400\n\
                [[actuator]]\nid = 0\nname = \"ema0\"\ntype = \"slow\"\n";
    std::fs::write(root.path().join("hmd.toml"), text).unwrap();
    hmd(root.path(), "simulate --rate 400 --windows 3 --seed 4 -o some.log");
    let config = Arc::new(load_config(root.path().join("hmd.toml")).unwrap());
    let mut source = open(&root.path().join("some.log")).unwrap();
    let frames: Vec<RawFrame> = source.by_ref().map(Result::unwrap).collect();
    let names = source.into_bus_names();
    let start_ns = frames[0].stamp_ns;
    // What a run says that begins then, with these frames; nobody assesses them.
    let said_from = |begins_ns: u64, frames: &[RawFrame]| {
        let (clock, said) = (clock_from(begins_ns), Said::default());
        let about = metadata(&config, "host", 1);
        let recorder = Recorder::open_folder(&root.path().join("out"), &about, config.output().limits()).unwrap();
        let watch = Some((config.clone(), 1));
        let estimator = Arc::new(Identification);
        let mut steps = Steps::new(names.clone(), Some(recorder), watch, estimator, &clock, &said).unwrap();
        let stamp_ns = begins_ns + 1_000_000;
        steps.take(&mut vec![Input::Tick { stamp_ns }]).unwrap();
        for frame in frames {
            clock.now_ns.store(frame.stamp_ns, Relaxed);
            steps.take(&mut vec![Input::Frame(*frame)]).unwrap();
        }
        steps.finish(Duration::ZERO).unwrap();
        let mut notices = said.notices.into_inner().unwrap();
        notices.retain(|notice| notice.contains("hmd event --keep"));
        notices
    };
    assert_eq!(said_from(start_ns - 60_000_000_000, &[]), [] as [&str; 0]);
    for (ago_ns, note) in [(30_000_000_000, "early"), (300_000_000, "late")] {
        let event = Event {
            t_ns: start_ns - ago_ns,
            actuator: "ema0".to_owned(),
            event: EventKind::Keep,
            part: None,
            note: Some(note.to_owned()),
        };
        event_file::append(&root.path().join("events.jsonl"), &event).unwrap();
    }
    let asked = "ema0: asked for by hmd event --keep";
    let said = said_from(start_ns, &frames);
    let expected = [
        format!("frames wanted: {asked}: early; they are no longer there"),
        format!("frames wanted: {asked}: late; those of the time itself are no longer there, later ones are kept"),
    ];
    assert_eq!(said[..2], expected, "{said:?}");
    assert!(
        said[2].starts_with("storage: frames kept in ") && said[2].ends_with("late"),
        "{said:?}"
    );
    assert_eq!(said.len(), 3, "{said:?}");
    let after_s = |ns: u64| start_ns + ns * 1_000_000_000;
    assert_eq!(said_from(after_s(60), &[]), [] as [&str; 0]);
}
