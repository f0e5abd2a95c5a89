//! Files of unit histories: one for each actuator, versioned, replaced as a whole.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use sha2::{Digest, Sha256};

use crate::held_lock::HeldLock;
use crate::output_file::create_folder;
use crate::regular_file::{create_temporary, read_regular};
use crate::same_file::is_same_file;
use hmd_core::config::Config;
use hmd_core::history::{HistoryStore, UnitHistory};
use hmd_core::metadata_checksum::hex;

/// Version of what is written. Version 1 had no checksum, version 2 held the levels of health too, which are those of the
/// configuration; both are read as well. A file of another one is not.
const VERSION: u32 = 3;

/// Most bytes of a file: a history has less than one MiB.
const BYTES_MAX: u64 = 16 << 20;

/// Files that are put aside for each actuator; with more, the newest replaces the last.
const ASIDE_MAX: usize = 8;

/// Why a stored history cannot be used, or a history not be stored.
#[derive(Debug, thiserror::Error)]
pub enum StateError {
    /// The file cannot be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// Error of the operating system.
        source: io::Error,
    },
    /// It is no history of this actuator.
    #[error("{path}: expected the history of an actuator, found {found}")]
    Content {
        /// The file.
        path: String,
        /// Error of the reader.
        found: String,
    },
    /// It was written by a program with another form of history.
    #[error("{path}: expected version 1 to {VERSION}, found {found}")]
    Version {
        /// The file.
        path: String,
        /// Its version.
        found: u64,
    },
}

/// What version a file has, read before anything else of it.
#[derive(Deserialize)]
struct Versioned {
    version: u64,
}

#[derive(Serialize)]
struct Written<'a> {
    version: u32,
    actuator: &'a str,
    /// Of the text of the history.
    sha256: String,
    #[serde(rename = "life")]
    history: &'a RawValue,
}

#[derive(Deserialize)]
struct Read<'a> {
    actuator: String,
    sha256: Option<String>,
    #[serde(borrow, rename = "life")]
    history: &'a RawValue,
}

/// File of the history of an actuator.
#[must_use]
pub(super) fn path(directory: &Path, actuator: &str) -> PathBuf {
    directory.join(format!("{actuator}.life.json"))
}

fn checksum(history: &RawValue) -> String {
    hex(&Sha256::digest(history.get()))
}

/// Writes a history: to a temporary file, then onto its place, so that there is always a whole one, and on the disk when this
/// returns.
///
/// # Errors
/// [`StateError::Io`].
pub fn save(directory: &Path, actuator: &str, history: &UnitHistory) -> Result<(), StateError> {
    let place = path(directory, actuator);
    let temporary = place.with_extension("json.new");
    let put = || {
        let history = serde_json::value::to_raw_value(history)?;
        let written = Written {
            version: VERSION,
            actuator,
            sha256: checksum(&history),
            history: &history,
        };
        create_folder(directory)?;
        let mut file = create_temporary(&temporary)?;
        file.write_all(&serde_json::to_vec(&written)?)?;
        file.sync_data()?;
        fs::rename(&temporary, &place)?;
        File::open(directory)?.sync_all()
    };
    put().map_err(|source| StateError::Io {
        path: place.display().to_string(),
        source,
    })
}

/// Name of the file whose lock says that a run keeps its histories in a folder.
const LOCK: &str = "histories.lock";

/// Takes the folder of the histories, made if need be, for one run: two would overwrite what the other learns. It is free when what is
/// returned is dropped.
///
/// # Errors
/// [`StateError::Io`]; also where another run has it.
pub fn hold(directory: &Path) -> Result<HeldLock, StateError> {
    let failed = |source| StateError::Io {
        path: directory.display().to_string(),
        source,
    };
    let lock = open_lock(directory).and_then(HeldLock::take).map_err(failed)?;
    lock.ok_or_else(|| {
        failed(io::Error::new(
            io::ErrorKind::ResourceBusy,
            "expected histories that no other hmd keeps, found some in use",
        ))
    })
}

/// Whether [`hold`] would take a folder, whose lock is not kept; `own` is the folder that this process has taken already.
///
/// # Errors
/// As [`hold`].
pub fn check(directory: &Path, own: Option<&Path>) -> Result<(), StateError> {
    if !own.is_some_and(|own| is_same_file(own, directory)) {
        return hold(directory).map(drop);
    }
    // The lock is ours, and a second one would be refused.
    open_lock(directory).map(drop).map_err(|source| StateError::Io {
        path: directory.display().to_string(),
        source,
    })
}

fn open_lock(directory: &Path) -> io::Result<File> {
    create_folder(directory)?;
    File::options().create(true).append(true).open(directory.join(LOCK))
}

/// Reads a history; `None` where none is stored.
///
/// # Errors
/// [`StateError`].
pub fn load(directory: &Path, actuator: &str) -> Result<Option<UnitHistory>, StateError> {
    let place = path(directory, actuator);
    let name = || place.display().to_string();
    let content = |found: String| StateError::Content { path: name(), found };
    let bytes = match read_regular(&place, BYTES_MAX) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(e) if matches!(e.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::FileTooLarge) => {
            return Err(content(e.to_string()));
        }
        Err(source) => return Err(StateError::Io { path: name(), source }),
    };
    let unreadable = |e: serde_json::Error| content(e.to_string());
    let found = serde_json::from_slice::<Versioned>(&bytes).map_err(unreadable)?.version;
    if !(1..=u64::from(VERSION)).contains(&found) {
        return Err(StateError::Version { path: name(), found });
    }
    let read: Read<'_> = serde_json::from_slice(&bytes).map_err(unreadable)?;
    if read.actuator != actuator {
        return Err(content(format!("that of {:?}", read.actuator)));
    }
    match &read.sha256 {
        Some(sum) if *sum != checksum(read.history) => {
            return Err(content("another checksum than its text has".to_owned()));
        }
        None if found > 1 => return Err(content("no checksum".to_owned())),
        _ => {}
    }
    let history: UnitHistory = serde_json::from_str(read.history.get()).map_err(unreadable)?;
    if !history.is_possible() {
        return Err(content("impossible numbers".to_owned()));
    }
    Ok(Some(history))
}

