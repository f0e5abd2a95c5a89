//! The load that is killed, what it reports, and what is read back.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::future::pending;
use std::io::{self, Write};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use ema_models::reference::{Actuations, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::ActuatorId;
use hmd::daemon::{Daemon, Observer};
use hmd::replay::{self, Replay};
use hmd_core::assess::AssessedWindow;
use hmd_core::config::Config;
use hmd_core::config::Limits;
use hmd_core::frame::{BusNames, RawFrame};
use hmd_core::record::{Health, Record};
use hmd_ingest::candump::{Decimals, emit};
use hmd_ingest::feed::Input;
use hmd_ingest::live::LiveSource;
use hmd_lab::simulate::{EPOCH_NS, traffic};
use hmd_storage::mcap::{McapFrames, McapMessages};
use hmd_storage::recorder::{Recorder, metadata};
use hmd_storage::segment_store::raw_segments;
use prost::Message;

/// Names the folder for the process that writes; the number of the run follows.
pub(crate) const FOLDER: &str = "HMD_SURVIVE_FOLDER";
pub(crate) const RUN: &str = "HMD_SURVIVE_RUN";

/// File of the load, in the folder.
pub(crate) const LOAD: &str = "load.log";

/// The test that is the writer.
pub(crate) const WRITER: &str = "writer";

/// Set where frames come at a pace that identification can follow, so that records are written all the time.
pub(crate) const PACED: &str = "HMD_SURVIVE_PACED";

/// Frames between two pauses, and the pause, which a guest makes some longer.
const PACE: (usize, Duration) = (256, Duration::from_millis(10));

/// Set where the disk is meant to fail.
pub(crate) const FAILING: &str = "HMD_SURVIVE_FAILING";

fn config() -> Arc<Config> {
    let text = "[type.slow]\nbased_on = \"bench\"\n[type.slow.sensors]\nsample_rate_hz = 400\n\
                [[actuator]]\nid = 0\nbus = \"can0\"\ntype = \"slow\"\n\
                [identification]\npopulation = 8\ngenerations = ";
    // A slow search where somebody has to fill the disk meanwhile.
    let search = if std::env::var(FAILING).is_ok() {
        "1000\nevaluations_max = 5000"
    } else {
        "1\nevaluations_max = 100"
    };
    Arc::new(Config::from_toml_str(&format!("{text}{search}\n"), "hmd.toml").unwrap())
}

/// The load, made once: actuations of one actuator, a second apart.
pub(crate) fn write_load(log: &Path, count: u32) {
    let mut params = ActuatorParams::bench();
    params.sensors.sample_rate = 400.0;
    let scenario = Scenario {
        actuations: Actuations {
            count,
            ..Actuations::single(Profile::Step)
        },
        ..Scenario::new(params, FaultVector::NOMINAL, 1)
    };
    let mut text = Vec::new();
    for frame in traffic(&scenario, ActuatorId::new(0).unwrap(), EPOCH_NS) {
        emit(&frame, "can0", Decimals::Nine, &mut text);
    }
    std::fs::write(log, text).unwrap();
}

/// The load as of another day for each run, so that every record of every run is another.
fn frames(log: &Path, run: u64) -> Vec<RawFrame> {
    let frames = hmd_ingest::file::open(log).unwrap().map(Result::unwrap);
    let shifted = frames.map(|mut frame| {
        frame.stamp_ns += run * 86_400_000_000_000;
        frame
    });
    shifted.collect()
}

/// Says each health record as soon as the daemon says that it is stored.
struct StderrReporter;

impl Observer for StderrReporter {
    fn assessed(&self, assessed: &AssessedWindow) -> io::Result<()> {
        let line = format!("stored {} {}\n", assessed.health.t_start_ns, assessed.health.window);
        io::stderr().write_all(line.as_bytes())
    }

    fn assessed_unstored(&self, _: &AssessedWindow) -> io::Result<()> {
        io::stderr().write_all(b"unstored\n")
    }

    fn notice(&self, message: &str) {
        assert!(
            !message.contains("tried again") || std::env::var(FAILING).is_ok(),
            "{message}"
        );
        eprintln!("{message}");
    }
}

/// The process that is killed: writes as the environment says, and reports on stderr.
pub(crate) fn write() {
    let Ok(folder) = std::env::var(FOLDER) else { return };
    let run: u64 = std::env::var(RUN).unwrap().parse().unwrap();
    let config = config();
    // Small segments, so that kills hit their ends as well.
    let limits = Limits {
        segment_bytes: 30_000,
        ..Limits::new(1, 1, 10_000, 0)
    };
    let (folder, log) = (Path::new(&folder).join("segments"), Path::new(&folder).join(LOAD));
    let recorder = Recorder::open_folder(&folder, &metadata(&config, "test", run), limits).unwrap();
    let paced = std::env::var(PACED).is_ok();
    let frames = frames(&log, run).into_iter().enumerate().map(move |(n, frame)| {
        if paced && n.is_multiple_of(PACE.0) {
            std::thread::sleep(PACE.1);
        }
        Input::Frame(frame)
    });
    let daemon = Daemon {
        sources: vec![("can0".to_owned(), LiveSource::Playback(Box::new(frames)))],
        recorder: Some(recorder),
        watch: Some((config, run)),
    };
    daemon.run(pending(), &StderrReporter).unwrap();
    eprintln!("ended");
}

/// This program again, as the writer.
pub(crate) fn writer_of(folder: &Path, run: u64) -> Command {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command
        .args([WRITER, "--exact", "--ignored", "--nocapture", "--test-threads=1"])
        .env(FOLDER, folder)
        .env(RUN, run.to_string());
    command
}

/// Health records in the folder by start and number; every closed segment must be whole, and no frame missing within
/// a run but those that were never synced.
pub(crate) fn read(folder: &Path) -> BTreeMap<(u64, u64), u64> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.display().to_string();
        if is_left_by_a_cut(&path) {
            continue;
        }
        assert!(name.ends_with(".mcap"), "{name} is left over");
        for message in McapMessages::new(File::open(&path).unwrap(), &name).unwrap() {
            let message = message.unwrap();
            if *message.schema == *Health::SCHEMA_NAME {
                let health = Health::decode(message.data.as_slice()).unwrap();
                *found.entry((health.t_start_ns, health.window)).or_default() += 1;
            }
        }
        if name.ends_with("-raw.mcap") {
            let frames = McapFrames::new(File::open(&path).unwrap(), &name, BusNames::new()).unwrap();
            frames.for_each(|frame| assert!(frame.is_ok(), "{frame:?}"));
        }
    }
    found
}

