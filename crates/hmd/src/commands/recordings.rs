//! Files of the recordings that a verb reads: those named, and of a folder those in it.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use hmd_ingest::open;
use hmd_storage::segment_store::{Segment, raw_segments, records_segments};

/// What a verb reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// Frames.
    Logs,
    /// Records of windows.
    Records,
}

/// Extensions of logs in a folder; a file that is named is recognised by its content.
const LOGS: [&str; 5] = ["log", "mcap", "asc", "blf", "mf4"];

/// Extensions of tables, which are logs where a folder has no others: an export may lie beside them.
const TABLES: [&str; 2] = ["csv", "parquet"];

/// The files named; for a folder its recordings in the order of their names, which for segments of `hmd run` is that of time. A file that
/// is named twice, as by a folder and a glob, is there once.
///
/// # Errors
/// A folder that cannot be read, or has no recording.
pub fn recordings(paths: &[PathBuf], wanted: Wanted) -> anyhow::Result<Vec<PathBuf>> {
    let mut found = Vec::with_capacity(paths.len());
    for path in paths {
        if path.is_dir() {
            found.extend(in_folder(path, wanted)?);
        } else {
            found.push(path.clone());
        }
    }
    let mut known = BTreeSet::new();
    // One that cannot be resolved cannot be opened either, which is said where it is tried.
    found.retain(|path| fs::canonicalize(path).map_or(true, |resolved| known.insert(resolved)));
    Ok(found)
}

/// Why a file of a folder is none of its recordings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PassedOver {
    /// A table in a folder that has logs which are none: an export may lie beside them.
    TableBesideLogs,
    /// In a folder of `hmd run`, whose raw segments are the logs.
    OfRun,
    /// Its name ends as that of no log.
    Name,
}

impl fmt::Display for PassedOver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TableBesideLogs => "table beside other logs",
            Self::OfRun => "other file in a folder of hmd run, whose raw segments are the logs",
            Self::Name => "name that ends in none of .log, .mcap, .asc, .blf, .mf4, .csv, .parquet",
        })
    }
}

/// The files in a folder, by name: which stand for it, and which do not.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FolderContent {
    /// Its recordings, in the order of time as far as names have one.
    pub recordings: Vec<PathBuf>,
    /// All other files.
    pub passed_over: Vec<(PathBuf, PassedOver)>,
}

/// Whether a log of this name is one of measured signals alone, which needs a section `[map]`.
#[must_use]
pub fn is_table(path: &Path) -> bool {
    ends_in(path, &TABLES)
}

/// The logs of a folder, none of those of the folders in it. A link to nothing is there, as its name is.
///
/// # Errors
/// A folder that cannot be read.
pub fn logs_of_folder(folder: &Path) -> anyhow::Result<FolderContent> {
    let name = || folder.display().to_string();
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).with_context(name)? {
        let path = entry.with_context(name)?.path();
        if !path.is_dir() {
            files.push(path);
        }
    }
    files.sort_unstable();
    chosen(folder, files, Wanted::Logs)
}

fn ends_in(path: &Path, extensions: &[&str]) -> bool {
    let extension = path.extension().and_then(OsStr::to_str).unwrap_or_default();
    extensions.iter().any(|of| extension.eq_ignore_ascii_case(of))
}

/// Of the files of a folder those that a verb reads.
fn chosen(folder: &Path, files: Vec<PathBuf>, wanted: Wanted) -> anyhow::Result<FolderContent> {
    let name = || folder.display().to_string();
    let mut content = FolderContent::default();
    // Those of a daemon, the ones in progress included.
    let [raw, records] = [raw_segments(folder), records_segments(folder, 0)].map(|found| found.with_context(name));
    let [raw, records] = [raw?, records?];
    if !raw.is_empty() || !records.is_empty() {
        let own = if wanted == Wanted::Logs { raw } else { records };
        // One that was just begun has no frame yet.
        let has_begun =
            |segment: &Segment| wanted == Wanted::Records || !segment.is_open || open(&segment.path).is_ok();
        let begun = own.into_values().filter(has_begun);
        content.recordings = begun.map(|segment| segment.path).collect();
        let known: BTreeSet<&PathBuf> = content.recordings.iter().collect();
        let others = files.into_iter().filter(|path| !known.contains(path));
        content.passed_over = others.map(|path| (path, PassedOver::OfRun)).collect();
    } else {
        let extensions = match wanted {
            Wanted::Records => &LOGS[1..2],
            Wanted::Logs if files.iter().any(|path| ends_in(path, &LOGS)) => &LOGS[..],
            Wanted::Logs => &TABLES[..],
        };
        for path in files {
            if ends_in(&path, extensions) {
                content.recordings.push(path);
            } else if is_table(&path) {
                content.passed_over.push((path, PassedOver::TableBesideLogs));
            } else {
                content.passed_over.push((path, PassedOver::Name));
            }
        }
    }
    Ok(content)
}

