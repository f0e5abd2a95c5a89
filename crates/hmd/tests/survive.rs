//! kill -9 at random moments under load: what was told as written is read back, and every restart works.
//!
//! Requirements S-1 and S-3 of `docs/safety.md`. The page cache outlives the process, so this does not show that a power
//! cut is survived. The load is the whole live chain, daemon, identification and store, in a process of its own (this
//! test program, started again), on frames from memory as fast as they are taken.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::future::pending;
use std::io::{self, BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::{Arc, mpsc};
use std::time::Duration;

use ema_models::reference::{Actuations, Scenario};
use ema_models::{ActuatorParams, FaultVector, Profile};
use ema_wire::ActuatorId;
use hmd::config::Config;
use hmd::daemon::{Daemon, Observer};
use hmd::frame::{BusNames, RawFrame};
use hmd::ingest::candump::{Decimals, emit};
use hmd::ingest::live::LiveSource;
use hmd::ingest::{McapFrames, McapMessages};
use hmd::judge::Judged;
use hmd::record::{Health, Record};
use hmd::recorder::{Recorder, metadata};
use hmd::seed::mix;
use hmd::simulate::{EPOCH_NS, traffic};
use hmd::store::Limits;
use prost::Message;

/// Names the folder for the process that writes; the number of the run follows.
const FOLDER: &str = "HMD_SURVIVE_FOLDER";
const RUN: &str = "HMD_SURVIVE_RUN";

/// File of the load, in the folder.
const LOAD: &str = "load.log";

/// Set where the disk is meant to fail.
const FAILING: &str = "HMD_SURVIVE_FAILING";

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
fn write_load(log: &Path) {
    let mut params = ActuatorParams::bench();
    params.sensors.sample_rate = 400.0;
    let scenario = Scenario {
        actuations: Actuations {
            count: 40,
            ..Actuations::one(Profile::Step)
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
    let frames = hmd::ingest::open(log).unwrap().map(Result::unwrap);
    let shifted = frames.map(|mut frame| {
        frame.stamp_ns += run * 86_400_000_000_000;
        frame
    });
    shifted.collect()
}

/// Says each health record as soon as the daemon says that it is stored.
struct Teller;

impl Observer for Teller {
    fn judged(&self, judged: &Judged) -> io::Result<()> {
        let line = format!("stored {} {}\n", judged.health.t_start_ns, judged.health.window);
        io::stderr().write_all(line.as_bytes())
    }

    fn unstored(&self, _: &Judged) -> io::Result<()> {
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

#[test]
#[ignore = "the process that the others start and kill"]
fn writer() {
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
    let daemon = Daemon {
        sources: vec![("can0".to_owned(), LiveSource::Playback(frames(&log, run)))],
        recorder: Some(recorder),
        watch: Some((config, run)),
    };
    daemon.run(pending(), &Teller).unwrap();
    eprintln!("ended");
}

/// This program again, as the writer.
fn writer_of(folder: &Path, run: u64) -> Command {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command
        .args(["writer", "--exact", "--ignored", "--nocapture", "--test-threads=1"])
        .env(FOLDER, folder)
        .env(RUN, run.to_string());
    command
}

/// Starts the writer and kills it after `wait`, or lets it come to its end without; what it told as stored, and whether it came to its end.
fn killed(folder: &Path, run: u64, wait: Option<Duration>) -> (Vec<(u64, u64)>, bool) {
    let mut child = writer_of(folder, run)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let said = BufReader::new(child.stderr.take().unwrap());
    let (first, stored_first) = mpsc::channel();
    let reader = std::thread::spawn(move || {
        let mut text = String::new();
        for line in said.split(b'\n') {
            let line = String::from_utf8(line.unwrap()).unwrap();
            if line.starts_with("stored") {
                // Nobody may wait for it.
                let _ = first.send(());
            }
            text += &line;
            text.push('\n');
        }
        text
    });
    if let Some(wait) = wait {
        if run % 2 == 1 {
            // Half of the kills come in the thick of it, the others at any moment from the start of the process.
            stored_first.recv_timeout(Duration::from_secs(60)).unwrap();
        }
        std::thread::sleep(wait);
        // SIGKILL.
        child.kill().unwrap();
    }
    child.wait().unwrap();
    let text = reader.join().unwrap();
    assert!(!text.contains("panicked"), "run {run}: {text}");
    // One write for each line, so none is torn.
    let stored = text.lines().filter_map(|line| {
        let (start, window) = line.strip_prefix("stored ")?.split_once(' ')?;
        Some((start.parse().unwrap(), window.parse().unwrap()))
    });
    (stored.collect(), text.contains("ended"))
}

/// Health records in the folder by start and number; every closed segment must be whole, and no frame missing within
/// a run but those that were never synced.
fn read(folder: &Path) -> BTreeMap<(u64, u64), u64> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.display().to_string();
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

fn survives(kills: u64, longest: Duration) {
    let folder = tempfile::tempdir().unwrap();
    write_load(&folder.path().join(LOAD));
    let mut stored = BTreeSet::new();
    let mut ended = 0;
    for run in 0..kills {
        let wait = Duration::from_nanos(mix(13, &[run]) % longest.as_nanos() as u64);
        let (told, came_to_end) = killed(folder.path(), run, Some(wait));
        stored.extend(told);
        ended += u64::from(came_to_end);
    }
    // The last start repairs what the last kill left, and ends in order.
    let (told, came_to_end) = killed(folder.path(), kills, None);
    assert!(came_to_end, "{told:?}");
    let told_last = told.len() as u64;
    stored.extend(told);
    let found = read(&folder.path().join("segments"));
    let missing: Vec<_> = stored.iter().filter(|key| !found.contains_key(key)).collect();
    eprintln!(
        "{kills} kills, {ended} of them after the end: {} records told as stored, {} found",
        stored.len(),
        found.len()
    );
    assert_eq!(missing, [] as [&(u64, u64); 0], "told as stored and not found");
    assert!(found.values().all(|count| *count == 1), "no record twice");
    let of_killed = stored.len() as u64 - told_last;
    assert!(of_killed > kills, "{of_killed} records are no load");
}

#[test]
fn a_handful_of_kills_costs_nothing_that_was_stored() {
    survives(6, Duration::from_millis(1500));
}

#[test]
#[ignore = "minutes; cargo xtask survive"]
fn five_hundred_kills_cost_nothing_that_was_stored() {
    survives(500, Duration::from_millis(1500));
}

/// A file system of its own that somebody fills and empties again. Needs root, for the mount.
#[test]
#[ignore = "needs root; cargo xtask survive"]
fn a_disk_that_is_really_full_for_a_while_ends_nothing() {
    let folder = tempfile::tempdir().unwrap();
    write_load(&folder.path().join(LOAD));
    for name in ["segments", "kept"] {
        std::fs::create_dir(folder.path().join(name)).unwrap();
    }
    let writer = writer_of(folder.path(), 0);
    // One actuation takes some tenths of a second to identify, so the run is in the midst of it.
    let script = "mount -t tmpfs -o size=4m none segments && { \"$@\" & } && sleep 1.5 && \
                  { cat /dev/zero > segments/full; ls -l segments >&2; sleep 2; rm segments/full; wait && cp segments/hmd-* kept; }";
    let output = Command::new("unshare")
        .args(["--mount", "sh", "-c", script, "sh"])
        .arg(writer.get_program())
        .args(writer.get_args())
        .envs(writer.get_envs().filter_map(|(key, value)| Some((key, value?))))
        .env(FAILING, "1")
        .current_dir(folder.path())
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    eprintln!("{said}");
    assert!(output.status.success() && said.contains("ended"), "{said}");
    // The next start repairs the segments that were given up.
    let kept = folder.path().join("kept");
    let next = Recorder::open_folder(&kept, &BTreeMap::new(), Limits::new(1, 60, 1000, 0)).unwrap();
    next.finish().unwrap();
    let found = read(&kept);
    let (mut stored, mut after, mut lost) = (0, 0, 0);
    for line in said.lines() {
        if line == "unstored" {
            lost += 1;
        } else if let Some((start, window)) = line.strip_prefix("stored ").and_then(|line| line.split_once(' ')) {
            let is_there = found.contains_key(&(start.parse().unwrap(), window.parse().unwrap()));
            assert!(is_there, "told as stored and not found: {line}");
            stored += 1;
            after += u32::from(lost > 0);
        }
    }
    eprintln!("{stored} records stored and found, {after} of them after the disk was full; {lost} lost and told so");
    assert!(lost > 0, "the disk was never full");
    assert!(after > 0, "no record after the disk was full");
    assert!(said.contains("No space left on device") && said.contains("written again"));
}
