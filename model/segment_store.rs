//! All states of the program's own [`SegmentStore`] within some steps: writing, failing disks, ends of every kind.
//!
//! A folder cannot be branched, so a state is the way to it, walked again for each step; states whose folders and counts read alike are
//! one. Of a file, a power cut leaves what was synced, or half of the rest as well; changes of names are taken as durable in order,
//! which the store brings about by syncing the folder.

use hmd_core::config::Limits;
use hmd_core::record::{Health, Record, StorageState};
use hmd_storage::mcap::McapMessages;
use hmd_storage::segment_store::{Disk, Out, SegmentStore};
use stateright::{Checker, Model, Property};
use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::hash::{Hash, Hasher};
use std::io::{self, Seek, SeekFrom, Write};
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const STEPS: usize = 6;
/// Health records; each is synced when it was written.
const RECORDS: u64 = 3;

#[derive(Clone, Copy, Debug, Hash, PartialEq, Eq)]
enum Step {
    /// A window is assessed.
    Record,
    /// A second passes, and the pauses after failures.
    Tick,
    /// The segment in progress becomes old.
    Age,
    DiskFails,
    DiskWorks,
    /// The run ends and another begins.
    Restart,
    /// The process is killed; another begins.
    Kill,
    /// The power fails; of what was not synced, nothing or a half is on the disk.
    PowerCut {
        torn: bool,
    },
}

/// Files with the length up to which each is synced, by inode.
#[derive(Clone, Default)]
struct SimulatedDisk {
    synced: Arc<Mutex<BTreeMap<u64, u64>>>,
    fails: Arc<AtomicBool>,
}

struct SimulatedFile(SimulatedDisk, File);

impl SimulatedDisk {
    fn check(&self) -> io::Result<()> {
        match self.fails.load(Relaxed) {
            true => Err(io::ErrorKind::StorageFull.into()),
            false => Ok(()),
        }
    }
}

impl Write for SimulatedFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.check()?;
        self.1.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.check()?;
        let about = self.1.metadata()?;
        self.0.synced.lock().unwrap().insert(about.ino(), about.len());
        Ok(())
    }
}

impl Seek for SimulatedFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.1.seek(to)
    }
}

impl Disk for SimulatedDisk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn Out>> {
        self.check()?;
        let file = OpenOptions::new().write(true).create_new(true).open(path)?;
        Ok(Box::new(SimulatedFile(self.clone(), file)))
    }

    fn free_bytes(&self, _: &Path) -> io::Result<u64> {
        Ok(u64::MAX)
    }
}

/// The program, and what is known of it.
struct World {
    folder: TempDir,
    disk: SimulatedDisk,
    store: Option<SegmentStore>,
    now: Instant,
    written: u64,
    /// Windows whose records the store said were on the disk.
    stored: Vec<u64>,
}

fn new_folder() -> TempDir {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() {
        tempfile::tempdir_in(memory)
    } else {
        tempfile::tempdir()
    }
    .unwrap()
}

impl World {
    fn new() -> Self {
        let mut world = Self {
            folder: new_folder(),
            disk: SimulatedDisk::default(),
            store: None,
            now: Instant::now(),
            written: 0,
            stored: Vec::new(),
        };
        world.open();
        world
    }

    fn open(&mut self) {
        let limits = Limits::new(1, 60, 1000, 0);
        let disk = Box::new(self.disk.clone());
        let opened = SegmentStore::open(self.folder.path(), &BTreeMap::new(), limits, disk, self.now);
        self.store = Some(opened.unwrap());
    }

    fn take(&mut self, step: Step) {
        let store = self.store.as_mut().unwrap();
        match step {
            Step::Record => {
                let health = Health {
                    actuator: "ema0".to_owned(),
                    window: self.written,
                    ..Health::default()
                };
                store.write(self.written, &health);
                if store.sync_window() {
                    self.stored.push(self.written);
                }
                self.written += 1;
            }
            Step::Tick | Step::Age => {
                self.now += Duration::from_secs(if step == Step::Age { 61 } else { 2 });
                store.tick(self.now);
            }
            Step::DiskFails => self.disk.fails.store(true, Relaxed),
            Step::DiskWorks => self.disk.fails.store(false, Relaxed),
            Step::Restart => {
                self.store.take().unwrap().finish();
                self.open();
            }
            Step::Kill | Step::PowerCut { .. } => {
                self.cut(step);
                self.open();
            }
        }
    }

