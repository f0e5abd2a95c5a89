//! Whether two names lead to one file, through links of any kind.

use std::ffi::OsStr;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

use crate::output_file::folder_of;

/// Whether both names are of one file, or would be once it is there. Nothing is opened: a pipe would wait for its other end.
#[must_use]
pub fn is_same_file(one: &Path, other: &Path) -> bool {
    place(one).is_some_and(|found| place(other) == Some(found))
}

/// Device and inode of what is there, links followed; else those of the folder, and the name in it.
fn place(path: &Path) -> Option<(u64, u64, Option<&OsStr>)> {
    let at = |path| fs::metadata(path).map(|about| (about.dev(), about.ino()));
    match at(path) {
        Ok((device, inode)) => Some((device, inode, None)),
        Err(_) => {
            let (device, inode) = at(folder_of(path)).ok()?;
            Some((device, inode, Some(path.file_name()?)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_of_any_kind_are_seen_through() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b, hard, soft, none] = ["a", "b", "hard", "soft", "none"].map(|name| folder.path().join(name));
        fs::write(&a, "same text").unwrap();
        fs::write(&b, "same text").unwrap();
        fs::hard_link(&a, &hard).unwrap();
        std::os::unix::fs::symlink(&a, &soft).unwrap();
        assert!(is_same_file(&a, &a) && is_same_file(&a, &hard) && is_same_file(&soft, &hard));
        assert!(!is_same_file(&a, &b) && !is_same_file(&a, &none));
        // What is not there yet has a place all the same.
        let other_way = folder.path().join(".").join("none");
        assert!(is_same_file(&none, &other_way) && !is_same_file(&none, &folder.path().join("nothing")));
        let nowhere = folder.path().join("no/none");
        assert!(!is_same_file(&nowhere, &nowhere));
    }
}
