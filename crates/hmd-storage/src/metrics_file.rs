//! Metrics as a file, for the textfile collector of a node exporter.

use std::fs::Permissions;
use std::io::{self, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use crate::output_file::OutputFile;
use crate::regular_file::open_regular;

/// How every file of ours begins.
const START: &[u8] = b"# HELP hmd_";

/// Whether a file of metrics may take this place: nothing is there, or metrics of ours, or no regular file.
#[must_use]
pub fn may_replace(path: &Path) -> bool {
    let Ok(file) = open_regular(path) else { return true };
    let mut start = Vec::new();
    let read = file.take(START.len() as u64).read_to_end(&mut start);
    read.is_ok() && (start.is_empty() || start == START)
}

/// Puts rendered metrics into a file in one step: a reader sees the old or the new ones.
///
/// # Errors
/// What the system says.
pub fn write_textfile(path: &Path, metrics: &str) -> io::Result<()> {
    let output = OutputFile::create(path)?;
    let mut file = output.handle()?;
    file.write_all(metrics.as_bytes())?;
    // Its reader is another user, whatever the mask of the service.
    file.set_permissions(Permissions::from_mode(0o644))?;
    output.put_in_place_unsynced()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_textfile_is_replaced_as_a_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hmd.prom");
        write_textfile(&path, "hmd_frames_total 1\n").unwrap();
        write_textfile(&path, "hmd_frames_total 22\n").unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "hmd_frames_total 22\n");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn only_metrics_give_way_to_metrics() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hmd.prom");
        assert!(may_replace(&path));
        for (text, may) in [
            ("", true),
            ("# HELP hmd_samples …\n", true),
            ("# comment\n", false),
            ("(1.0) can0", false),
        ] {
            std::fs::write(&path, text).unwrap();
            assert_eq!(may_replace(&path), may, "{text}");
        }
    }
}
