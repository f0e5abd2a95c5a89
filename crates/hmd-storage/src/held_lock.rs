//! A lock of a file or folder that ends with its owner.

use std::fs::{File, TryLockError};
use std::io;

/// An open file or folder that no other process has locked meanwhile.
///
/// The lock is given back when this is dropped. Closing the file alone would not do: a process that is being started has a copy of each open
/// file until it becomes another program, and the lock lasts as long as any copy.
#[derive(Debug)]
pub struct HeldLock(File);

impl HeldLock {
    /// Locks `file` without waiting; `None` where another has it.
    ///
    /// # Errors
    /// Those of the operating system.
    pub(crate) fn take(file: File) -> io::Result<Option<Self>> {
        match file.try_lock() {
            Ok(()) => Ok(Some(Self(file))),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(cause)) => Err(cause),
        }
    }

    /// What is locked.
    pub(crate) fn file(&self) -> &File {
        &self.0
    }
}

impl Drop for HeldLock {
    fn drop(&mut self) {
        // An error leaves the lock to the closing of the file.
        let _ = self.0.unlock();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dropped_lock_is_free_though_a_copy_of_its_file_is_open() {
        let folder = tempfile::tempdir().unwrap();
        let open = || File::open(folder.path()).unwrap();
        let held = HeldLock::take(open()).unwrap().unwrap();
        assert!(HeldLock::take(open()).unwrap().is_none());
        let _copy = held.file().try_clone().unwrap();
        drop(held);
        assert!(HeldLock::take(open()).unwrap().is_some());
    }
}
