//! A disk whose power may fail at any operation: what was not synced is then torn and partly there, in any order.
//!
//! The files lie in a real folder, which is what a running system shows to readers. Beside it stands what is safe: of each file its content
//! at the last sync and the writes since, of the names those at the last sync of the folder and the changes since. A power cut keeps any
//! sectors of the writes, and any of the changes of names.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use hmd_storage::segment_store::{Disk, Out};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use crate::clock::WorldClock;

/// Part of a write that is on the disk whole or not at all, bytes.
const SECTOR: usize = 512;

/// How the disk behaves for now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mood {
    /// It works.
    #[default]
    Works,
    /// Others have filled it.
    Full,
    /// Every change fails.
    Fails,
    /// Every sync takes so long.
    Slow(Duration),
}

/// One segment that the program removed.
#[derive(Clone, Debug)]
pub struct Removed {
    /// Its name.
    pub name: String,
    /// Run that had begun it: its number may be given again.
    pub owner: Option<usize>,
    /// Bytes of all segments before.
    pub used_bytes: u64,
    /// All segments before.
    pub names: Vec<String>,
    /// Its content.
    pub content: Vec<u8>,
}

/// The disk; all clones are one.
#[derive(Clone)]
pub struct WorldDisk {
    folder: PathBuf,
    clock: WorldClock,
    state: Arc<Mutex<State>>,
}

#[derive(Default)]
struct State {
    mood: Mood,
    /// Nothing is done any more: the process is gone.
    dead: bool,
    /// Operations until the power fails.
    power_lasts: Option<u64>,
    /// Changes of names until it does.
    name_changes_last: Option<u64>,
    files: Vec<Content>,
    names: BTreeMap<String, usize>,
    safe_names: BTreeMap<String, usize>,
    changes: Vec<Change>,
    removed: Vec<Removed>,
    run: usize,
    owners: BTreeMap<u64, usize>,
}

#[derive(Default)]
struct Content {
    safe: Vec<u8>,
    writes: Vec<(usize, Vec<u8>)>,
}

enum Change {
    Added(String, usize),
    Renamed(String, String),
    Removed(String),
}

impl Change {
    fn apply(&self, names: &mut BTreeMap<String, usize>) {
        match self {
            Self::Added(name, file) => {
                names.insert(name.clone(), *file);
            }
            Self::Renamed(from, to) => {
                if let Some(file) = names.remove(from) {
                    names.insert(to.clone(), file);
                }
            }
            Self::Removed(name) => {
                names.remove(name);
            }
        }
    }
}

fn apply(content: &mut Vec<u8>, at: usize, bytes: &[u8]) {
    content.resize(content.len().max(at + bytes.len()), 0);
    content[at..at + bytes.len()].copy_from_slice(bytes);
}

/// The number in the name of a segment.
#[must_use]
pub fn segment_number(name: &str) -> Option<u64> {
    name.strip_prefix("hmd-")?.split('-').next()?.parse().ok()
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

impl WorldDisk {
    /// Over an empty folder.
    #[must_use]
    pub fn new(folder: &Path, clock: WorldClock) -> Self {
        Self {
            folder: folder.to_owned(),
            clock,
            state: Arc::default(),
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets how it behaves.
    pub fn set_mood(&self, mood: Mood) {
        self.lock().mood = mood;
    }

    /// The power fails after so many operations.
    pub fn power_fails_after(&self, operations: u64) {
        self.lock().power_lasts.get_or_insert(operations);
    }

    /// The power fails.
    pub fn power_fails_now(&self) {
        let mut state = self.lock();
        (state.power_lasts, state.dead) = (Some(0), true);
    }

    /// The power fails at so many changes of names from here on.
    pub fn power_fails_at_change_of_names(&self, changes: u64) {
        self.lock().name_changes_last = Some(changes);
    }

    /// How it behaves.
    #[must_use]
    pub fn mood(&self) -> Mood {
        self.lock().mood
    }

    /// A run of the program begins; segments that are begun are its own.
    pub fn begin_run(&self, run: usize) {
        self.lock().run = run;
    }

    /// Segments by their number, and the run that began them.
    #[must_use]
    pub fn owners(&self) -> BTreeMap<u64, usize> {
        self.lock().owners.clone()
    }

    /// Whether nothing is done any more.
    #[must_use]
    pub fn is_dead(&self) -> bool {
        self.lock().dead
    }

    /// The process ends without a word: its destructors find a disk that does nothing.
    pub fn kill(&self) {
        self.lock().dead = true;
    }

    /// What was removed since the last call.
    pub fn take_removed(&self) -> Vec<Removed> {
        std::mem::take(&mut self.lock().removed)
    }

    /// Another process may use it; after a power cut it shows what is left.
    ///
    /// # Errors
    /// The real folder cannot be written.
    pub fn revive(&self, rng: &mut ChaCha8Rng) -> io::Result<()> {
        let mut state = self.lock();
        let state = &mut *state;
        let was_cut = state.power_lasts.take() == Some(0);
        (state.dead, state.name_changes_last) = (false, None);
        if !was_cut {
            return Ok(());
        }
        for change in std::mem::take(&mut state.changes) {
            if rng.random_bool(0.5) {
                change.apply(&mut state.safe_names);
            }
        }
        for file in &mut state.files {
            // Nothing, all, or any sectors of what was not synced.
            let share = [0.0, 1.0, 0.5][rng.random_range(0..3)];
            for (at, bytes) in std::mem::take(&mut file.writes) {
                for (n, sector) in bytes.chunks(SECTOR).enumerate() {
                    if rng.random_bool(share) {
                        apply(&mut file.safe, at + n * SECTOR, sector);
                    }
                }
            }
        }
        state.names.clone_from(&state.safe_names);
        for entry in fs::read_dir(&self.folder)? {
            fs::remove_file(entry?.path())?;
        }
        for (name, file) in &state.names {
            fs::write(self.folder.join(name), &state.files[*file].safe)?;
        }
        Ok(())
    }

    /// Flips one bit of a file that lies still.
    ///
    /// # Errors
    /// The real folder cannot be written.
    pub fn rot(&self, name: &str, rng: &mut ChaCha8Rng) -> io::Result<()> {
        let path = self.folder.join(name);
        let mut content = fs::read(&path)?;
        if content.is_empty() {
            return Ok(());
        }
        let at = rng.random_range(0..content.len());
        content[at] ^= 1 << rng.random_range(0..8);
        fs::write(&path, &content)?;
        let mut state = self.lock();
        if let Some(&file) = state.names.get(name) {
            state.files[file] = Content {
                safe: content,
                writes: Vec::new(),
            };
        }
        Ok(())
    }

    /// Names of all files, in order.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        self.lock().names.keys().cloned().collect()
    }

    /// One operation that changes names, or brings changed ones to the disk.
    fn begin_with_names(&self) -> io::Result<MutexGuard<'_, State>> {
        let mut state = self.lock();
        if let Some(left) = &mut state.name_changes_last {
            *left = left.saturating_sub(1);
            if *left == 0 {
                (state.power_lasts, state.dead) = (Some(0), true);
            }
        }
        drop(state);
        self.begin()
    }

    /// One operation that changes something.
    fn begin(&self) -> io::Result<MutexGuard<'_, State>> {
        let mut state = self.lock();
        if let Some(left) = &mut state.power_lasts {
            *left = left.saturating_sub(1);
            if *left == 0 {
                state.dead = true;
            }
        }
        match state.mood {
            _ if state.dead => Err(io::ErrorKind::Other.into()),
            Mood::Full => Err(io::ErrorKind::StorageFull.into()),
            Mood::Fails => Err(io::Error::from_raw_os_error(5)),
            Mood::Works | Mood::Slow(_) => Ok(state),
        }
    }

    fn wait(&self, state: MutexGuard<'_, State>) {
        if let Mood::Slow(time) = state.mood {
            self.clock.advance(time);
        }
    }
}

