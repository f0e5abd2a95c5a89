//! Opening what turns up in a folder or is named in an argument: regular files alone, and of bounded length where all is read.
//!
//! A FIFO with a likely name would make the reader wait for its other end, and a device may do anything.

use std::fs::{File, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

/// Opens a regular file for reading, or a link to one.
///
/// # Errors
/// What the system says, or [`io::ErrorKind::InvalidInput`] for anything that is no regular file.
pub fn open_regular(path: &Path) -> io::Result<File> {
    let check = |about: std::fs::Metadata| {
        let error = || io::Error::new(io::ErrorKind::InvalidInput, "expected a regular file");
        about.is_file().then_some(()).ok_or_else(error)
    };
    // A device is not even opened; what takes the file's place meanwhile is not waited for.
    check(std::fs::metadata(path)?)?;
    let file = OpenOptions::new()
        .read(true)
        .custom_flags(libc::O_NONBLOCK | libc::O_NOCTTY)
        .open(path)?;
    check(file.metadata()?)?;
    Ok(file)
}

/// All of a regular file, or of a link to one, of at most `most` bytes.
///
/// # Errors
/// Those of [`open_regular`], or [`io::ErrorKind::FileTooLarge`].
pub fn read_regular(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let file = open_regular(path)?;
    let too_large = || {
        let text = format!("expected at most {most} bytes, found more");
        io::Error::new(io::ErrorKind::FileTooLarge, text)
    };
    // What is too long is not read; it may also grow meanwhile.
    if file.metadata()?.len() > most {
        return Err(too_large());
    }
    let mut bytes = Vec::new();
    file.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        return Err(too_large());
    }
    Ok(bytes)
}

/// All of a regular file, or of a link to one, of at most `most` bytes, as text.
///
/// # Errors
/// Those of [`read_regular`], or [`io::ErrorKind::InvalidData`].
pub fn read_regular_text(path: &Path, most: u64) -> io::Result<String> {
    let bytes = read_regular(path, most)?;
    String::from_utf8(bytes).map_err(|_| io::Error::new(io::ErrorKind::InvalidData, "expected text in UTF-8"))
}

/// Creates the temporary file that is to replace another; a file or link of that name is removed, not followed.
///
/// # Errors
/// What the system says.
pub(crate) fn create_temporary(path: &Path) -> io::Result<File> {
    match std::fs::remove_file(path) {
        Err(cause) if cause.kind() != io::ErrorKind::NotFound => return Err(cause),
        _ => {}
    }
    OpenOptions::new().write(true).create_new(true).open(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_but_a_file_is_opened() {
        let folder = tempfile::tempdir().unwrap();
        let [fifo, file, link] = ["fifo", "file", "link"].map(|name| folder.path().join(name));
        nix::unistd::mkfifo(&fifo, nix::sys::stat::Mode::S_IRWXU).unwrap();
        std::fs::write(&file, "a").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        for path in [fifo.as_path(), folder.path(), Path::new("/dev/zero")] {
            let error = open_regular(path).unwrap_err();
            assert_eq!(error.to_string(), "expected a regular file", "{}", path.display());
        }
        assert!(open_regular(&file).is_ok() && open_regular(&link).is_ok());
        assert_eq!(
            open_regular(&folder.path().join("none")).unwrap_err().kind(),
            io::ErrorKind::NotFound
        );
    }

    #[test]
    fn large_files_are_refused_and_links_are_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let [file, link] = ["file", "link"].map(|name| folder.path().join(name));
        std::fs::write(&file, "four").unwrap();
        assert_eq!(read_regular(&file, 4).unwrap(), b"four");
        assert_eq!(read_regular(&file, 3).unwrap_err().kind(), io::ErrorKind::FileTooLarge);
        std::os::unix::fs::symlink(&file, &link).unwrap();
        drop(create_temporary(&link).unwrap());
        assert_eq!(std::fs::read(&file).unwrap(), b"four", "what the link led to");
        assert_eq!(std::fs::read(&link).unwrap(), b"");
    }
}
