//! A day in compressed time: the whole live chain but the sockets, on sixteen actuators at 400 Hz with a window a minute.
//!
//! Requirement S-26 of `docs/safety.md`. What must not grow does not, what was observed is read back, and the disk budget holds.
//! `HMD_SOAK_MINUTES` says how long the long form is.
#![allow(clippy::unwrap_used, reason = "a failed step of a test ends it")]

mod counting_allocator;
mod soak_rig;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::future::pending;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use counting_allocator::held_bytes;
use hmd::daemon::{Daemon, Observer};
use hmd_core::assess::AssessedWindow;
use hmd_core::config::Config;
use hmd_core::config::Limits;
use hmd_core::frame::BusNames;
use hmd_core::record::{Health, Record, Status};
use hmd_ingest::live::LiveSource;
use hmd_storage::mcap::{McapFrames, McapMessages};
use hmd_storage::recorder::{Recorder, metadata};
use prost::Message;
use soak_rig::{ACTUATORS, ACTUATORS_PER_BUS, BUSES, Bus, FRAMES_PER_SECOND, Template, config, kib, program};

/// Most that the resident memory may grow in a day after ten minutes, KiB.
const GROWTH_MAX_KIB: u64 = 1024;

/// Most that the heap may grow in two minutes, bytes: half a byte kept of each frame is more. Between two segments there is no chunk that
/// is being filled, 0.9 MB, and no file.
const HEAP_GROWTH_MAX: usize = 1 << 20;

/// Most that the program may hold with sixteen actuators at 400 Hz, KiB.
const RESIDENT_MAX_KIB: u64 = 32 * 1024;

/// Longest from the start to ready, and from the end of a window to its record on the disk.
const LATENCY_MAX: Duration = Duration::from_secs(1);

/// Windows that identification may lie behind: its queue holds 64, and a bus is in the midst of its minute.
const BACKLOG_MAX: u64 = 2 * ACTUATORS;

/// Held by each test: one measures what this process holds, the other is in real time.
static ALONE: Mutex<()> = Mutex::new(());

/// Minutes between two lines of progress.
const PROGRESS_EVERY_MINUTES: u64 = 60;

/// What the process holds in a minute: the highest of what each of its seconds began with.
#[derive(Clone, Copy, Debug, Default)]
struct Minute {
    resident_kib: u64,
    /// The lowest: a segment that is being ended holds some for a moment.
    descriptors: Option<usize>,
    /// The lowest: queues and the chunk being filled hold some MiB, more or fewer.
    held_bytes: Option<usize>,
}

impl Minute {
    fn sample(&mut self) {
        self.resident_kib = self.resident_kib.max(resident_kib());
        let open = fs::read_dir("/proc/self/fd").unwrap().count();
        self.descriptors = Some(self.descriptors.map_or(open, |least| least.min(open)));
        let held = held_bytes();
        self.held_bytes = Some(self.held_bytes.map_or(held, |least| least.min(held)));
    }
}

fn resident_kib() -> u64 {
    kib(&fs::read_to_string("/proc/self/status").unwrap(), "VmRSS:")
}

/// What the daemon reported.
#[derive(Default)]
struct Observed {
    assessed: Arc<AtomicU64>,
    /// Highest use of the disk that a status named, bytes.
    used: AtomicU64,
    /// Windows by actuator and status.
    statuses: Mutex<BTreeMap<(String, String), u64>>,
}

impl Observer for Observed {
    fn assessed(&self, assessed: &AssessedWindow) -> io::Result<()> {
        let health = &assessed.health;
        let key = (health.actuator.clone(), health.status.to_string());
        *self.statuses.lock().unwrap().entry(key).or_default() += 1;
        self.assessed.fetch_add(1, Ordering::Release);
        Ok(())
    }

    fn assessed_unstored(&self, assessed: &AssessedWindow) -> io::Result<()> {
        panic!(
            "not stored: window {} of {}",
            assessed.health.window, assessed.health.actuator
        );
    }

    fn notice(&self, message: &str) {
        eprintln!("{message}");
    }

    fn status(&self, status: &Status) {
        self.used.fetch_max(status.storage_used_bytes, Ordering::Relaxed);
    }
}

