//! Whether two names lead to one file, through links of any kind.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Whether both are there and are the same file. Neither is opened: a pipe would wait for its other end.
#[must_use]
pub fn is_same_file(one: &Path, other: &Path) -> bool {
    let place = |path| fs::metadata(path).map(|about| (about.dev(), about.ino())).ok();
    place(one).is_some_and(|found| place(other) == Some(found))
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
        assert!(!is_same_file(&a, &b) && !is_same_file(&a, &none) && !is_same_file(&none, &none));
    }
}