/// Start and number of each window that a replay of the folder gives.
pub(crate) fn replayed(folder: &Path) -> BTreeSet<(u64, u64)> {
    #[derive(Default)]
    struct Windows(BTreeSet<(u64, u64)>);
    impl replay::Observer for Windows {
        fn assessed(&mut self, assessed: &AssessedWindow) -> io::Result<()> {
            self.0.insert((assessed.health.t_start_ns, assessed.health.window));
            Ok(())
        }

        fn notice(&mut self, _: &str) {}

        fn progress(&mut self, _: u64) {}
    }
    let logs: Vec<_> = raw_segments(folder)
        .unwrap()
        .into_values()
        .map(|raw| raw.path)
        .collect();
    let mut windows = Windows::default();
    let replay = Replay {
        logs: &logs,
        output: None,
        config: config(),
        seed: 1,
    };
    replay.run(&mut windows).unwrap();
    windows.0
}

/// Whether a segment ended before it had a header, or in its first chunk: nothing in it had been synced, and neither is
/// removed by a start.
fn is_left_by_a_cut(path: &Path) -> bool {
    match path.extension().and_then(|end| end.to_str()) {
        Some("part") => std::fs::metadata(path).unwrap().len() == 0,
        Some("damaged") => {
            let mut messages = McapMessages::new(File::open(path).unwrap(), "damaged").unwrap();
            !messages.any(|message| message.is_ok())
        }
        _ => false,
    }
}

/// Start and number of the window that a line reports as stored, if it is whole.
pub(crate) fn stored(line: &str) -> Option<(u64, u64)> {
    let (start, window) = line.strip_prefix("stored ")?.split_once(' ')?;
    Some((start.parse().ok()?, window.parse().ok()?))
}

/// Asserts that everything reported as stored was found, once; how many were found.
pub(crate) fn compare(stored: &BTreeSet<(u64, u64)>, folder: &Path) -> usize {
    let found = read(folder);
    let missing: Vec<_> = stored.iter().filter(|key| !found.contains_key(key)).collect();
    assert_eq!(missing, [] as [&(u64, u64); 0], "reported as stored and not found");
    assert!(found.values().all(|count| *count == 1), "no record twice");
    found.len()
}
