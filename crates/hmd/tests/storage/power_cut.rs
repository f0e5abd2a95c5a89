//! The power goes at random moments under load: every record reported as synced is on the disk after fsck and a restart.
//!
//! Requirement S-27 of `docs/safety.md`. The load of `survive.rs` writes to ext4 in a user-mode Linux, which is killed with
//! its page cache: what was written and not synced is gone, what the disk was in the midst of is torn. The image lies in this
//! computer's page cache, so a disk that acknowledges a flush that it has not done is not shown.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::collections::BTreeSet;
use std::fs;
use std::io::{BufRead, BufReader};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::sync::mpsc;
use std::time::Duration;

use crate::survive_rig::{FOLDER, LOAD, PACED, RUN, compare, stored, write_load, writer_of};
use hmd_core::seed::mix;

/// Longest that the power stays on, from the start of the guest or, every second time, from the first record.
const LONGEST: Duration = Duration::from_secs(4);
/// Longest wait for the first record, and for a run that comes to its end.
const TIMEOUT: Duration = Duration::from_secs(120);
/// Actuations of a run: more than it has time for.
const ACTUATIONS: u32 = 200;
/// The disk, bytes.
const DISK_BYTES: &str = "192M";

fn done(command: &mut Command) -> Output {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {output:?}");
    output
}

/// What the guest does: mounts the disk, lets the writer run, and ends in order if it may.
fn write_init(folder: &Path, run: u64) {
    let writer = writer_of(folder, run);
    let args = writer
        .get_args()
        .map(|arg| arg.to_str().unwrap())
        .collect::<Vec<_>>()
        .join(" ");
    let disk = folder.join("disk");
    let script = format!(
        "#!/bin/sh\nexport PATH=/usr/sbin:/usr/bin:/sbin:/bin\nmount -t proc proc /proc\n\
         mount -t ext4 /dev/ubda '{}' && echo mounted && {FOLDER}='{}' {RUN}={run} {PACED}=1 '{}' {args} 2>&1\n\
         umount '{}' && echo unmounted\nhalt -f\n",
        disk.display(),
        disk.display(),
        writer.get_program().to_str().unwrap(),
        disk.display(),
    );
    let init = folder.join("init.sh");
    fs::write(&init, script).unwrap();
    fs::set_permissions(&init, fs::Permissions::from_mode(0o755)).unwrap();
}

/// Output of the guest, without its power after `wait`, or until it ends without.
fn guest(folder: &Path, run: u64, wait: Option<Duration>) -> String {
    write_init(folder, run);
    let mut guest = Command::new("linux.uml");
    guest
        .args([
            "mem=256M",
            "rootfstype=hostfs",
            "rootflags=/",
            "rw",
            "con=null",
            "con0=null,fd:1",
            "quiet",
        ])
        .arg(format!("ubd0={}", folder.join("image").display()))
        .arg(format!("init={}", folder.join("init.sh").display()))
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .process_group(0);
    // What makes the guest run on processors with more registers than it knows.
    if let Some(library) = std::env::var_os("HMD_GUEST_PRELOAD") {
        guest.env("LD_PRELOAD", library);
    }
    let mut guest = guest.spawn().unwrap();
    let output = BufReader::new(guest.stdout.take().unwrap());
    let (first, stored_first) = mpsc::channel();
    let (end, ended) = mpsc::channel();
    let reader = std::thread::spawn(move || {
        let mut text = String::new();
        // The guest's terminal ends its lines with a carriage return as well.
        for line in output.split(b'\n').map_while(Result::ok) {
            let line = String::from_utf8_lossy(&line).trim_end().to_owned();
            if stored(&line).is_some() {
                // Nobody may wait for it.
                let _ = first.send(());
            }
            text += &line;
            text.push('\n');
        }
        let _ = end.send(());
        text
    });
    let in_time = match wait {
        Some(wait) => {
            let in_time = run.is_multiple_of(2) || stored_first.recv_timeout(TIMEOUT).is_ok();
            std::thread::sleep(wait);
            in_time
        }
        None => ended.recv_timeout(TIMEOUT).is_ok(),
    };
    // A guest is several processes.
    let group = format!("-{}", guest.id());
    let _ = Command::new("kill")
        .args(["-KILL", "--", &group])
        .stderr(Stdio::null())
        .status();
    guest.wait().unwrap();
    let text = reader.join().unwrap();
    assert!(in_time && !text.contains("panicked"), "run {run}: {text}");
    text
}

/// The check that a computer makes when it starts. Whether something was put right beyond the journal.
fn check(image: &Path) -> bool {
    let checked = Command::new("e2fsck").arg("-p").arg(image).output().unwrap();
    // 1: put right; from 4 on: not.
    let code = checked.status.code().unwrap();
    assert!(code <= 1, "{checked:?}");
    // Nothing may be left.
    done(Command::new("e2fsck").args(["-f", "-n"]).arg(image));
    code == 1
}

fn survives(cuts: u64) {
    let folder = tempfile::tempdir().unwrap();
    let [image, disk, back] = ["image", "disk", "back"].map(|name| folder.path().join(name));
    fs::create_dir(&disk).unwrap();
    fs::create_dir(&back).unwrap();
    write_load(&disk.join(LOAD), ACTUATIONS);
    done(
        Command::new("mkfs.ext4")
            .arg("-q")
            .arg("-d")
            .args([&disk, &image])
            .arg(DISK_BYTES),
    );
    let (mut reported, mut corrected, mut repaired, mut late) = (BTreeSet::new(), 0, 0, 0);
    for run in 0..=cuts {
        // The last comes to its end.
        let wait = (run < cuts).then(|| Duration::from_nanos(mix(17, &[run]) % LONGEST.as_nanos() as u64));
        let output = guest(folder.path(), run, wait);
        reported.extend(output.lines().filter_map(stored));
        repaired += u64::from(output.contains("was cut"));
        let came_to_end = output.contains("unmounted");
        assert!(wait.is_some() || came_to_end, "{output}");
        late += u64::from(wait.is_some() && came_to_end);
        corrected += u64::from(check(&image));
    }
    let dump = format!("rdump segments {}", back.display());
    done(Command::new("debugfs").args(["-R", &dump]).arg(&image));
    let found = compare(&reported, &back.join("segments"));
    eprintln!(
        "{cuts} power cuts, {late} of them after the end: {} records reported as synced, {found} found; {corrected} times fsck put something right, {repaired} \
         starts had segments to repair",
        reported.len()
    );
    assert!(reported.len() as u64 > cuts, "{} records are no load", reported.len());
}

#[test]
#[ignore = "needs user-mode Linux; cargo xtask power-cut"]
fn survives_power_loss() {
    survives(std::env::var("HMD_POWER_CUTS").map_or(5, |cuts| cuts.parse().unwrap()));
}
