//! A repair within a limit of work, which a start has.

use super::super::disk::RealDisk;
use super::super::tests::{chunks, cut_segment};
use super::*;
use mcap::records::op;

const NAME: Name = Name {
    number: 7,
    kind: super::super::name::Kind::Raw,
    stage: Stage::Open,
};

/// A folder with a cut segment of four chunks.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join(NAME.to_string()), cut_segment()).unwrap();
    folder
}

fn names(folder: &tempfile::TempDir) -> Vec<String> {
    let entries = fs::read_dir(folder.path()).unwrap();
    let mut names: Vec<_> = entries
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

fn mend(folder: &tempfile::TempDir, limit: Option<u64>) -> Found {
    let mut found = Found::within(Limits {
        expand_bytes_left: limit,
        ..Limits::default()
    });
    found.mend(folder.path(), NAME, &RealDisk);
    found
}

#[test]
fn a_repair_beyond_the_limit_is_postponed_and_leaves_no_copy() {
    let folder = folder();
    let before = fs::read(folder.path().join(NAME.to_string())).unwrap();
    let found = mend(&folder, Some(1000));
    assert_eq!(
        (found.pending.as_slice(), found.limits.expand_bytes_left),
        (&[NAME][..], Some(0))
    );
    assert_eq!(found.segments, BTreeMap::from([(NAME, before.len() as u64)]));
    assert!(found.messages.is_empty(), "{:?}", found.messages);
    assert_eq!(names(&folder), ["hmd-00000007-raw.mcap.part"]);
    assert_eq!(fs::read(folder.path().join(NAME.to_string())).unwrap(), before);
}

#[test]
fn each_repair_takes_what_it_expanded_from_what_the_next_ones_may() {
    let limit = 10 << 20;
    let folder = folder();
    let left = mend(&folder, Some(limit)).limits.expand_bytes_left.unwrap();
    // 2000 frames with eight bytes of data.
    let expanded = limit - left;
    assert!((16_000..200_000).contains(&expanded), "{expanded} bytes");
    assert_eq!(names(&folder), ["hmd-00000007-raw.mcap"]);
    // Just as much is enough, and one byte less is not.
    for (limit, pending) in [(expanded, 0), (expanded - 1, 1)] {
        let found = mend(&self::folder(), Some(limit));
        assert_eq!(
            (found.pending.len(), found.limits.expand_bytes_left),
            (pending, Some(0)),
            "{limit}"
        );
    }
    assert_eq!(
        mend(&self::folder(), None).limits.expand_bytes_left,
        None,
        "without a limit"
    );
}

#[test]
fn a_source_whose_copy_is_there_waits_for_the_background_too() {
    let folder = folder();
    let closed = NAME.with_stage(Stage::Closed).to_string();
    fs::write(folder.path().join(closed), cut_segment()).unwrap();
    let found = mend(&folder, Some(1000));
    assert_eq!(
        (found.pending.as_slice(), found.limits.expand_bytes_left),
        (&[NAME][..], Some(0))
    );
    assert_eq!(names(&folder), ["hmd-00000007-raw.mcap", "hmd-00000007-raw.mcap.part"]);
    let found = mend(&folder, Some(1 << 20));
    assert!(found.pending.is_empty() && found.limits.expand_bytes_left.is_some_and(|left| left < 1 << 20));
    assert_eq!(names(&folder), ["hmd-00000007-raw.mcap"]);
}

/// A disk that fails in one thing or two.
struct FailingDisk {
    /// It brings the names of a folder to the disk.
    syncs: bool,
    /// It removes files.
    removes: bool,
}

impl Disk for FailingDisk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn super::super::Out>> {
        RealDisk.create(path)
    }

    fn free_bytes(&self, folder: &Path) -> io::Result<u64> {
        RealDisk.free_bytes(folder)
    }

    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        if self.syncs {
            return RealDisk.sync_folder(folder);
        }
        Err(io::ErrorKind::Other.into())
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        if self.removes {
            return RealDisk.remove(path);
        }
        Err(io::ErrorKind::PermissionDenied.into())
    }
}

