//! Why files that were read to their ends have no record of a window.

use std::fmt;
use std::io::{Read, Seek};
use std::sync::Arc;

use super::fault::McapLoss;
use super::messages::McapMessages;
use crate::mcap_writer::METADATA_NAME;

/// Files in which no record of a window was found, and why.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct NoWindows {
    files: Vec<Arc<str>>,
    /// The first file that cannot have any, or of which that is not known, and why.
    cause: Option<Box<(Arc<str>, Cause)>>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Cause {
    /// Damaged, cut, or no MCAP file.
    Loss(McapLoss),
    /// Not written by `hmd`.
    Foreign,
    /// Frames that nothing has assessed.
    FramesAlone,
}

impl NoWindows {
    /// Notes a file whose messages were all read, and the first loss among them.
    pub fn note<R: Read + Seek>(&mut self, messages: &McapMessages<R>) {
        let file = messages.file().clone();
        let of_metadata = || messages.verified_metadata(METADATA_NAME).err();
        let cause = if let Some(loss) = messages.first_loss().cloned().or_else(of_metadata) {
            Some(Cause::Loss(loss))
        } else if !messages.is_own_file() {
            Some(Cause::Foreign)
        } else {
            is_frames_alone(messages).then_some(Cause::FramesAlone)
        };
        if self.cause.is_none() {
            self.cause = cause.map(|cause| Box::new((file.clone(), cause)));
        }
        self.files.push(file);
    }

    /// Whether all files are whole recordings of assessed frames: they have no window because no actuation was recorded.
    #[must_use]
    pub fn is_without_actuation(&self) -> bool {
        self.cause.is_none()
    }
}

/// Whether a recording has frames that nothing has assessed: of `hmd record`, a raw segment, a simulated log.
fn is_frames_alone<R: Read + Seek>(messages: &McapMessages<R>) -> bool {
    let metadata = messages.metadata(METADATA_NAME);
    let has_configuration = metadata.is_some_and(|metadata| metadata.contains_key("config_hash"));
    let is_raw = metadata.is_some_and(|metadata| metadata.get("segment_kind").is_some_and(|kind| kind == "raw"));
    !has_configuration || is_raw || messages.topics().iter().all(|topic| topic.starts_with("/bus/"))
}

impl fmt::Display for NoWindows {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const FOUND: &str = "expected records of windows, found none";
        match self.cause.as_deref() {
            None => write!(f, "{}: {FOUND}: no actuation was recorded", self.files.join(", ")),
            Some((file, Cause::Loss(loss))) => write!(f, "{file}: {FOUND}: at byte {}: {}", loss.at_byte, loss.fault),
            Some((file, Cause::Foreign)) => write!(f, "{file}: {FOUND}: it is a file of another program"),
            Some((file, Cause::FramesAlone)) => write!(
                f,
                "{file}: {FOUND}: it has frames alone, of which hmd replay LOG -o OUT.mcap makes records"
            ),
        }
    }
}

impl std::error::Error for NoWindows {}
