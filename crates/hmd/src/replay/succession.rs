//! How the logs of a replay follow each other: segments of one run, or recordings of their own.

use hmd_core::metadata_checksum::is_sealed;
use hmd_ingest::file::FrameSource;
use hmd_storage::mcap_writer::METADATA_NAME;

/// How a log follows the one before.
pub(super) enum Succession {
    /// The next segment of the same run, and none lost between.
    Next,
    /// A run of its own, or another capture of the same run.
    AnotherRun,
    /// A log that does not say, or a segment behind a lost one: what is missing between them is counted.
    Unknown,
}

/// The segment read last, if it was one: its run and its number.
#[derive(Debug, Default)]
pub(super) struct LastSegment(Option<(String, u64)>);

impl LastSegment {
    /// How a log follows the one before.
    pub(super) fn succession(&mut self, source: &FrameSource) -> Succession {
        let metadata = source
            .metadata(METADATA_NAME)
            .filter(|found| is_sealed(METADATA_NAME, found));
        let segment = metadata.and_then(|found| {
            let number = found.get("segment")?.parse().ok()?;
            Some((found.get("run")?.clone(), number))
        });
        let succession = match (&self.0, &segment) {
            (Some((before, last)), Some((run, number))) if before == run => {
                if last.checked_add(1) == Some(*number) {
                    Succession::Next
                } else {
                    Succession::Unknown
                }
            }
            (Some(_), Some(_)) => Succession::AnotherRun,
            _ => Succession::Unknown,
        };
        self.0 = segment;
        succession
    }
}
