//! Names of segments, and how one of ours is known again.

use std::fmt;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Profile in the header of every segment: a file without it is somebody else's, whatever its name.
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
}

/// `hmd-00000012-raw.mcap`, with `.part` while it is written and `.repair` while it is repaired.
///
/// Numbers only grow, so the order of the names is that of the writing, whatever the clock said.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Name {
    pub(super) number: u64,
    pub(super) kind: Kind,
    pub(super) stage: Stage,
}

impl Name {
    pub(super) fn parse(text: &str) -> Option<Self> {
        let (rest, stage) = match text.strip_suffix(".part") {
            Some(rest) => (rest, Stage::Open),
            None => match text.strip_suffix(".repair") {
                Some(rest) => (rest, Stage::Repair),
                None => (text, Stage::Closed),
            },
        };
        let (number, kind) = rest.strip_prefix("hmd-")?.strip_suffix(".mcap")?.split_once('-')?;
        let kind = match kind {
            "raw" => Kind::Raw,
            "records" => Kind::Records,
            _ => return None,
        };
        let name = Self {
            number: number.parse().ok()?,
            kind,
            stage,
        };
        // No second spelling of a number.
        (name.to_string() == text).then_some(name)
    }

    pub(super) fn at(self, stage: Stage) -> Self {
        Self { stage, ..self }
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let end = match self.stage {
            Stage::Closed => "",
            Stage::Open => ".part",
            Stage::Repair => ".repair",
        };
        write!(f, "hmd-{:08}-{}.mcap{end}", self.number, self.kind)
    }
}

/// Whether a file begins as a segment of ours does. One that was cut within that beginning is ours too: it is empty.
pub(super) fn is_ours(path: &Path) -> io::Result<bool> {
    let mut expected = mcap::MAGIC.to_vec();
    expected.push(mcap::records::op::HEADER);
    // The length of the header record depends on the version that wrote it; the profile comes first in it.
    let profile_at = expected.len() + 8;
    let mut profile = (PROFILE.len() as u32).to_le_bytes().to_vec();
    profile.extend(PROFILE.as_bytes());
    let mut start = Vec::new();
    let most = (profile_at + profile.len()) as u64;
    File::open(path)?.take(most).read_to_end(&mut start)?;
    let begins = |found: &[u8], expected: &[u8]| found.iter().zip(expected).all(|(a, b)| a == b);
    Ok(begins(&start, &expected) && begins(start.get(profile_at..).unwrap_or_default(), &profile))
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
        ] {
            assert_eq!(Name::parse(text).unwrap().to_string(), text);
        }
        for text in [
            "hmd-12-raw.mcap",
            "hmd-00000012-raw.mcap.bak",
            "hmd-00000012-other.mcap",
            "hmd-+0000012-raw.mcap",
            "hmd-00000012-raw.mcap.part.part",
            "flight.mcap",
        ] {
            assert_eq!(Name::parse(text), None, "{text}");
        }
    }

    #[test]
    fn the_header_tells_whose_a_file_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let mut ours =
            crate::sink::Sink::with_profile(io::Cursor::new(Vec::new()), &Default::default(), PROFILE).unwrap();
        ours.flush_window().unwrap();
        let ours = ours.finish().unwrap().0.into_inner();
        let is = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            is_ours(&path).unwrap()
        };
        for length in 0..ours.len() {
            assert!(is(&ours[..length]), "{length} bytes");
        }
        let other = crate::sink::Sink::new(io::Cursor::new(Vec::new()), &Default::default()).unwrap();
        assert!(!is(&other.finish().unwrap().0.into_inner()));
        assert!(!is(b"a letter"));
    }
}
