//! Why a replay failed.

use std::io;

use hmd_core::assess::AssessError;
use hmd_core::counted::counted;
use hmd_core::demux::FrameCounts;
use hmd_ingest::file::IngestError;
use hmd_storage::event_file::EventError;
use hmd_storage::recorder::RecordError;

/// Why a replay failed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// A log cannot be read at all.
    #[error(transparent)]
    Ingest(#[from] IngestError),
    /// The windows cannot be assessed.
    #[error(transparent)]
    Assess(#[from] AssessError),
    /// The maintenance events cannot be read.
    #[error("rul.events: {0}")]
    Events(#[from] EventError),
    /// The output is a log, the configuration or a file that it names.
    #[error("{path}: expected another output than a file that is read, found one")]
    OutputIsInput {
        /// The file.
        path: String,
    },
    /// The records cannot be written.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// Stdout cannot be written.
    #[error("stdout: {0}")]
    Stdout(io::Error),
    /// No frame of an actuator that is watched.
    #[error("{logs}: expected frames of {expected}, found none ({found})")]
    NoActuator {
        /// The logs.
        logs: String,
        /// What is watched.
        expected: String,
        /// What there was instead.
        found: String,
    },
    /// Frames, but no three that make a sample.
    #[error(
        "{logs}: expected currents, position and command of one sample, found {}",
        parts(found)
    )]
    NoSample {
        /// The logs.
        logs: String,
        /// Frames by what they carry.
        found: FrameCounts,
    },
}

/// Frames of the built-in dictionary by what they carry; those of others, of which a notice says what they lack, by their number alone.
fn parts(found: &FrameCounts) -> String {
    if found.currents + found.position + found.command == 0 {
        return format!("none in {} that are known", counted(found.decoded, "frame", "frames"));
    }
    let with_currents = counted(found.currents, "frame", "frames");
    format!(
        "{with_currents} with currents, {} with position, {} with command, and no three that belong together",
        found.position, found.command
    )
}
