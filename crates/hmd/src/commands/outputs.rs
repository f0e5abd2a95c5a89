//! One guard for every path that a verb writes to.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

use super::Misuse;
use hmd_storage::metrics_file::may_replace;
use hmd_storage::regular_file::open_regular;
use hmd_storage::same_file::is_same_file;

/// What a verb writes into a file.
#[cfg_attr(
    not(feature = "full"),
    expect(dead_code, reason = "the flight build has fewer verbs")
)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Content {
    /// MCAP.
    Recording,
    /// Frames as text.
    Candump,
    /// Fault vectors of simulated windows.
    Truth,
    /// Table of `hmd export`.
    Csv,
    /// The same.
    Parquet,
    /// What a CSV file has no room for.
    Metadata,
    /// Report.
    Page,
    /// Report.
    Pdf,
    /// Of a unit or a type.
    Calibration,
    /// That of the demo.
    DemoConfiguration,
    /// Metrics of a run.
    Metrics,
}

impl Content {
    /// In words, and how a file of it begins; what an old release wrote, too.
    fn described(self) -> (&'static str, &'static [&'static [u8]]) {
        match self {
            Self::Recording => ("a recording (MCAP)", &[b"\x89MCAP"]),
            Self::Candump => ("a log of frames", &[b"("]),
            Self::Truth => ("the truth of a simulated log", &[b"{\"actuator\":"]),
            Self::Csv => ("a table of hmd export", &[b"t_start_ns,actuator,", b"t_ns,actuator,"]),
            Self::Parquet => ("a table of hmd export", &[b"PAR1"]),
            Self::Metadata => ("the metadata of a table", &[b"{"]),
            Self::Page => ("a page (HTML)", &[b"<!DOCTYPE html>"]),
            Self::Pdf => ("a PDF document", &[b"%PDF"]),
            Self::Calibration => ("a calibration", &[b"version = ", b"# Type "]),
            Self::DemoConfiguration => (
                "the configuration of a demo",
                &[b"[[actuator]]\nid = 0\ncalibration = "],
            ),
            Self::Metrics => ("a file of metrics", &[]),
        }
    }

    /// Whether it may take this place: there is nothing, an empty file, no regular file, or a file of the same content.
    fn may_replace(self, path: &Path) -> io::Result<bool> {
        if self == Self::Metrics {
            return Ok(may_replace(path));
        }
        if !std::fs::metadata(path).is_ok_and(|about| about.is_file() && about.len() > 0) {
            return Ok(true);
        }
        let mut file = open_regular(path)?;
        let mut start = Vec::new();
        file.by_ref().take(64).read_to_end(&mut start)?;
        let begins = |of: &&[u8]| start.starts_with(of);
        let (_, beginnings) = self.described();
        Ok(beginnings.iter().any(begins) && (self != Self::Parquet || has_our_columns(&mut file)?))
    }
}

/// Whether a Parquet file has the first columns of our tables: their names stand in its last bytes.
fn has_our_columns(file: &mut File) -> io::Result<bool> {
    const FOOTER: u64 = 1 << 16;
    let from = file.metadata()?.len().saturating_sub(FOOTER);
    file.seek(SeekFrom::Start(from))?;
    let mut end = Vec::new();
    file.take(FOOTER).read_to_end(&mut end)?;
    let has = |name: &[u8]| end.windows(name.len()).any(|bytes| bytes == name);
    Ok(has(b"actuator") && has(b"window") && (has(b"t_start_ns") || has(b"t_ns")))
}

/// What a verb is about to write, sidecars included.
pub(super) struct Outputs<'a>(pub(super) &'a [(&'a Path, Content)]);

impl Outputs<'_> {
    /// Refuses an output that is one of the files to be read, by whatever name or link, or another output; and one in the place of a file of
    /// another content.
    pub(super) fn check<P: AsRef<Path>>(&self, inputs: impl IntoIterator<Item = P>) -> Result<(), Misuse> {
        let outputs = || self.0.iter().map(|(path, _)| *path);
        for input in inputs {
            if let Some(output) = outputs().find(|output| is_same_file(output, input.as_ref())) {
                return Err(refusal("another output than a file that is read", output));
            }
        }
        for (n, output) in outputs().enumerate() {
            if outputs().take(n).any(|other| is_same_file(output, other)) {
                return Err(refusal("a file for each output", output));
            }
        }
        for (output, content) in self.0 {
            // What cannot be read is left as it is, too.
            if !content.may_replace(output).unwrap_or(false) {
                let ((what, _), output) = (content.described(), output.display());
                return Err(Misuse(format!(
                    "{output}: expected {what} or no file yet, found a file with other content"
                )));
            }
        }
        Ok(())
    }
}

fn refusal(expected: &str, output: &Path) -> Misuse {
    Misuse(format!("expected {expected}, found {}", output.display()))
}