    /// What is left of the folder goes into a new one, before a destructor writes to it.
    fn cut(&mut self, step: Step) {
        let left = new_folder();
        let synced = self.disk.synced.lock().unwrap().clone();
        let mut synced_now = BTreeMap::new();
        for entry in fs::read_dir(self.folder.path()).unwrap() {
            let path = entry.unwrap().path();
            let content = fs::read(&path).unwrap();
            let safe = synced.get(&fs::metadata(&path).unwrap().ino()).copied().unwrap_or(0) as usize;
            let kept = match step {
                Step::PowerCut { torn: true } => safe + (content.len() - safe) / 2,
                Step::PowerCut { torn: false } => safe,
                _ => content.len(),
            };
            let copy = left.path().join(path.file_name().unwrap());
            fs::write(&copy, &content[..kept]).unwrap();
            synced_now.insert(fs::metadata(copy).unwrap().ino(), kept as u64);
        }
        drop(self.store.take());
        *self.disk.synced.lock().unwrap() = synced_now;
        self.folder = left;
    }

    /// Files by their names, and the windows in each.
    fn content(&self) -> Vec<(String, Vec<u64>)> {
        let names = fs::read_dir(self.folder.path())
            .unwrap()
            .map(|entry| entry.unwrap().path());
        let mut files: Vec<_> = names
            .map(|path| {
                let messages = McapMessages::new(File::open(&path).unwrap(), "segment").unwrap();
                let health = messages
                    .flatten()
                    .filter(|message| *message.schema == *Health::SCHEMA_NAME);
                let windows = health.map(|message| message.log_time_ns).collect();
                (path.file_name().unwrap().to_str().unwrap().to_owned(), windows)
            })
            .collect();
        files.sort();
        files
    }
}

/// The way to a state, and how it reads.
#[derive(Clone, Debug)]
struct Walked {
    steps: Vec<Step>,
    written: u64,
    fails: bool,
    reads: String,
    /// What is wrong with it.
    fault: Option<String>,
    recovered: bool,
}

impl PartialEq for Walked {
    fn eq(&self, other: &Self) -> bool {
        (self.steps.len(), &self.reads) == (other.steps.len(), &other.reads)
    }
}

impl Hash for Walked {
    fn hash<H: Hasher>(&self, hasher: &mut H) {
        (self.steps.len(), &self.reads).hash(hasher);
    }
}

fn walked(steps: Vec<Step>) -> Walked {
    let mut world = World::new();
    for step in &steps {
        world.take(*step);
    }
    let status = world.store.as_ref().unwrap().status();
    let fails = world.disk.fails.load(Relaxed);
    let reads = format!(
        "{:?} {:?} {:?} {fails} {} {} {}",
        world.content(),
        world.written,
        world.stored,
        status.state.name(),
        status.lost_records,
        status.segments
    );
    let recovered = status.state == StorageState::Ok && status.lost_records > 0;
    let (written, stored) = (world.written, world.stored.clone());
    // Whatever comes next, what was stored is found once, in order, and nothing else; the disk works again.
    world.take(Step::DiskWorks);
    world.take(Step::PowerCut { torn: true });
    world.take(Step::Record);
    let mut fault = None;
    let found: Vec<u64> = world.content().into_iter().flat_map(|(_, windows)| windows).collect();
    if !found.is_sorted_by(|a, b| a < b) || found.last() != Some(&written) {
        fault = Some(format!("found {found:?} of {written}"));
    }
    if let Some(lost) = stored.iter().find(|window| !found.contains(window)) {
        fault = Some(format!("window {lost} was stored, found {found:?}"));
    }
    Walked {
        steps,
        written,
        fails,
        reads,
        fault,
        recovered,
    }
}

struct Store;

impl Model for Store {
    type State = Walked;
    type Action = Step;

    fn init_states(&self) -> Vec<Walked> {
        vec![walked(Vec::new())]
    }

    fn actions(&self, state: &Walked, actions: &mut Vec<Step>) {
        if state.steps.len() == STEPS {
            return;
        }
        if state.written < RECORDS {
            actions.push(Step::Record);
        }
        actions.push(if state.fails { Step::DiskWorks } else { Step::DiskFails });
        actions.extend([Step::Tick, Step::Age, Step::Restart, Step::Kill]);
        actions.extend([false, true].map(|torn| Step::PowerCut { torn }));
    }

    fn next_state(&self, state: &Walked, step: Step) -> Option<Walked> {
        Some(walked([state.steps.as_slice(), &[step]].concat()))
    }

    fn properties(&self) -> Vec<Property<Self>> {
        vec![
            Property::always("stored is found, once and in order", |_, state: &Walked| {
                state.fault.is_none()
            }),
            Property::sometimes("a failure is recovered from", |_, state: &Walked| state.recovered),
        ]
    }
}

#[test]
fn all_states_of_the_segment_store() {
    let checker = Store.checker().threads(2).spawn_bfs().join();
    println!(
        "segment store: {} states, {} steps",
        checker.unique_state_count(),
        checker.state_count()
    );
    checker.assert_properties();
}
