//! The files of a configuration: one, and `conf.d/*.toml` beside it.

use std::io;
use std::path::{Path, PathBuf};

use super::ConfigError;

/// Folder of the drop-ins, beside the file.
const FOLDER: &str = "conf.d";

/// Name and text of a file.
pub(super) fn read(path: &Path) -> Result<(String, String), ConfigError> {
    let file = path.display().to_string();
    match std::fs::read_to_string(path) {
        Ok(text) => Ok((file, text)),
        Err(source) => Err(ConfigError::Read { file, source }),
    }
}

/// The drop-ins of a file, in the order of their names; none without the folder.
pub(super) fn list(path: &Path) -> Result<Vec<PathBuf>, ConfigError> {
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