#[test]
fn a_copy_whose_name_is_not_safe_yet_is_counted_and_its_source_stays() {
    for removes in [true, false] {
        let folder = folder();
        let mut found = Found::within(Limits::default());
        found.mend(folder.path(), NAME, &FailingDisk { syncs: false, removes });
        assert_eq!(names(&folder), ["hmd-00000007-raw.mcap", "hmd-00000007-raw.mcap.part"]);
        let counted: Vec<Name> = found.segments.into_keys().collect();
        assert_eq!(counted, [NAME.with_stage(Stage::Closed)]);
        let (_, told) = &found.messages[0];
        assert!(told.contains("cannot be repaired"), "{told}");
        assert!(!told.contains("No such file"), "not why: {told}");
    }
}

/// The next start finds the copy, and tries again.
#[test]
fn a_source_that_cannot_be_removed_is_told_and_not_counted_beside_its_copy() {
    let folder = folder();
    let mut found = Found::within(Limits::default());
    let disk = FailingDisk {
        syncs: true,
        removes: false,
    };
    found.mend(folder.path(), NAME, &disk);
    let counted: Vec<Name> = found.segments.keys().copied().collect();
    assert_eq!(counted, [NAME.with_stage(Stage::Closed)]);
    let (_, told) = found.messages.last().unwrap();
    assert!(told.contains("hmd-00000007-raw.mcap.part cannot be removed"), "{told}");
    assert_eq!(names(&folder), ["hmd-00000007-raw.mcap", "hmd-00000007-raw.mcap.part"]);
}

/// It is the only one that has everything.
#[test]
fn a_damaged_source_stays_where_the_name_to_keep_it_under_is_in_use() {
    let folder = folder();
    let aside = folder.path().join(NAME.with_stage(Stage::Damaged).to_string());
    fs::write(&aside, "a letter").unwrap();
    let mut found = Found::within(Limits::default());
    found.dispose(folder.path(), NAME, false, &RealDisk);
    let (level, told) = found.messages.last().unwrap();
    assert!(*level == LogLevel::Error && told.ends_with("it stays"), "{told}");
    assert!(folder.path().join(NAME.to_string()).exists());
    assert_eq!(fs::read(aside).unwrap(), b"a letter");
}

#[test]
fn a_folder_that_goes_while_it_is_repaired_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let found = repair_one(&folder.path().join("gone"), NAME, &RealDisk, &Arc::default());
    let (_, told) = found.messages.last().unwrap();
    assert!(told.contains("damaged segments cannot be listed"), "{told}");
}

#[test]
fn a_source_that_was_deleted_for_room_meanwhile_is_no_failure() {
    let folder = tempfile::tempdir().unwrap();
    let found = repair_one(folder.path(), NAME, &RealDisk, &Arc::default());
    assert!(
        found.segments.is_empty() && found.messages.is_empty(),
        "{:?}",
        found.messages
    );
    let mut found = Found::within(Limits::default());
    for is_spent in [false, true] {
        found.dispose(folder.path(), NAME, is_spent, &RealDisk);
    }
    assert!(found.messages.is_empty(), "{:?}", found.messages);
}

#[test]
fn a_source_is_spent_when_it_lost_its_torn_end_alone() {
    let (file, place) = (cut_segment(), "hmd-00000007-raw.mcap.part");
    let spent = |bytes: &[u8]| {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(place), bytes).unwrap();
        let copied = copied(folder.path(), NAME, io::empty(), &Limits::default()).unwrap();
        copied.is_source_spent
    };
    let chunks = chunks(&file);
    assert!(spent(&file), "cut between two chunks");
    assert!(spent(&file[..chunks[3].0 + 100]), "cut in a chunk");
    let mut damaged = file.clone();
    damaged[(chunks[1].0 + chunks[1].1) / 2] ^= 1;
    assert!(!spent(&damaged), "a chunk lost on the way");
    assert!(!spent(&damaged[..chunks[3].0 + 100]), "that, and the end");
    assert!(!spent(&file[..chunks[0].0 + 100]), "its only chunk torn");
    // A length that reaches behind the file, with whole chunks behind it; the file was ended, but for its name.
    let ended = |opcode: u8, length: u64| [&[opcode], &length.to_le_bytes()[..], &vec![0; length as usize]].concat();
    let end = [ended(op::DATA_END, 4), ended(op::FOOTER, 20), mcap::MAGIC.to_vec()];
    let file = [file, end.concat()].concat();
    assert!(spent(&file), "ended");
    let mut damaged = file.clone();
    damaged[chunks[1].0 + 1 + 3] ^= 2;
    assert!(!spent(&damaged), "no torn end");
}
