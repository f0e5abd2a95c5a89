//! Windows that are explained side by side have the records and notices of one after another.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::fs;
use std::io;
use std::path::Path;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex};

use hmd::daemon::{ENDING_MAX, Observer, Steps};
use hmd_core::assess::{AssessedWindow, Identification};
use hmd_core::frame::{BusNames, RawFrame};
use hmd_core::record::HealthLine;
use hmd_ingest::feed::Input;
use hmd_ingest::file::open;
use hmd_storage::config_file::load_config;

use super::captures::clock_from;
use super::hmd;

/// What an operator reads, in its order.
#[derive(Default)]
struct Told(Mutex<Vec<String>>);

impl Observer for Told {
    fn assessed(&self, assessed: &AssessedWindow) -> io::Result<()> {
        let line = HealthLine::from((&assessed.health, &assessed.rul)).to_json();
        self.0
            .lock()
            .unwrap()
            .push(format!("{line} {:?} {:?}", assessed.unit, assessed.news));
        Ok(())
    }

    fn notice(&self, message: &str) {
        self.0.lock().unwrap().push(message.to_owned());
    }
}

/// Actuators `c` and `d` are worn; `a`, `b` and `d` are to be learnt, where it is said.
fn config(learn: bool) -> String {
    let mut text =
        "[rul]\nstate = \"histories\"\nevents = \"events.jsonl\"\n[identification]\npopulation = 8\ngenerations = 1\n\
                    [type.slow]\nbased_on = \"bench\"\n[type.slow.sensors]\nsample_rate_hz = 400\n"
            .to_owned();
    for (id, name) in ["a", "b", "c", "d"].into_iter().enumerate() {
        text += &format!("[[actuator]]\nid = {id}\nname = \"{name}\"\ntype = \"slow\"\n");
        if learn && name != "c" {
            text += "learn_windows = 5\nlearn_folder = \"units\"\n";
        }
    }
    text
}

/// Frames of all four, in the order of time: windows end together.
fn frames(root: &Path, windows: u32, start: &str) -> Vec<RawFrame> {
    let mut frames = Vec::new();
    for (id, fault) in [
        (0, "gain=0.5"),
        (1, "gain=0.5"),
        (2, "friction=0.4"),
        (3, "short_b=0.4"),
    ] {
        hmd(
            root,
            &format!(
                "simulate --rate 400 --noise 0.02 --windows {windows} --start {start} --id {id} --fault {fault} -o {id}.log"
            ),
        );
        frames.extend(open(&root.join(format!("{id}.log"))).unwrap().map(Result::unwrap));
    }
    frames.sort_by_key(|frame| frame.stamp_ns);
    frames
}

/// What is told of the frames when so many windows are assessed together.
fn told(root: &Path, frames: &[RawFrame], at_most: usize) -> Vec<String> {
    let config = Arc::new(load_config(root.join("hmd.toml")).unwrap());
    let clock = clock_from(frames[0].stamp_ns);
    let mut names = BusNames::new();
    names.intern("can0").unwrap();
    let lines = Told::default();
    let mut steps = Steps::new(names, None, Some((config, 1)), Arc::new(Identification), &clock, &lines).unwrap();
    for frames in frames.chunks(64) {
        clock.now_ns.store(frames[frames.len() - 1].stamp_ns, Relaxed);
        steps
            .take(&mut frames.iter().copied().map(Input::Frame).collect())
            .unwrap();
        // Windows that end together wait together.
        if steps.status().queued_windows >= 4 {
            while steps.assess_together(at_most).unwrap() {}
        }
    }
    while steps.assess_together(at_most).unwrap() {}
    steps.finish(ENDING_MAX).unwrap();
    lines.0.into_inner().unwrap()
}

#[test]
fn records_and_notices_of_windows_side_by_side_are_those_of_one_after_another() {
    let root = tempfile::tempdir().unwrap();
    let at = |name: &str| root.path().join(name);
    fs::create_dir(at("before")).unwrap();
    fs::write(at("before/hmd.toml"), config(false)).unwrap();
    let worn = frames(&at("before"), 3, "2026-11-20T10:00Z");
    told(&at("before"), &worn, 1);
    // `d` has a history of damage now: it is not learnt, and says so when its assessment begins.
    fs::write(at("before/hmd.toml"), config(true)).unwrap();
    let learnt = frames(&at("before"), 7, "2026-11-20T11:00Z");
    let mut found = Vec::new();
    for at_most in [1, 4] {
        let folder = at(&at_most.to_string());
        super::killed::copy(&at("before"), &folder);
        found.push(told(&folder, &learnt, at_most));
    }
    assert_eq!(found[0], found[1]);
    for part in [
        "not learnt with",
        "a: commissioned",
        "b: commissioned",
        "learning, 2 of 5 windows",
    ] {
        assert!(
            found[0].iter().any(|line| line.contains(part)),
            "{part}: {:?}",
            found[0]
        );
    }
}
