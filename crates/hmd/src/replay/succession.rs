//! How the logs of a replay follow each other: segments of one run, or recordings of their own.

use std::path::{Path, PathBuf};

use hmd_core::metadata_checksum::is_sealed;
use hmd_ingest::file::FrameSource;
use hmd_storage::mcap_writer::METADATA_NAME;
use hmd_storage::segment_store::raw_segment_number;

/// How a log follows the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Succession {
    /// The next segment of the same run, and none lost between.
    Next,
    /// A run of its own, or another capture of the same run.
    AnotherRun,
    /// A segment of the same run behind a lost one: what is missing between them is counted.
    AfterGap,
    /// A log that does not say.
    Unknown,
}

/// The segment read last, if it was one.
#[derive(Debug, Default)]
pub(super) struct LastSegment(Option<Segment>);

#[derive(Debug)]
struct Segment {
    run: String,
    /// Number in the run.
    number: u64,
    /// Its folder, and the number of its file there.
    file: Option<(PathBuf, u64)>,
}

impl Segment {
    fn of(log: &Path, source: &FrameSource) -> Option<Self> {
        let metadata = source
            .metadata(METADATA_NAME)
            .filter(|found| is_sealed(METADATA_NAME, found))?;
        Some(Self {
            run: metadata.get("run")?.clone(),
            number: metadata.get("segment")?.parse().ok()?,
            file: raw_segment_number(log).map(|number| (log.parent().unwrap_or(Path::new("")).to_owned(), number)),
        })
    }

    /// Whether it was written after another segment of the same folder: their stamps may say otherwise, where the clock was set back.
    fn is_after(&self, before: &Self) -> bool {
        let files = self.file.as_ref().zip(before.file.as_ref());
        files.is_some_and(|((folder, number), (before, last))| folder == before && number > last)
    }
}

impl LastSegment {
    /// How a log follows the one before, and whether no frame of it can be one of those before, whatever their stamps say.
    pub(super) fn succession(&mut self, log: &Path, source: &FrameSource) -> (Succession, bool) {
        let segment = Segment::of(log, source);
        let succession = match (&self.0, &segment) {
            (Some(before), Some(next)) if before.run == next.run => {
                if before.number.checked_add(1) == Some(next.number) {
                    Succession::Next
                } else {
                    Succession::AfterGap
                }
            }
            (Some(_), Some(_)) => Succession::AnotherRun,
            _ => Succession::Unknown,
        };
        let both = self.0.as_ref().zip(segment.as_ref());
        let is_after = succession == Succession::Next || both.is_some_and(|(before, next)| next.is_after(before));
        self.0 = segment;
        (succession, is_after)
    }
}
