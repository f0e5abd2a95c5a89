//! Why a log cannot be used at all.

use std::io;

use thiserror::Error;

use crate::Loss;

/// Formats that are recognised.
#[cfg(feature = "signals")]
pub(super) const FORMATS: &str = "candump, MCAP, ASC, BLF, MF4, CSV, Parquet";
#[cfg(not(feature = "signals"))]
pub(super) const FORMATS: &str = "candump, MCAP, ASC, BLF, MF4";

/// Why a file cannot be used at all.
#[derive(Debug, Error)]
pub enum IngestError {
    /// The file cannot be opened or read.
    #[error("{file}: expected a readable file, found: {cause}")]
    Unreadable {
        /// The path.
        file: String,
        /// What the system says.
        cause: io::Error,
    },
    /// The path is a directory.
    #[error("{file}: expected a file, found a directory")]
    Directory {
        /// The path.
        file: String,
    },
    /// The file has no bytes.
    #[error("{file}: expected a log of a format that is known ({FORMATS}), found an empty file")]
    Empty {
        /// The path.
        file: String,
    },
    /// An MCAP or MF4 file comes through a pipe.
    #[error("{file}: expected a file that can be sought, found an MCAP or MF4 stream in a pipe")]
    NotSeekable {
        /// The path.
        file: String,
    },
    /// A text (or anything else) without one line that is a frame.
    #[error("{file}: expected a log of a format that is known ({FORMATS}), found no valid line in {lines}{}", first.as_ref().map(|loss| format!("; the first: {loss}")).unwrap_or_default())]
    NoGoodLine {
        /// The path.
        file: String,
        /// Lines looked at.
        lines: u64,
        /// The first bad line.
        first: Option<Box<Loss>>,
    },
    /// Neither text nor MCAP.
    #[error(
        "{file}: expected a log of a format that is known ({FORMATS}), found binary data starting with \"{found}\""
    )]
    Binary {
        /// The path.
        file: String,
        /// The first bytes, escaped.
        found: String,
    },
    /// A compressed file.
    #[error("{file}: expected a log of a format that is known ({FORMATS}), found {format} data; decompress it first")]
    Compressed {
        /// The path.
        file: String,
        /// Name of the compression.
        format: &'static str,
    },
    /// A text in another encoding.
    #[error("{file}: expected a log of a format that is known ({FORMATS}), found text as UTF-16; save it as UTF-8")]
    Utf16 {
        /// The path.
        file: String,
    },
    /// Frames in a format that is not read.
    #[error(
        "{file}: expected a log of a format that is known ({FORMATS}), found {format}; convert it to BLF, as python-can's can_logconvert does"
    )]
    Foreign {
        /// The path.
        file: String,
        /// What the format is called.
        format: &'static str,
    },
    /// A log of another program without one frame.
    #[error("{file}: expected frames in this {format} file, found none{}", first.as_ref().map(|loss| format!("; {loss}")).unwrap_or_default())]
    NoForeignFrame {
        /// The path.
        file: String,
        /// Its format.
        format: &'static str,
        /// The first thing that could not be read.
        first: Option<Box<Loss>>,
    },
    /// A log of measured signals, and nothing says what they are.
    #[error(
        "{file}: expected a configuration with a section [map] for a log of measured signals, found none; hmd map writes one"
    )]
    NoMap {
        /// The path.
        file: String,
    },
    /// A log of measured signals that the map does not fit, or that cannot be read at all.
    #[error("{file}: {cause}")]
    Unusable {
        /// The path.
        file: String,
        /// What is expected and found.
        cause: String,
    },
    /// A log of measured signals without one row that is a sample.
    #[error("{file}: expected rows with all mapped signals, found none{}", first.as_ref().map(|loss| format!("; {loss}")).unwrap_or_default())]
    NoRow {
        /// The path.
        file: String,
        /// The first thing that could not be read.
        first: Option<Box<Loss>>,
    },
    /// An MCAP file without raw frames.
    #[error(
        "{file}: expected raw frames (schema hmd.v1.RawBatch) on topics /bus/<interface>/raw, found {}",
        found(topics, first)
    )]
    NoFrames {
        /// The path.
        file: String,
        /// Topics of the file.
        topics: Vec<String>,
        /// The first thing that could not be read.
        first: Option<Box<Loss>>,
    },
}

fn found(topics: &[String], first: &Option<Box<Loss>>) -> String {
    const TOPICS_LISTED_MAX: usize = 4;
    let mut text = match topics {
        [] => "no topic".to_owned(),
        some if some.iter().any(|topic| topic.starts_with("/bus/")) => "none that is intact".to_owned(),
        some => format!(
            "only {}",
            some.iter()
                .take(TOPICS_LISTED_MAX)
                .map(String::as_str)
                .collect::<Vec<_>>()
                .join(", ")
        ),
    };
    if text.starts_with("only") && topics.len() > TOPICS_LISTED_MAX {
        text.push_str(&format!(" and {} more", topics.len() - TOPICS_LISTED_MAX));
    }
    if let Some(first) = first {
        text.push_str(&format!("; {first}"));
    }
    text
}
