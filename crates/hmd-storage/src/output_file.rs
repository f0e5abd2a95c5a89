//! Files that a run writes: made beside their place and put there when whole, so that a full disk or a bad input leaves the old file.
//!
//! Nothing is written through a link: a link at the place is replaced, what it leads to stays. A device or pipe at the place, or
//! where a link leads, is written to as it is.

use std::fs::{File, Metadata, OpenOptions, Permissions};
use std::io::{self, Write};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use tempfile::TempPath;

/// A file in the making. Dropped before [`OutputFile::put_in_place`], it leaves nothing.
#[derive(Debug)]
pub struct OutputFile {
    file: File,
    place: PathBuf,
    /// `None` where the place itself is written to.
    beside: Option<TempPath>,
}

impl OutputFile {
    /// Begins a file that replaces what is at `place`.
    ///
    /// # Errors
    /// What the system says.
    pub fn create(place: &Path) -> io::Result<Self> {
        match std::fs::metadata(place) {
            Ok(about) if !about.is_file() => Self::as_it_is(place, &about),
            _ => Self::beside(place),
        }
    }

    /// Begins a recording, which others may read while it grows: at its place where nothing is, else beside it.
    ///
    /// # Errors
    /// What the system says.
    pub fn create_recording(place: &Path) -> io::Result<Self> {
        let file = match OpenOptions::new().read(true).write(true).create_new(true).open(place) {
            Err(cause) if cause.kind() == io::ErrorKind::AlreadyExists && is_empty_file(place) => {
                OpenOptions::new().read(true).write(true).open(place)?
            }
            Err(cause) if cause.kind() == io::ErrorKind::AlreadyExists => return Self::create(place),
            created => created?,
        };
        // What is synced into it from here on is found after a power cut, too.
        sync_folder_of(place)?;
        Ok(Self {
            file,
            place: place.to_owned(),
            beside: None,
        })
    }

    fn as_it_is(place: &Path, about: &Metadata) -> io::Result<Self> {
        if about.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        let file = OpenOptions::new()
            .write(true)
            .custom_flags(libc::O_NOCTTY)
            .open(place)?;
        Ok(Self {
            file,
            place: place.to_owned(),
            beside: None,
        })
    }

    fn beside(place: &Path) -> io::Result<Self> {
        let name = place.file_name().ok_or(io::ErrorKind::InvalidFilename)?;
        let mut prefix = std::ffi::OsString::from(".");
        prefix.push(name);
        // The mask of the process applies, as to any file that it makes.
        let (file, path) = tempfile::Builder::new()
            .prefix(&prefix)
            .suffix(".new")
            .permissions(Permissions::from_mode(0o666))
            .tempfile_in(folder_of(place))?
            .into_parts();
        Ok(Self {
            file,
            place: place.to_owned(),
            beside: Some(path),
        })
    }

    /// A handle to write with; all handles share one position.
    ///
    /// # Errors
    /// What the system says.
    pub fn handle(&self) -> io::Result<File> {
        self.file.try_clone()
    }

    /// Where it can be read before it is in place.
    #[must_use]
    pub fn written_path(&self) -> &Path {
        self.beside.as_deref().unwrap_or(&self.place)
    }

    /// Whether it is written beside its place, and not a device or a recording at its place.
    pub(crate) fn is_beside(&self) -> bool {
        self.beside.is_some()
    }

    /// Brings the file to the disk, and then to its place. What replaced a file has its access rights.
    ///
    /// # Errors
    /// What the system says; the old file is then as it was.
    pub fn put_in_place(self) -> io::Result<()> {
        if self.beside.is_none() {
            // A device, or a recording whose writer has synced it.
            return Ok(());
        }
        if let Ok(old) = std::fs::symlink_metadata(&self.place)
            && old.is_file()
        {
            self.file.set_permissions(old.permissions())?;
        }
        self.file.sync_all()?;
        let place = self.place.clone();
        self.put_in_place_unsynced()?;
        sync_folder_of(&place)
    }

    /// Takes it back: what was at its place stays, and nothing is left where nothing was.
    ///
    /// # Errors
    /// What the system says.
    pub fn discard(self) -> io::Result<()> {
        match self.beside {
            Some(beside) => beside.close(),
            None if self.file.metadata()?.is_file() => std::fs::remove_file(&self.place),
            None => Ok(()),
        }
    }

