//! The segments in a folder, for those who only read.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use super::name::{Kind, Name, Stage, is_segment};

/// A segment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Segment {
    /// Where it is now; it loses its `.part` when it is closed, and goes when there is no room.
    pub path: PathBuf,
    /// Being written, or left by a run that did not end.
    pub is_open: bool,
}

/// Where a segment is that may have been closed since it was listed: without its `.part` if there is none of that name any more.
#[must_use]
pub fn current_path(path: &Path) -> PathBuf {
    let was_open = path.extension().is_some_and(|end| end == "part");
    if was_open && !path.exists() {
        path.with_extension("")
    } else {
        path.to_owned()
    }
}

/// The segments with records from number `first` on; the numbers are the order of their writing. Nothing is locked or changed.
///
/// # Errors
/// When the folder cannot be listed.
pub fn records_segments(folder: &Path, first: u64) -> io::Result<BTreeMap<u64, Segment>> {
    segments(folder, first, Kind::Records)
}

/// The number of a file with raw frames, by its name: a segment with a higher one was written later, whatever the clock.
#[must_use]
pub fn raw_segment_number(path: &Path) -> Option<u64> {
    let name = path.file_name()?.to_str().and_then(Name::parse)?;
    is_source(name, Kind::Raw).then_some(name.number)
}

/// The segments with raw frames, in the order of their writing. Nothing is locked or changed.
///
/// # Errors
/// When the folder cannot be listed.
pub fn raw_segments(folder: &Path) -> io::Result<BTreeMap<u64, Segment>> {
    segments(folder, 0, Kind::Raw)
}

fn segments(folder: &Path, first: u64, kind: Kind) -> io::Result<BTreeMap<u64, Segment>> {
    let mut segments = BTreeMap::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name().to_str().and_then(Name::parse);
        let Some(name) = name.filter(|name| is_source(*name, kind) && name.number >= first) else {
            continue;
        };
        // A file that has gone or is foreign is skipped.
        if !is_segment(&entry.path()).unwrap_or(false) {
            continue;
        }
        let is_open = name.stage == Stage::Open;
        // Between a repair and the end of its source there are both.
        if is_open && segments.contains_key(&name.number) {
            continue;
        }
        let path = entry.path();
        segments.insert(name.number, Segment { path, is_open });
    }
    Ok(segments)
}

/// Whether it is of a kind, and no copy that is being made or was kept.
fn is_source(name: Name, kind: Kind) -> bool {
    name.kind == kind && matches!(name.stage, Stage::Open | Stage::Closed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mcap_writer::McapWriter;

    #[test]
    fn only_our_records_are_listed_in_their_order() {
        let folder = tempfile::tempdir().unwrap();
        let profile = super::super::name::PROFILE;
        let writer = McapWriter::with_profile(io::Cursor::new(Vec::new()), &Default::default(), profile).unwrap();
        let ours = writer.finish().unwrap().0.into_inner();
        for name in [
            "hmd-00000002-records.mcap",
            "hmd-00000002-records.mcap.part",
            "hmd-00000010-records.mcap.part",
            "hmd-00000001-records.mcap.repair",
            "hmd-00000001-records.mcap.damaged",
            "hmd-00000003-raw.mcap",
        ] {
            std::fs::write(folder.path().join(name), &ours).unwrap();
        }
        std::fs::write(folder.path().join("hmd-00000004-records.mcap"), b"a letter").unwrap();
        // Whoever opens it waits for its other end.
        let fifo = folder.path().join("hmd-00000005-records.mcap.part");
        nix::unistd::mkfifo(&fifo, nix::sys::stat::Mode::S_IRWXU).unwrap();
        let found = records_segments(folder.path(), 0).unwrap();
        let open: Vec<_> = found
            .iter()
            .map(|(number, segment)| (*number, segment.is_open))
            .collect();
        assert_eq!(open, [(2, false), (10, true)]);
        assert_eq!(records_segments(folder.path(), 3).unwrap().len(), 1);
    }

    fn segment() -> Vec<u8> {
        let profile = super::super::name::PROFILE;
        let writer = McapWriter::with_profile(io::Cursor::new(Vec::new()), &Default::default(), profile).unwrap();
        writer.finish().unwrap().0.into_inner()
    }

    /// The order in which a folder lists its files is that of no rule.
    #[test]
    fn of_a_source_and_its_finished_copy_the_copy_is_listed() {
        let folder = tempfile::tempdir().unwrap();
        for number in 0..64_u64 {
            let mut names = [
                format!("hmd-{number:08}-raw.mcap"),
                format!("hmd-{number:08}-raw.mcap.part"),
            ];
            if number % 2 == 1 {
                names.reverse();
            }
            names
                .iter()
                .for_each(|name| std::fs::write(folder.path().join(name), segment()).unwrap());
        }
        let found = raw_segments(folder.path()).unwrap();
        assert_eq!(found.len(), 64);
        for (number, segment) in found {
            let path = folder.path().join(format!("hmd-{number:08}-raw.mcap"));
            assert_eq!(segment, Segment { path, is_open: false });
        }
    }

    #[test]
    fn a_segment_that_was_closed_since_it_was_listed_is_found_under_its_closed_name() {
        let folder = tempfile::tempdir().unwrap();
        let place = |name: &str| folder.path().join(name);
        let (open, closed) = ("hmd-00000001-raw.mcap.part", "hmd-00000002-raw.mcap");
        [open, closed]
            .iter()
            .for_each(|name| std::fs::write(place(name), segment()).unwrap());
        // The last one was deleted for room.
        for (listed, now) in [
            (open, open),
            ("hmd-00000002-raw.mcap.part", closed),
            (closed, closed),
            ("hmd-00000003-raw.mcap", "hmd-00000003-raw.mcap"),
        ] {
            assert_eq!(current_path(&place(listed)), place(now), "{listed}");
        }
    }

    #[test]
    fn only_segments_of_frames_have_a_place_in_their_order() {
        let of = |name: &str| raw_segment_number(Path::new("folder").join(name).as_path());
        assert_eq!(of("hmd-00000012-raw.mcap"), Some(12));
        assert_eq!(of("hmd-00000012-raw.mcap.part"), Some(12));
        for other in [
            "hmd-00000012-records.mcap",
            "hmd-00000012-raw.mcap.damaged",
            "hmd-00000012-raw.mcap.repair",
            "flight.mcap",
        ] {
            assert_eq!(of(other), None, "{other}");
        }
    }
}
