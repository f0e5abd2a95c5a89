//! Metrics as a file, for the textfile collector of a node exporter.

use std::fs::Permissions;
use std::io::{self, Read, Write};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::path::Path;

use crate::output_file::OutputFile;
use crate::regular_file::open_regular;

/// How every file of ours begins.
const START: &[u8] = b"# HELP hmd_";

/// Whether metrics may take this place: nothing is there, or metrics of ours, or a device.
#[must_use]
pub fn may_replace(path: &Path) -> bool {
    let about = match std::fs::metadata(path) {
        Err(cause) => return cause.kind() == io::ErrorKind::NotFound,
        Ok(about) => about.file_type(),
    };
    if !about.is_file() {
        return about.is_char_device();
    }
    let Ok(file) = open_regular(path) else { return false };
    let mut start = Vec::new();
    let read = file.take(START.len() as u64).read_to_end(&mut start);
    read.is_ok() && (start.is_empty() || start == START)
}

/// Puts rendered metrics into a file in one step: a reader sees the old or the new ones. A device is written to as it is.
///
/// # Errors
/// What the system says; also for a pipe, which could make the caller wait for its reader.
pub fn write_textfile(path: &Path, metrics: &str) -> io::Result<()> {
    if std::fs::metadata(path).is_ok_and(|about| about.file_type().is_fifo()) {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            "expected a file or a device, found a pipe",
        ));
    }
    let output = OutputFile::create(path)?;
    let mut file = output.handle()?;
    file.write_all(metrics.as_bytes())?;
    if output.is_beside() {
        // Its reader is another user, whatever the mask of the service.
        file.set_permissions(Permissions::from_mode(0o644))?;
    }
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
    fn a_device_keeps_its_mode_and_a_pipe_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let [fifo, file] = ["fifo", "file/in/it"].map(|name| folder.path().join(name));
        nix::unistd::mkfifo(&fifo, nix::sys::stat::Mode::S_IRWXU).unwrap();
        assert!(!may_replace(&fifo) && !may_replace(folder.path()));
        let refused = write_textfile(&fifo, "hmd_frames_total 1\n").unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::InvalidInput);
        // A place that cannot be looked at may hold anything.
        std::fs::write(folder.path().join("file"), "").unwrap();
        assert!(!may_replace(&file));
        let null = Path::new("/dev/null");
        assert!(may_replace(null));
        let before = std::fs::metadata(null).unwrap().permissions();
        let written = write_textfile(null, "hmd_frames_total 1\n");
        let after = std::fs::metadata(null).unwrap().permissions();
        if after != before {
            // The machine needs it as it was.
            std::fs::set_permissions(null, before.clone()).unwrap();
        }
        written.unwrap();
        assert_eq!(after, before);
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
