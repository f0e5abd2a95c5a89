//! Names of segments, and how a segment is recognised.

use std::fmt;
use std::io::{self, Read};
use std::path::Path;

use crate::regular_file::open_regular;

/// Profile in the header of every segment: a file without it is foreign, whatever its name.
pub(super) const PROFILE: &str = "hmd-segment";

/// What a segment holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    /// Raw frames, and which windows were dropped: what a replay needs.
    Raw,
    /// All other records.
    Records,
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Raw => "raw",
            Self::Records => "records",
        })
    }
}

/// How far a segment has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Stage {
    /// Finished.
    Closed,
    /// Being written, or cut.
    Open,
    /// The copy of a cut one, while it is repaired.
    Repair,
    /// A cut one as it was, kept because the repair lost more than the torn end.
    Damaged,
}

impl Stage {
    /// What follows `.mcap` in the name.
    fn suffix(self) -> &'static str {
        match self {
            Self::Closed => "",
            Self::Open => ".part",
            Self::Repair => ".repair",
            Self::Damaged => ".damaged",
        }
    }
}

/// Largest number that is read from a name: a segment each second for thirty million years. One above could leave no
/// numbers for those to come.
pub(super) const NUMBER_MAX: u64 = 999_999_999_999_999;

/// `hmd-00000012-raw.mcap`, with `.part` while it is written, `.repair` while it is repaired and
/// `.damaged` for what is kept of one that was damaged.
///
/// Numbers only grow, so the order of the names is that of the writing, whatever the clock was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Name {
    pub(super) number: u64,
    pub(super) kind: Kind,
    pub(super) stage: Stage,
}

impl Name {
    pub(super) fn parse(text: &str) -> Option<Self> {
        let ends = [Stage::Open, Stage::Repair, Stage::Damaged];
        let ended = ends
            .into_iter()
            .find_map(|stage| Some((text.strip_suffix(stage.suffix())?, stage)));
        let (rest, stage) = ended.unwrap_or((text, Stage::Closed));
        let (number, kind) = rest.strip_prefix("hmd-")?.strip_suffix(".mcap")?.split_once('-')?;
        let kind = match kind {
            "raw" => Kind::Raw,
            "records" => Kind::Records,
            _ => return None,
        };
        let name = Self {
            number: number.parse().ok().filter(|number| *number <= NUMBER_MAX)?,
            kind,
            stage,
        };
        // No second spelling of a number.
        (name.to_string() == text).then_some(name)
    }

    pub(super) fn with_stage(self, stage: Stage) -> Self {
        Self { stage, ..self }
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "hmd-{:08}-{}.mcap{}", self.number, self.kind, self.stage.suffix())
    }
}

/// Whether a regular file begins as a segment does. One that was cut within that beginning is not: nothing
/// in it identifies it.
pub(super) fn is_segment(path: &Path) -> io::Result<bool> {
    let start = start_of(path)?;
    Ok(start.len() == START_BYTES && is_start(&start))
}

/// Whether a regular file may be a segment of whose beginning a power cut left a part, zeros or nothing.
pub(super) fn has_torn_start(path: &Path) -> io::Result<bool> {
    let start = start_of(path)?;
    let is_cut = start.len() < START_BYTES && is_start(&start);
    Ok(is_cut || start.iter().all(|byte| *byte == 0))
}

/// Place of the profile: first in the header, behind the magic, the header's opcode and its length, which depends on the version that
/// wrote it.
const PROFILE_AT: usize = mcap::MAGIC.len() + 1 + 8;
/// Bytes that identify a segment: as far as the end of the profile.
const START_BYTES: usize = PROFILE_AT + 4 + PROFILE.len();

fn start_of(path: &Path) -> io::Result<Vec<u8>> {
    let mut start = Vec::new();
    open_regular(path)?.take(START_BYTES as u64).read_to_end(&mut start)?;
    Ok(start)
}

/// Whether these bytes, at most [`START_BYTES`], are how a segment begins.
fn is_start(start: &[u8]) -> bool {
    let magic = [mcap::MAGIC, &[mcap::records::op::HEADER]].concat();
    let profile = [&(PROFILE.len() as u32).to_le_bytes()[..], PROFILE.as_bytes()].concat();
    let (head, rest) = start.split_at(start.len().min(magic.len()));
    magic.starts_with(head) && profile.starts_with(rest.get(8..).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_read_as_it_is_written() {
        for text in [
            "hmd-00000012-raw.mcap",
            "hmd-123456789-records.mcap.part",
            "hmd-00000001-raw.mcap.repair",
            "hmd-00000001-raw.mcap.damaged",
            "hmd-999999999999999-raw.mcap",
        ] {
            assert_eq!(Name::parse(text).unwrap().to_string(), text);
        }
        for text in [
            "hmd-12-raw.mcap",
            "hmd-00000012-raw.mcap.bak",
            "hmd-00000012-other.mcap",
            "hmd-+0000012-raw.mcap",
            "hmd-00000012-raw.mcap.part.part",
            "hmd-1000000000000000-raw.mcap",
            "hmd-18446744073709551615-records.mcap",
            "flight.mcap",
        ] {
            assert_eq!(Name::parse(text), None, "{text}");
        }
    }

    #[test]
    fn the_header_identifies_a_segment() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let mut ours =
            crate::mcap_writer::McapWriter::with_profile(io::Cursor::new(Vec::new()), &Default::default(), PROFILE)
                .unwrap();
        ours.flush_window().unwrap();
        let ours = ours.finish().unwrap().0.into_inner();
        let is = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            is_segment(&path).unwrap()
        };
        let header = mcap::MAGIC.len() + 9 + 4 + PROFILE.len();
        for length in 0..ours.len() {
            assert_eq!(is(&ours[..length]), length >= header, "{length} bytes");
            assert_eq!(has_torn_start(&path).unwrap(), length < header, "{length} bytes");
        }
        let is_torn = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            has_torn_start(&path).unwrap()
        };
        assert!(is_torn(&[0; 4096]) && is_torn(&[0; 3]));
        assert!(!is_torn(b"a letter") && !is_torn(&[&[0; 20], &b"a letter"[..]].concat()));
        let other = crate::mcap_writer::McapWriter::new(io::Cursor::new(Vec::new()), &Default::default()).unwrap();
        assert!(!is(&other.finish().unwrap().0.into_inner()));
        assert!(!is(b"a letter"));
    }
}
