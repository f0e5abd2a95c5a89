//! The files of a configuration: one, and `conf.d/*.toml` beside it.

use std::io;
use std::path::{Path, PathBuf};

use crate::regular_file::{read_regular, read_regular_text};
use hmd_core::config::{Config, ConfigError};

/// Folder of the drop-ins, beside the file.
const FOLDER: &str = "conf.d";

/// Most bytes of a drop-in.
const DROPIN_BYTES_MAX: u64 = 1 << 20;

/// Most bytes of the file that was asked for: a thousand actuators, each with a map of its own.
const FILE_BYTES_MAX: u64 = 16 << 20;

/// Name and text of a file of at most so many bytes. What is no regular file is refused, not waited for: a reload must not hang.
fn read(path: &Path, bytes_max: u64) -> Result<(String, String), ConfigError> {
    named(path, read_regular_text(path, bytes_max))
}

fn named(path: &Path, text: io::Result<String>) -> Result<(String, String), ConfigError> {
    let file = path.display().to_string();
    match text {
        Ok(text) => Ok((file, text)),
        Err(source) => Err(ConfigError::Read { file, source }),
    }
}

/// The drop-ins of a file, in the order of their names; none without the folder.
fn list(path: &Path) -> Result<Vec<PathBuf>, ConfigError> {
    let folder = path.parent().unwrap_or(Path::new("")).join(FOLDER);
    let error = |source| ConfigError::Read {
        file: folder.display().to_string(),
        source,
    };
    let entries = match std::fs::read_dir(&folder) {
        Err(missing) if matches!(missing.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => {
            return Ok(Vec::new());
        }
        entries => entries.map_err(error)?,
    };
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.map_err(error)?.path();
        if path.extension().is_some_and(|end| end == "toml") {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// Largest DBC file that is read, bytes.
const DBC_BYTES_MAX: u64 = 16 << 20;

/// Reads and checks a configuration file, with the drop-ins `conf.d/*.toml` beside it in the order of their names: what a
/// later one sets again holds, and its `[[actuator]]`s are further ones. Relative paths start at the file's directory.
///
/// # Errors
/// [`ConfigError`] with file, line, key, what was expected and what was found.
pub fn load_config(path: impl AsRef<Path>) -> Result<Config, ConfigError> {
    load_config_with(Some(path.as_ref()), &[])
}

/// The same, or the defaults without a file, with `settings` (`KEY=VALUE`) that hold over all files.
///
/// # Errors
/// As [`load_config`]; errors call the n-th setting `--set:n`.
pub fn load_config_with(path: Option<&Path>, settings: &[String]) -> Result<Config, ConfigError> {
    let mut files = Vec::new();
    if let Some(path) = path {
        files.push(read(path, FILE_BYTES_MAX)?);
        for dropin in list(path)? {
            files.push(read(&dropin, DROPIN_BYTES_MAX)?);
        }
    }
    Config::from_texts(&files, settings, &read_dbc)
}

/// Checks `text` as a configuration file called `file_name`; DBC files that it names are read from its directory.
///
/// # Errors
/// As [`load_config`].
pub fn config_from_text(text: &str, file_name: &str) -> Result<Config, ConfigError> {
    Config::from_texts(&[(file_name.to_owned(), text.to_owned())], &[], &read_dbc)
}

/// The bytes of a DBC file, or why there are none.
///
/// # Errors
/// What was found instead, as part of a sentence.
pub fn read_dbc(path: &Path) -> Result<Vec<u8>, String> {
    read_regular(path, DBC_BYTES_MAX).map_err(|e| e.to_string())
}