/// What may not grow.
#[derive(Clone, Copy)]
enum Memory {
    /// The heap, at its lowest in a minute. In a few minutes the resident memory grows by some MiB before it stays, sooner or
    /// later as the threads happen to meet.
    Heap,
    /// The resident memory, at its highest in a minute.
    Resident,
}

/// Runs some minutes; memory at the end is compared with that of minute `warm`.
fn soak(minutes: u64, warm: u64, grown: Memory, limits: Limits) {
    let folder = tempfile::tempdir().unwrap();
    let config = Arc::new(Config::from_toml_str(&config(), "hmd.toml").unwrap());
    let recorder = Recorder::open_folder(folder.path(), &metadata(&config, "test", 1), limits).unwrap();
    let (observed, templates) = (Observed::default(), Template::all());
    let seen = Arc::new(Mutex::new([Minute::default(); 2]));
    let since = Instant::now();
    let ended = Arc::new(AtomicU64::new(0));
    let sources = (0..BUSES).map(|bus| {
        let (assessed, ended, seen) = (observed.assessed.clone(), ended.clone(), seen.clone());
        let before = move |second: u64| {
            let minute = second / 60;
            if second > 0 && second.is_multiple_of(60) {
                ended.fetch_add(ACTUATORS_PER_BUS, Ordering::Relaxed);
            }
            // Compressed time has no pace of its own: nothing is dropped, so nothing may fall behind.
            while ended.load(Ordering::Relaxed) > assessed.load(Ordering::Acquire) + BACKLOG_MAX {
                std::thread::sleep(Duration::from_millis(1));
            }
            if bus > 0 {
                return;
            }
            let which = [warm, minutes].iter().position(|at| minute + 1 == *at);
            if let Some(which) = which {
                // No window on its way: all playbacks wait with this one.
                while ended.load(Ordering::Relaxed) > assessed.load(Ordering::Acquire) {
                    std::thread::sleep(Duration::from_millis(1));
                }
                seen.lock().unwrap()[which].sample();
            }
            if second.is_multiple_of(60 * PROGRESS_EVERY_MINUTES) {
                eprintln!(
                    "minute {minute}: {} s, {} KiB",
                    since.elapsed().as_secs(),
                    resident_kib()
                );
            }
        };
        let frames = Bus::new(templates.clone(), bus, minutes, Box::new(before));
        (format!("can{bus}"), LiveSource::Playback(Box::new(frames)))
    });
    let daemon = Daemon {
        sources: sources.collect(),
        recorder: Some(recorder),
        watch: Some((config, 1)),
    };
    let status = daemon.run(pending(), &observed).unwrap();
    let took = since.elapsed();

    let expected = ACTUATORS * minutes;
    let [early, late] = *seen.lock().unwrap();
    let growth = late.resident_kib.saturating_sub(early.resident_kib);
    let [held_early, held_late] = [early, late].map(|minute| minute.held_bytes.unwrap());
    let heap_growth = held_late.saturating_sub(held_early);
    let (health, frames) = read(folder.path());
    let found: u64 = health.values().sum();
    let on_disk: u64 = fs::read_dir(folder.path())
        .unwrap()
        .map(|entry| entry.unwrap().metadata().unwrap().len())
        .sum();
    eprintln!(
        "{minutes} minutes in {:.1} s: {} frames, {expected} records expected, {} observed, {found} read back; resident in \
         minute {warm} {} KiB, in the last {} KiB; heap {held_early} and {held_late} bytes; {:?} and {:?} descriptors; at most {} bytes on the disk, {} segments \
         deleted, {frames} frames left",
        took.as_secs_f64(),
        status.frames_received,
        observed.assessed.load(Ordering::Acquire),
        early.resident_kib,
        late.resident_kib,
        early.descriptors.unwrap(),
        late.descriptors.unwrap(),
        observed.used.load(Ordering::Relaxed),
        status.storage_deleted,
    );
    eprintln!("{:?}", observed.statuses.lock().unwrap());
    assert_eq!(status.frames_received, FRAMES_PER_SECOND * 60 * minutes);
    assert!(!status.data_lost(), "{status:?}");
    assert_eq!(observed.assessed.load(Ordering::Acquire), expected);
    for id in 0..ACTUATORS {
        assert_eq!(health.get(&format!("ema{id}")), Some(&minutes), "ema{id}");
    }
    assert_eq!(found, expected);
    assert_eq!(status.windows_ok + status.windows_degraded, expected, "{status:?}");
    match grown {
        Memory::Heap => assert!(heap_growth <= HEAP_GROWTH_MAX, "the heap grew by {heap_growth} bytes"),
        Memory::Resident => assert!(growth <= GROWTH_MAX_KIB, "grew by {growth} KiB"),
    }
    let [early_files, late_files] = [early, late].map(|minute| minute.descriptors.unwrap());
    assert!(
        late_files <= early_files + 1,
        "{early_files} and {late_files} descriptors"
    );
    // Each tick looks after the budget.
    assert!(
        on_disk <= limits.budget_bytes + 2 * limits.segment_bytes,
        "{on_disk} bytes on the disk"
    );
    assert!(status.storage_deleted > 0 || minutes < 600, "no rotation");
}

