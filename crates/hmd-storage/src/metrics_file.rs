//! Metrics as a file, for the textfile collector of a node exporter.

use std::fs::Permissions;
use std::io::{self, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use crate::regular_file::create_temporary;

/// Puts rendered metrics into a file in one step: a reader sees the old or the new ones.
///
/// # Errors
/// What the system says.
pub fn write_textfile(path: &Path, metrics: &str) -> io::Result<()> {
    let mut temporary = path.as_os_str().to_owned();
    temporary.push(".tmp");
    let mut file = create_temporary(Path::new(&temporary))?;
    file.write_all(metrics.as_bytes())?;
    // Its reader is another user, whatever the mask of the service.
    file.set_permissions(Permissions::from_mode(0o644))?;
    std::fs::rename(temporary, path)
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
}