fn in_folder(folder: &Path, wanted: Wanted) -> anyhow::Result<Vec<PathBuf>> {
    let name = || folder.display().to_string();
    let (mut files, mut has_folders) = (Vec::new(), false);
    for entry in fs::read_dir(folder).with_context(name)? {
        let path = entry.with_context(name)?.path();
        has_folders |= path.is_dir();
        if path.is_file() {
            files.push(path);
        }
    }
    files.sort_unstable();
    let files = chosen(folder, files, wanted)?.recordings;
    if files.is_empty() {
        let inner = if has_folders {
            "; the folders in it are read where they are named"
        } else {
            ""
        };
        let expected = match wanted {
            Wanted::Logs => "logs (.log, .mcap, .asc, .blf, .mf4, .csv, .parquet)",
            Wanted::Records => "records (.mcap)",
        };
        bail!("{}: expected {expected} in this folder, found none{inner}", name());
    }
    Ok(files)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::time::Instant;

    use hmd_core::config::Config;
    use hmd_core::frame::{BusNames, FrameFlags, RawFrame};
    use hmd_storage::segment_store::{RealDisk, SegmentStore};

    use super::*;

    #[test]
    fn a_folder_stands_for_its_recordings() {
        let folder = tempfile::tempdir().unwrap();
        let of = |paths: &[PathBuf], wanted| {
            let found = recordings(paths, wanted).map_err(|error| error.to_string())?;
            let name = |path: PathBuf| path.file_name().unwrap().to_str().unwrap().to_owned();
            Ok::<Vec<_>, String>(found.into_iter().map(name).collect())
        };
        let path = [folder.path().to_owned()];
        let none = of(&path, Wanted::Records).unwrap_err();
        assert!(
            none.ends_with("expected records (.mcap) in this folder, found none"),
            "{none}"
        );
        fs::write(folder.path().join("z.csv"), "x").unwrap();
        assert_eq!(of(&path, Wanted::Logs).unwrap(), ["z.csv"]);
        let write = |name: &str| fs::write(folder.path().join(name), "x").unwrap();
        for name in ["b.log", "a.BLF", "c.mcap", "b.log.truth.jsonl", "hmd.toml"] {
            write(name);
        }
        fs::create_dir(folder.path().join("d.log")).unwrap();
        let outer = tempfile::tempdir().unwrap();
        fs::create_dir(outer.path().join("unit")).unwrap();
        let none = of(&[outer.path().to_owned()], Wanted::Logs).unwrap_err();
        assert!(
            none.ends_with("found none; the folders in it are read where they are named"),
            "{none}"
        );
        let passed_over = logs_of_folder(folder.path()).unwrap().passed_over;
        let passed_over = passed_over
            .iter()
            .map(|(path, why)| (path.file_name().unwrap().to_str().unwrap(), *why));
        assert_eq!(
            passed_over.collect::<Vec<_>>(),
            [
                ("b.log.truth.jsonl", PassedOver::Name),
                ("hmd.toml", PassedOver::Name),
                ("z.csv", PassedOver::TableBesideLogs)
            ]
        );
        assert_eq!(of(&path, Wanted::Logs).unwrap(), ["a.BLF", "b.log", "c.mcap"]);
        assert_eq!(of(&path, Wanted::Records).unwrap(), ["c.mcap"]);
        let twice = [
            folder.path().join("c.mcap"),
            folder.path().to_owned(),
            folder.path().join("./b.log"),
        ];
        assert_eq!(of(&twice, Wanted::Logs).unwrap(), ["c.mcap", "a.BLF", "b.log"]);
        let limits = Config::default().output().limits();
        let store = SegmentStore::open(
            folder.path(),
            &BTreeMap::new(),
            limits,
            Box::new(RealDisk),
            Instant::now(),
        );
        let mut store = store.unwrap();
        let mut names = BusNames::new();
        names.intern("can0").unwrap();
        let frame = RawFrame::new(1, 0, 1, FrameFlags::NONE, &[]).unwrap();
        store.write_frame(&frame, &names);
        assert!(of(&path, Wanted::Logs).is_err(), "its frame is not on the disk yet");
        store.tick(Instant::now());
        let part = ["hmd-00000001-raw.mcap.part"];
        assert_eq!(of(&path, Wanted::Logs).unwrap(), part, "what is being written, too");
        store.finish();
        assert_eq!(of(&path, Wanted::Logs).unwrap(), ["hmd-00000001-raw.mcap"]);
        assert_eq!(of(&path, Wanted::Records).unwrap(), ["hmd-00000000-records.mcap"]);
        let file = [folder.path().join("named")];
        assert_eq!(of(&file, Wanted::Logs).unwrap(), ["named"]);
    }
}
