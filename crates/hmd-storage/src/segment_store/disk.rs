//! What the segment store changes on a disk; tests and the simulated world replace it. Reading is that of the system.

use std::fs::{File, OpenOptions};
use std::io::{self, Seek, Write};
use std::path::Path;

use super::name::Name;
use crate::mcap_writer::SyncedFile;

/// A segment in progress; `flush` brings it to the disk.
pub trait Out: Write + Seek + Send {}

impl<T: Write + Seek + Send> Out for T {}

/// File-system operations of the segment store. Names are changed on the system's own disk unless another says otherwise.
pub trait Disk: Send + Sync {
    /// Makes a file that is not there yet.
    ///
    /// # Errors
    /// What the system says.
    fn create(&self, path: &Path) -> io::Result<Box<dyn Out>>;

    /// Bytes that an ordinary user may still write to the file system of a folder.
    ///
    /// # Errors
    /// What the system says.
    fn free_bytes(&self, folder: &Path) -> io::Result<u64>;

    /// Gives a file another name, in place of any file of that name; safe after the next [`Disk::sync_folder`].
    ///
    /// # Errors
    /// What the system says.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        std::fs::rename(from, to)
    }

    /// Removes a file.
    ///
    /// # Errors
    /// What the system says.
    fn remove(&self, path: &Path) -> io::Result<()> {
        std::fs::remove_file(path)
    }

    /// Brings the names of a folder to the disk: a new or renamed file is not safe before.
    ///
    /// # Errors
    /// What the system says.
    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        File::open(folder)?.sync_all()
    }
}

/// The real one.
#[derive(Clone, Copy, Debug)]
pub struct RealDisk;

impl Disk for RealDisk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn Out>> {
        let file = OpenOptions::new().write(true).create_new(true).open(path)?;
        Ok(Box::new(SyncedFile::new(file)))
    }

    fn free_bytes(&self, folder: &Path) -> io::Result<u64> {
        let about = nix::sys::statvfs::statvfs(folder)?;
        Ok(about.blocks_available().saturating_mul(about.fragment_size()))
    }
}

/// Gives a segment a name that is not in use, durably.
pub(super) fn rename(disk: &dyn Disk, folder: &Path, from: Name, to: Name) -> io::Result<()> {
    let [from, to] = [from, to].map(|name| folder.join(name.to_string()));
    if to.exists() {
        return Err(io::ErrorKind::AlreadyExists.into());
    }
    disk.rename(&from, &to)?;
    disk.sync_folder(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_is_not_there_cannot_be_brought_to_the_disk() {
        let folder = tempfile::tempdir().unwrap();
        assert!(RealDisk.sync_folder(folder.path()).is_ok());
        let missing = RealDisk.sync_folder(&folder.path().join("none"));
        assert_eq!(missing.map_err(|cause| cause.kind()), Err(io::ErrorKind::NotFound));
    }
}
