//! A disk that answers with EIO for a while, between the program and a real file system: nothing that was reported as stored is
//! lost, and what was not is reported so.
//!
//! Requirement S-9 of `docs/safety.md`. The load is that of `survive.rs`, in a process of its own; a small library in C
//! (`failing_disk/shim.c`), loaded before the C library, stands for the disk.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use crate::survive_rig::{FAILING, LOAD, compare, stored, write_load, writer_of};
use hmd_core::config::Limits;
use hmd_storage::recorder::Recorder;
use rustix::process::{Pid, Signal, kill_process};

/// Actuations of a run.
const ACTUATIONS: u32 = 30;
/// Records stored before the disk fails, and lost before it works again.
const BEFORE: usize = 4;
const LOST: usize = 3;

fn shim(folder: &Path) -> PathBuf {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/storage/failing_disk/shim.c");
    let library = folder.join("shim.so");
    let mut compiler = Command::new("cc");
    let compiled = compiler.args(["-shared", "-fPIC", "-O1", "-Wall", "-Werror", "-o"]);
    let status = compiled.arg(&library).arg(source).arg("-ldl").status();
    assert!(status.unwrap().success());
    library
}

/// Output of the writer, while the disk failed after some records and until some were lost.
fn output(folder: &Path, all: bool) -> Vec<String> {
    let flag = folder.join("failing");
    let mut writer = writer_of(folder, 0);
    writer
        .env(FAILING, "1")
        .env("LD_PRELOAD", shim(folder))
        .env("HMD_FAIL_FOLDER", folder.join("segments"))
        .env("HMD_FAIL_WHILE", &flag)
        .stdout(Stdio::null())
        .stderr(Stdio::piped());
    if all {
        writer.env("HMD_FAIL_ALL", "1");
    }
    let mut writer = writer.spawn().unwrap();
    let (mut lines, mut kept, mut lost) = (Vec::new(), 0, 0);
    for line in BufReader::new(writer.stderr.take().unwrap()).lines() {
        let line = line.unwrap();
        kept += usize::from(stored(&line).is_some());
        if kept == BEFORE && lost == 0 {
            File::create(&flag).unwrap();
        }
        lost += usize::from(line == "unstored");
        if line == "unstored" && lost == LOST {
            fs::remove_file(&flag).unwrap();
            wait_for_another_try(&writer);
        }
        lines.push(line);
    }
    assert!(writer.wait().unwrap().success(), "{lines:#?}");
    lines
}

/// Lets the second pass after which a failed disk is tried again, while the writer stands: it may need less for all that is left.
fn wait_for_another_try(writer: &Child) {
    let process = Pid::from_child(writer);
    kill_process(process, Signal::STOP).unwrap();
    sleep(Duration::from_millis(1100));
    kill_process(process, Signal::CONT).unwrap();
}

fn fails_for_a_while(all: bool) {
    let folder = tempfile::tempdir().unwrap();
    write_load(&folder.path().join(LOAD), ACTUATIONS);
    let lines = output(folder.path(), all);
    // The next start repairs the segments that were given up.
    let segments = folder.path().join("segments");
    let next = Recorder::open_folder(&segments, &BTreeMap::new(), Limits::new(1, 60, 1000, 0)).unwrap();
    next.finish().unwrap();
    let first_lost = lines.iter().position(|line| line == "unstored").unwrap();
    let keys = |lines: &[String]| lines.iter().filter_map(|line| stored(line)).collect::<Vec<_>>();
    let reported = keys(&lines).into_iter().collect();
    let found = compare(&reported, &segments);
    let after = keys(&lines[first_lost..]).len();
    assert!(after > 0, "no record after the failure: {lines:#?}");
    let output = lines.join("\n");
    for text in ["Input/output error", "written again", "ended"] {
        assert!(output.contains(text), "{text}: {output}");
    }
    eprintln!(
        "{} records reported as stored, {after} of them after the failure; {found} found",
        reported.len()
    );
}

#[test]
fn a_disk_that_fails_for_a_while_ends_nothing() {
    fails_for_a_while(true);
}

/// What was written is there, but nobody knows for how long: it must not be reported as stored.
#[test]
fn a_disk_that_takes_all_and_cannot_sync_ends_nothing() {
    fails_for_a_while(false);
}
