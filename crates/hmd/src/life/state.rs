//! Lives in files: one for each actuator, versioned, replaced as a whole.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::Life;

/// Version of what is in a file; a file of another one is not read.
const VERSION: u32 = 1;

/// Why a life that was kept cannot be used, or not be kept.
#[derive(Debug, thiserror::Error)]
pub enum StateError {
    /// The file cannot be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// What the system said.
        source: io::Error,
    },
    /// It is no state of a life.
    #[error("{path}: expected the life of an actuator, found {found}")]
    Content {
        /// The file.
        path: String,
        /// What the reader said.
        found: String,
    },
    /// It was written by a program that keeps lives in another form.
    #[error("{path}: expected version {VERSION}, found {found}")]
    Version {
        /// The file.
        path: String,
        /// Its version.
        found: u64,
    },
}

#[derive(Serialize)]
struct Written<'a> {
    version: u32,
    actuator: &'a str,
    life: &'a Life,
}

#[derive(Deserialize)]
struct Read {
    life: Life,
}

/// Where the life of an actuator is.
#[must_use]
pub(super) fn path(directory: &Path, actuator: &str) -> PathBuf {
    directory.join(format!("{actuator}.life.json"))
}

/// Writes a life: to a file beside, then onto its place, so that there is always a whole one.
///
/// # Errors
/// [`StateError::Io`].
pub(super) fn save(directory: &Path, actuator: &str, life: &Life) -> Result<(), StateError> {
    let place = path(directory, actuator);
    let beside = place.with_extension("json.new");
    let written = Written {
        version: VERSION,
        actuator,
        life,
    };
    let put = || {
        fs::create_dir_all(directory)?;
        let mut file = File::create(&beside)?;
        file.write_all(&serde_json::to_vec(&written)?)?;
        file.sync_data()?;
        fs::rename(&beside, &place)
    };
    put().map_err(|source| StateError::Io {
        path: place.display().to_string(),
        source,
    })
}

/// Reads a life; `None` where none was kept.
///
/// # Errors
/// [`StateError`].
pub(super) fn load(directory: &Path, actuator: &str) -> Result<Option<Life>, StateError> {
    let place = path(directory, actuator);
    let name = || place.display().to_string();
    let bytes = match fs::read(&place) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(source) => return Err(StateError::Io { path: name(), source }),
    };
    let content = |found: String| StateError::Content { path: name(), found };
    let value: serde_json::Value = serde_json::from_slice(&bytes).map_err(|e| content(e.to_string()))?;
    let version = value.get("version").and_then(serde_json::Value::as_u64);
    match version {
        Some(version) if version == u64::from(VERSION) => {}
        Some(found) => return Err(StateError::Version { path: name(), found }),
        None => return Err(content("no version".to_owned())),
    }
    let read: Read = serde_json::from_value(value).map_err(|e| content(e.to_string()))?;
    Ok(Some(read.life))
}

/// Puts a file that cannot be used aside, as `….unusable`, so that nothing is lost and a new life can be kept.
///
/// # Errors
/// [`StateError::Io`].
pub(super) fn put_aside(directory: &Path, actuator: &str) -> Result<(), StateError> {
    let place = path(directory, actuator);
    fs::rename(&place, place.with_extension("json.unusable")).map_err(|source| StateError::Io {
        path: place.display().to_string(),
        source,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    #[test]
    fn a_life_is_kept_and_a_bad_file_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let config = Config::default();
        assert!(load(folder.path(), "ema0").unwrap().is_none());
        let life = Life::new(&config, Some("S1".to_owned())).unwrap();
        save(folder.path(), "ema0", &life).unwrap();
        let again = load(folder.path(), "ema0").unwrap().unwrap();
        assert_eq!(
            serde_json::to_string(&again).unwrap(),
            serde_json::to_string(&life).unwrap()
        );
        let file = path(folder.path(), "ema0");
        for (content, expected) in [
            ("{", "expected the life of an actuator"),
            ("{\"version\":1}", "expected the life of an actuator"),
            ("{\"version\":99}", "expected version 1, found 99"),
        ] {
            fs::write(&file, content).unwrap();
            let error = load(folder.path(), "ema0").unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
        put_aside(folder.path(), "ema0").unwrap();
        assert!(load(folder.path(), "ema0").unwrap().is_none());
    }
}