/// Health records of each actuator, whose numbers must have no gap, and frames that are left, which must be whole.
fn read(folder: &Path) -> (BTreeMap<String, u64>, u64) {
    let (mut health, mut frames) = (BTreeMap::new(), 0);
    let mut paths: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    paths.sort();
    for path in paths {
        let name = path.display().to_string();
        assert!(name.ends_with(".mcap"), "{name} is left over");
        if name.ends_with("-raw.mcap") {
            let all = McapFrames::new(File::open(&path).unwrap(), &name, BusNames::new()).unwrap();
            frames += all.map(|frame| assert!(frame.is_ok(), "{frame:?}")).count() as u64;
            continue;
        }
        for message in McapMessages::new(File::open(&path).unwrap(), &name).unwrap() {
            let message = message.unwrap();
            if *message.schema == *Health::SCHEMA_NAME {
                let record = Health::decode(message.data.as_slice()).unwrap();
                let windows = health.entry(record.actuator).or_insert(0);
                assert_eq!(record.window, *windows, "{}", message.topic);
                *windows += 1;
            }
        }
    }
    (health, frames)
}

#[test]
fn a_few_minutes_lose_nothing() {
    let _alone = ALONE.lock();
    // Small segments, so that they are closed and deleted as in a day. A trend is fitted, and its memory taken, from the third
    // window of an actuator on.
    soak(
        6,
        4,
        Memory::Heap,
        Limits {
            segment_bytes: 1 << 20,
            ..Limits::new(1, 3600, 8, 0)
        },
    );
}

#[test]
#[ignore = "an hour; cargo xtask soak"]
fn a_day_grows_by_nothing_and_loses_nothing() {
    let minutes = std::env::var("HMD_SOAK_MINUTES").map_or(1440, |text| text.parse().unwrap());
    // An age of some forty simulated minutes: it is the one thing that follows the real clock.
    soak(minutes, 10, Memory::Resident, Limits::new(16, 60, 2048, 256));
}

/// Requirement S-28 with a healthy and a worn actuator's window, but for how prompt the records are: what else the computer does at the time
/// is not known.
#[test]
fn the_program_is_ready_soon_and_small() {
    let _alone = ALONE.lock();
    let measured = measure_program(Duration::from_secs(6));
    assert_eq!(measured.records.len(), 2);
}

/// Requirement S-28.
#[test]
#[ignore = "a minute of real time; cargo xtask soak"]
fn the_program_is_ready_soon_and_small_and_its_records_are_prompt() {
    // All actuations of a minute, and their records.
    let measured = measure_program(Duration::from_secs(62));
    let longest = measured.records.iter().max().unwrap();
    assert_eq!(measured.records.len() as u64, ACTUATORS);
    assert!(*longest <= LATENCY_MAX, "a record after {longest:?}");
}

/// Runs the program; it must be ready soon and small.
fn measure_program(time: Duration) -> program::Measurements {
    let folder = tempfile::tempdir().unwrap();
    let measured = program::run(folder.path(), time);
    eprintln!(
        "ready after {:.3} s; {} records synced and observed, at most {:.3} s after the last sample of their windows; resident \
         memory at most {} KiB",
        measured.ready.as_secs_f64(),
        measured.records.len(),
        measured.records.iter().max().map_or(0.0, Duration::as_secs_f64),
        measured.resident_kib
    );
    assert!(measured.ready <= LATENCY_MAX, "ready after {:?}", measured.ready);
    assert!(
        measured.resident_kib <= RESIDENT_MAX_KIB,
        "{} KiB",
        measured.resident_kib
    );
    measured
}