impl Disk for WorldDisk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn Out>> {
        let mut state = self.begin_with_names()?;
        let real = OpenOptions::new().write(true).create_new(true).open(path)?;
        let file = state.files.len();
        state.files.push(Content::default());
        let change = Change::Added(name_of(path), file);
        change.apply(&mut state.names);
        state.changes.push(change);
        if let Some(number) =
            segment_number(&name_of(path)).filter(|_| path.extension().is_some_and(|last| last == "part"))
        {
            let run = state.run;
            state.owners.insert(number, run);
        }
        drop(state);
        let disk = self.clone();
        Ok(Box::new(WorldFile {
            disk,
            real,
            file,
            at: 0,
        }))
    }

    fn free_bytes(&self, _: &Path) -> io::Result<u64> {
        let state = self.lock();
        Ok(if state.mood == Mood::Full { 0 } else { 1 << 40 })
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        let mut state = self.begin_with_names()?;
        fs::rename(from, to)?;
        let change = Change::Renamed(name_of(from), name_of(to));
        change.apply(&mut state.names);
        state.changes.push(change);
        Ok(())
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        let mut state = match self.begin() {
            // A full disk gives back what is removed.
            Err(cause) if cause.kind() == io::ErrorKind::StorageFull => self.lock(),
            other => other?,
        };
        let content = fs::read(path).unwrap_or_default();
        let length = |name: &String| fs::metadata(self.folder.join(name)).map_or(0, |about| about.len());
        let used_bytes = state.names.keys().map(length).sum();
        fs::remove_file(path)?;
        let names = state.names.keys().cloned().collect();
        let owner = segment_number(&name_of(path)).and_then(|number| state.owners.get(&number).copied());
        state.removed.push(Removed {
            name: name_of(path),
            owner,
            used_bytes,
            names,
            content,
        });
        let change = Change::Removed(name_of(path));
        change.apply(&mut state.names);
        state.changes.push(change);
        Ok(())
    }

    fn sync_folder(&self, _: &Path) -> io::Result<()> {
        let mut state = self.begin_with_names()?;
        for change in std::mem::take(&mut state.changes) {
            change.apply(&mut state.safe_names);
        }
        self.wait(state);
        Ok(())
    }
}

struct WorldFile {
    disk: WorldDisk,
    real: File,
    file: usize,
    at: usize,
}

impl Write for WorldFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut state = self.disk.begin()?;
        self.real.write_all_at(bytes, self.at as u64)?;
        state.files[self.file].writes.push((self.at, bytes.to_vec()));
        self.at += bytes.len();
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        let mut state = self.disk.begin()?;
        let Content { safe, writes } = &mut state.files[self.file];
        for (at, bytes) in writes.drain(..) {
            apply(safe, at, &bytes);
        }
        self.disk.wait(state);
        Ok(())
    }
}

impl Seek for WorldFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let end = self.real.metadata()?.len();
        let at = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::Current(by) => (self.at as u64).checked_add_signed(by),
            SeekFrom::End(by) => end.checked_add_signed(by),
        };
        let at = at.ok_or(io::ErrorKind::InvalidInput)?;
        self.at = at as usize;
        Ok(at)
    }
}
