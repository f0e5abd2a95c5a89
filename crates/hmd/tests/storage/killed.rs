//! What a kill cut off counts nowhere: neither in the unit history that the next run goes on with, nor in a replay of the folder.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::fs;
use std::io;
use std::path::Path;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex};

use hmd::daemon::{ENDING_MAX, Observer, Steps};
use hmd::replay::{self, Replay};
use hmd_core::assess::{AssessedWindow, Identification};
use hmd_core::frame::RawFrame;
use hmd_core::record::HealthLine;
use hmd_ingest::feed::Input;
use hmd_ingest::file::open;
use hmd_storage::config_file::load_config;
use hmd_storage::recorder::{Recorder, metadata};
use hmd_storage::segment_store::raw_segments;

use super::captures::clock_from;
use super::hmd;

/// The line of each window, with its hours and cycles.
#[derive(Default)]
struct Lines(Mutex<Vec<String>>);

impl Lines {
    fn add(&self, assessed: &AssessedWindow) {
        let line = HealthLine::from((&assessed.health, &assessed.rul)).to_json();
        let (hours, cycles) = (assessed.rul.operating_h, assessed.rul.operating_cycles);
        self.0.lock().unwrap().push(format!("{line} {hours:?} {cycles:?}"));
    }
}

impl Observer for Lines {
    fn assessed(&self, assessed: &AssessedWindow) -> io::Result<()> {
        self.add(assessed);
        Ok(())
    }

    fn notice(&self, _: &str) {}
}

impl replay::Observer for &Lines {
    fn assessed(&mut self, assessed: &AssessedWindow) -> io::Result<()> {
        self.add(assessed);
        Ok(())
    }

    fn notice(&mut self, _: &str) {}

    fn progress(&mut self, _: u64) {}
}

/// Begins a run in a folder and gives it frames; of the windows that they end, so many are assessed. It is killed then, or comes to its end.
fn run(root: &Path, frames: &[RawFrame], assessed: usize, is_killed: bool, lines: &Lines) {
    let config = Arc::new(load_config(root.join("hmd.toml")).unwrap());
    let clock = clock_from(frames[0].stamp_ns);
    let mut names = hmd_core::frame::BusNames::new();
    names.intern("can0").unwrap();
    let about = metadata(&config, "host", 1);
    let recorder = Recorder::open_folder(&root.join("segments"), &about, config.output().limits()).unwrap();
    let watch = Some((config, 1));
    let mut steps = Steps::new(names, Some(recorder), watch, Arc::new(Identification), &clock, lines).unwrap();
    let mut left = assessed;
    for frame in frames {
        clock.now_ns.store(frame.stamp_ns, Relaxed);
        steps.take(&mut vec![Input::Frame(*frame)]).unwrap();
        while left > 0 && steps.assess().unwrap() {
            left -= 1;
        }
    }
    if is_killed {
        if assessed < 3 {
            // Frames are on the disk beyond the last window that was assessed.
            let stamp_ns = clock.now_ns.load(Relaxed);
            steps.take(&mut vec![Input::Tick { stamp_ns }]).unwrap();
        }
        // Nothing of it runs any more.
        std::mem::forget(steps);
    } else {
        steps.finish(ENDING_MAX).unwrap();
    }
}

/// What a kill leaves: a process that is gone holds no lock.
pub(super) fn copy(from: &Path, to: &Path) {
    fs::create_dir(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let place = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &place);
        } else {
            fs::copy(&path, &place).unwrap();
        }
    }
}

#[test]
fn a_replay_of_runs_that_were_killed_gives_their_lines_and_those_of_the_next_ones() {
    let root = tempfile::tempdir().unwrap();
    let at = |n: usize| root.path().join(n.to_string());
    fs::create_dir(at(0)).unwrap();
    let text = "[rul]\nstate = \"histories\"\nevents = \"events.jsonl\"\n[identification]\npopulation = 8\ngenerations = 1\n\
                [type.slow]\nbased_on = \"bench\"\n[type.slow.sensors]\nsample_rate_hz = 400\n\
                [[actuator]]\nid = 0\nname = \"ema0\"\ntype = \"slow\"\n";
    fs::write(at(0).join("hmd.toml"), text).unwrap();
    hmd(&at(0), "simulate --rate 400 --windows 12 --seed 4 -o some.log");
    let all: Vec<RawFrame> = open(&at(0).join("some.log")).unwrap().map(Result::unwrap).collect();
    let lines = Lines::default();
    let part = all.len() / 12;
    // Windows assessed, of those that ended: all, all but the last, none, all of a run that is not killed.
    let runs = [
        (0, 3 * part + part / 2, 3),
        (4 * part, 7 * part + part / 2, 2),
        (8 * part, 9 * part + part / 2, 0),
        (10 * part, all.len(), usize::MAX),
    ];
    for (n, (from, to, assessed)) in runs.into_iter().enumerate() {
        run(&at(n), &all[from..to], assessed, n < 3, &lines);
        copy(&at(n), &at(n + 1));
    }
    let live = lines.0.into_inner().unwrap();
    assert_eq!(live.len(), 7, "{live:#?}");
    let last = at(runs.len());
    let replayed = |logs: &[std::path::PathBuf]| {
        let again = Lines::default();
        let config = Arc::new(load_config(last.join("hmd.toml")).unwrap());
        let (output, seed) = (None, 1);
        let replay = Replay {
            logs,
            output,
            config,
            seed,
        };
        replay.run(&mut &again).unwrap();
        again.0.into_inner().unwrap()
    };
    let logs: Vec<_> = raw_segments(&last.join("segments")).unwrap().into_values().collect();
    let logs: Vec<_> = logs.into_iter().map(|segment| segment.path).collect();
    assert_eq!(replayed(&logs), live);
    // A folder that nobody has repaired yet.
    let logs: Vec<_> = raw_segments(&at(0).join("segments")).unwrap().into_values().collect();
    let logs: Vec<_> = logs.into_iter().map(|segment| segment.path).collect();
    assert_eq!(replayed(&logs), live[..3]);
    // An event that is dated back says what the daemon, which has assessed these windows, does not assess again.
    let warned = |at_ns: u64| {
        let at = format!("event --reset ema0 -c hmd.toml --at {at_ns}");
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_hmd"));
        let ended = command.args(at.split(' ')).current_dir(&last).output().unwrap();
        assert!(ended.status.success());
        String::from_utf8(ended.stderr)
            .unwrap()
            .contains("a replay resets it from then on")
    };
    let newest_ns = all[all.len() - 1].stamp_ns;
    assert_eq!([newest_ns - 10_000_000_000, newest_ns].map(warned), [true, false]);
}
