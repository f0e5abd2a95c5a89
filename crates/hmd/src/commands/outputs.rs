//! One guard for every path that a verb writes to.

use std::path::Path;

use super::Misuse;
use hmd_storage::mcap::is_mcap_file;
use hmd_storage::same_file::is_same_file;

/// What a verb is about to write, sidecars included.
#[derive(Default)]
pub(super) struct Outputs<'a> {
    /// Recordings; one that is there may be replaced.
    pub(super) recordings: &'a [&'a Path],
    /// Files of other kinds, which take no recording's place.
    pub(super) others: &'a [&'a Path],
}

impl Outputs<'_> {
    /// Refuses an output that is one of the files to be read, by whatever name or link, or another output; and one of another kind
    /// in the place of a recording.
    pub(super) fn check<P: AsRef<Path>>(&self, inputs: impl IntoIterator<Item = P>) -> Result<(), Misuse> {
        let outputs = || self.recordings.iter().chain(self.others).copied();
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
        match self.others.iter().find(|output| is_mcap_file(output)) {
            Some(output) => Err(refusal("an output that takes no recording's place", output)),
            None => Ok(()),
        }
    }
}

fn refusal(expected: &str, output: &Path) -> Misuse {
    Misuse(format!("expected {expected}, found {}", output.display()))
}