/// Gives the stored histories of all actuators of a configuration to a run. A file whose content cannot be used is reported and put
/// aside.
///
/// # Errors
/// [`StateError::Io`] of a file that cannot be read: what is in it may be right, and must not be replaced.
pub fn restore_all(directory: &Path, config: &Config, histories: &mut HistoryStore) -> Result<(), StateError> {
    for actuator in config.actuators() {
        match load(directory, &actuator.name) {
            Ok(Some(history)) => histories.restore(&actuator.name, history),
            Ok(None) => {}
            Err(error @ StateError::Io { .. }) => return Err(error),
            Err(error) => {
                histories.notice(format!("{error}; history reset"));
                if let Err(error) = put_aside(directory, &actuator.name) {
                    histories.notice(error.to_string());
                }
            }
        }
    }
    Ok(())
}

/// Whether [`restore_all`] could read the histories of a configuration.
///
/// # Errors
/// As [`restore_all`].
pub fn check_readable(directory: &Path, config: &Config) -> Result<(), StateError> {
    for actuator in config.actuators() {
        if let Err(error @ StateError::Io { .. }) = load(directory, &actuator.name) {
            return Err(error);
        }
    }
    Ok(())
}

/// Puts a file that cannot be used aside, as `….unusable-1` and so on, so that nothing is lost and a new history can be stored.
///
/// # Errors
/// [`StateError::Io`].
pub fn put_aside(directory: &Path, actuator: &str) -> Result<(), StateError> {
    let place = path(directory, actuator);
    let aside = |n: usize| place.with_extension(format!("json.unusable-{n}"));
    let free = (1..=ASIDE_MAX).map(aside).find(|path| !path.exists());
    fs::rename(&place, free.unwrap_or_else(|| aside(ASIDE_MAX))).map_err(|source| StateError::Io {
        path: place.display().to_string(),
        source,
    })
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;
    use std::sync::Arc;

    use super::*;

    #[test]
    fn one_run_at_a_time_keeps_the_histories_of_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("histories");
        let held = hold(&place).unwrap();
        let refused = hold(&place).unwrap_err().to_string();
        assert!(
            refused.contains("expected histories that no other hmd keeps"),
            "{refused}"
        );
        // A reload keeps the folder that the process has, and no other's.
        check(&place, Some(&place)).unwrap();
        assert!(check(&place, Some(folder.path())).is_err());
        drop(held);
        check(&place, None).unwrap();
        hold(&place).unwrap();
    }

    #[test]
    fn a_history_is_stored_and_a_bad_file_is_reported() {
        let folder = tempfile::tempdir().unwrap();
        let config = Config::default();
        assert!(load(folder.path(), "ema0").unwrap().is_none());
        let history = UnitHistory::new(&config, Some("S1".to_owned())).unwrap();
        save(folder.path(), "ema0", &history).unwrap();
        let again = load(folder.path(), "ema0").unwrap().unwrap();
        assert_eq!(
            serde_json::to_string(&again).unwrap(),
            serde_json::to_string(&history).unwrap()
        );
        let file = path(folder.path(), "ema0");
        let good = fs::read_to_string(&file).unwrap();
        for (content, expected) in [
            ("{", "expected the history of an actuator"),
            ("{\"version\":1}", "expected the history of an actuator"),
            ("{\"version\":99}", "expected version 1 to 3, found 99"),
            (&good.replace("ema0", "ema1"), "found that of \"ema1\""),
            (&good.replace("\"S1\"", "\"S2\""), "found another checksum"),
            (&good.replace("sha256", "sha255"), "found no checksum"),
        ] {
            fs::write(&file, content).unwrap();
            let error = load(folder.path(), "ema0").unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
        for n in 1..=ASIDE_MAX + 1 {
            fs::write(&file, n.to_string()).unwrap();
            put_aside(folder.path(), "ema0").unwrap();
            assert!(load(folder.path(), "ema0").unwrap().is_none());
        }
        let aside = |n: usize| fs::read_to_string(file.with_extension(format!("json.unusable-{n}"))).unwrap();
        assert_eq!([aside(1), aside(ASIDE_MAX - 1), aside(ASIDE_MAX)], ["1", "7", "9"]);
    }

    #[test]
    fn an_unusable_history_is_reported_and_put_aside() {
        let folder = tempfile::tempdir().unwrap();
        let config = Arc::new(Config::default());
        fs::write(path(folder.path(), "ema0"), "{").unwrap();
        let mut histories = HistoryStore::new(config.clone());
        restore_all(folder.path(), &config, &mut histories).unwrap();
        assert_eq!(histories.take_notices().len(), 1);
        assert!(folder.path().join("ema0.life.json.unusable-1").exists());
        // What cannot be read may be right: it stays, and the run does not begin.
        let place = path(folder.path(), "ema0");
        symlink(&place, &place).unwrap();
        let refused = restore_all(folder.path(), &config, &mut histories);
        assert!(matches!(refused, Err(StateError::Io { .. })));
        assert!(check_readable(folder.path(), &config).is_err());
        assert!(place.is_symlink() && histories.take_notices().is_empty());
    }
}