    /// The same for what a power cut may cost.
    ///
    /// # Errors
    /// What the system says; the old file is then as it was.
    pub(crate) fn put_in_place_unsynced(self) -> io::Result<()> {
        match self.beside {
            Some(beside) => beside.persist(&self.place).map_err(|error| error.error),
            None => Ok(()),
        }
    }
}

/// A file with nothing in it, and no link to one.
fn is_empty_file(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_ok_and(|about| about.is_file() && about.len() == 0)
}

/// Writes a whole file.
///
/// # Errors
/// What the system says; the old file is then as it was.
pub fn write(place: &Path, bytes: impl AsRef<[u8]>) -> io::Result<()> {
    let output = OutputFile::create(place)?;
    output.handle()?.write_all(bytes.as_ref())?;
    output.put_in_place()
}

/// Makes a folder and those above it, as far as they are not there, and brings their names to the disk.
pub(crate) fn create_folder(folder: &Path) -> io::Result<()> {
    let missing: Vec<&Path> = folder.ancestors().take_while(|folder| !is_there(folder)).collect();
    std::fs::create_dir_all(folder)?;
    missing.into_iter().try_for_each(sync_folder_of)
}

/// The empty path is the working folder.
fn is_there(folder: &Path) -> bool {
    folder.as_os_str().is_empty() || folder.exists()
}

/// Brings the name of a file to the disk.
pub(crate) fn sync_folder_of(path: &Path) -> io::Result<()> {
    File::open(folder_of(path))?.sync_all()
}

/// The folder that a file is in.
pub(crate) fn folder_of(path: &Path) -> &Path {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn the_old_file_stays_until_the_new_one_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("a.html");
        write(&place, "old").unwrap();
        std::fs::set_permissions(&place, Permissions::from_mode(0o604)).unwrap();
        let output = OutputFile::create(&place).unwrap();
        output.handle().unwrap().write_all(b"new").unwrap();
        assert_eq!(std::fs::read(output.written_path()).unwrap(), b"new");
        assert_eq!(std::fs::read(&place).unwrap(), b"old");
        drop(output);
        assert_eq!(
            std::fs::read_dir(folder.path()).unwrap().count(),
            1,
            "nothing is left over"
        );
        write(&place, "new").unwrap();
        assert_eq!(std::fs::read(&place).unwrap(), b"new");
        assert_eq!(std::fs::metadata(&place).unwrap().permissions().mode() & 0o777, 0o604);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn links_are_replaced_and_devices_written_to() {
        let folder = tempfile::tempdir().unwrap();
        let [file, link, dangling, full] = ["file", "link", "dangling", "full"].map(|name| folder.path().join(name));
        std::fs::write(&file, "old").unwrap();
        symlink(&file, &link).unwrap();
        symlink(folder.path().join("none"), &dangling).unwrap();
        symlink("/dev/full", &full).unwrap();
        for place in [&link, &dangling] {
            write(place, "new").unwrap();
            assert!(std::fs::symlink_metadata(place).unwrap().is_file());
        }
        assert_eq!(std::fs::read(&file).unwrap(), b"old");
        assert!(!folder.path().join("none").exists());
        write(Path::new("/dev/null"), "new").unwrap();
        assert_eq!(write(&full, "new").unwrap_err().kind(), io::ErrorKind::StorageFull);
        assert_eq!(
            write(folder.path(), "new").unwrap_err().kind(),
            io::ErrorKind::IsADirectory
        );
    }

    #[test]
    fn folders_are_made_where_they_are_missing() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a", "a/b/c/", "a/b", "."] {
            create_folder(&folder.path().join(name)).unwrap();
            assert!(folder.path().join(name).is_dir(), "{name}");
        }
        std::fs::write(folder.path().join("file"), "").unwrap();
        assert!(create_folder(&folder.path().join("file/in")).is_err());
    }

    #[test]
    fn a_recording_grows_at_its_place_where_nothing_was() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("a.mcap");
        let output = OutputFile::create_recording(&place).unwrap();
        assert_eq!(output.written_path(), place);
        output.handle().unwrap().write_all(b"old").unwrap();
        output.put_in_place().unwrap();
        let again = OutputFile::create_recording(&place).unwrap();
        assert_ne!(again.written_path(), place);
    }
}
