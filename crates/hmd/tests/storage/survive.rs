//! kill -9 at random moments under load: what was reported as written is read back, and every restart works.
//!
//! Requirements S-1 and S-3 of `docs/safety.md`. The page cache outlives the process, so this does not show that a power
//! cut is survived. The load is the whole live chain, daemon, identification and store, in a process of its own (this
//! test program, started again), on frames from memory as fast as they are taken.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

use std::collections::{BTreeMap, BTreeSet};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::time::Duration;

use crate::survive_rig::{FAILING, LOAD, compare, read, replayed, stored, write_load, writer_of};
use hmd_core::config::Limits;
use hmd_core::seed::mix;
use hmd_storage::recorder::Recorder;

/// Actuations of a run.
const ACTUATIONS: u32 = 40;

/// Starts the writer and kills it after `wait`, or lets it come to its end without; what it reported as stored, and whether it came to its end.
fn killed(folder: &Path, run: u64, wait: Option<Duration>) -> (Vec<(u64, u64)>, bool) {
    let mut child = writer_of(folder, run)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let output = BufReader::new(child.stderr.take().unwrap());
    let (first, stored_first) = mpsc::channel();
    let reader = std::thread::spawn(move || {
        let mut text = String::new();
        for line in output.split(b'\n') {
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
    (text.lines().filter_map(stored).collect(), text.contains("ended"))
}

fn survives(kills: u64, longest: Duration) {
    let folder = tempfile::tempdir().unwrap();
    write_load(&folder.path().join(LOAD), ACTUATIONS);
    let mut reported_stored = BTreeSet::new();
    let mut ended = 0;
    for run in 0..kills {
        let wait = Duration::from_nanos(mix(13, &[run]) % longest.as_nanos() as u64);
        let (reported, came_to_end) = killed(folder.path(), run, Some(wait));
        reported_stored.extend(reported);
        ended += u64::from(came_to_end);
    }
    // The last start repairs what the last kill left, and ends in order.
    let (reported, came_to_end) = killed(folder.path(), kills, None);
    assert!(came_to_end, "{reported:?}");
    let reported_last = reported.len() as u64;
    reported_stored.extend(reported);
    let found = compare(&reported_stored, &folder.path().join("segments"));
    eprintln!(
        "{kills} kills, {ended} of them after the end: {} records reported as stored, {found} found",
        reported_stored.len()
    );
    // A replay gives what was stored: no window that a kill cut off, nor one that was under way. Of each kill there may be one that got its
    // mark and no record.
    let found = read(&folder.path().join("segments"));
    let again = replayed(&folder.path().join("segments"));
    let missing: Vec<_> = found.keys().filter(|key| !again.contains(key)).collect();
    assert_eq!(missing, [] as [&(u64, u64); 0], "stored and not replayed");
    let more = again.len() - found.len();
    assert!(more as u64 <= kills, "{more} windows come only in the replay");
    let of_killed = reported_stored.len() as u64 - reported_last;
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
    write_load(&folder.path().join(LOAD), ACTUATIONS);
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
    let text = String::from_utf8(output.stderr).unwrap();
    eprintln!("{text}");
    assert!(output.status.success() && text.contains("ended"), "{text}");
    // The next start repairs the segments that were given up.
    let kept = folder.path().join("kept");
    let next = Recorder::open_folder(&kept, &BTreeMap::new(), Limits::new(1, 60, 1000, 0)).unwrap();
    next.finish().unwrap();
    let found = read(&kept);
    let (mut kept, mut after, mut lost) = (0, 0, 0);
    for line in text.lines() {
        if line == "unstored" {
            lost += 1;
        } else if let Some(key) = stored(line) {
            assert!(found.contains_key(&key), "reported as stored and not found: {line}");
            kept += 1;
            after += u32::from(lost > 0);
        }
    }
    eprintln!("{kept} records stored and found, {after} of them after the disk was full; {lost} lost and reported so");
    assert!(lost > 0, "the disk was never full");
    assert!(after > 0, "no record after the disk was full");
    assert!(text.contains("No space left on device") && text.contains("written again"));
}
