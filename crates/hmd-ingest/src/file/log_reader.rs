//! What the readers of all formats have in common.

use super::{IngestError, LogFormat};
use crate::Loss;
use crate::asc::AscReader;
use crate::blf::BlfReader;
use crate::candump::CandumpReader;
use crate::mdf::MdfReader;
use hmd_core::frame::{BusNames, RawFrame};
use hmd_storage::mcap::McapFrames;
use hmd_storage::mcap_writer::METADATA_NAME;
use std::collections::BTreeMap;
use std::fmt::Debug;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Reader of one format.
pub(super) trait LogReader: Debug {
    fn next_frame(&mut self) -> Option<Result<RawFrame, Loss>>;

    fn format(&self) -> LogFormat;

    fn bus_names(&self) -> &BusNames;

    fn into_bus_names(self: Box<Self>) -> BusNames;

    /// How far it was read, bytes; `None` where the bytes of its input are counted.
    fn position(&self) -> Option<u64> {
        None
    }

    /// A metadata record of an MCAP file.
    fn metadata(&self, _name: &str) -> Option<&BTreeMap<String, String>> {
        None
    }

    /// What an operator should know of what was read, a sentence each.
    fn remarks(&self) -> Vec<String> {
        Vec::new()
    }

    /// Whether a file without a frame is to be read all the same: it has marks of a run that other files go on with.
    fn has_marks(&self) -> bool {
        false
    }

    /// What to say of a file without a frame.
    fn no_frame(&self, file: String, first: Option<Box<Loss>>) -> IngestError;
}

impl LogReader for CandumpReader<BufReader<Counted>> {
    fn next_frame(&mut self) -> Option<Result<RawFrame, Loss>> {
        self.next().map(|item| item.map_err(Loss::from))
    }

    fn format(&self) -> LogFormat {
        LogFormat::Candump
    }

    fn bus_names(&self) -> &BusNames {
        self.bus_names()
    }

    fn into_bus_names(self: Box<Self>) -> BusNames {
        (*self).into_bus_names()
    }

    fn no_frame(&self, file: String, first: Option<Box<Loss>>) -> IngestError {
        let lines = self.lines();
        IngestError::NoGoodLine { file, lines, first }
    }
}

impl LogReader for McapFrames<File> {
    fn next_frame(&mut self) -> Option<Result<RawFrame, Loss>> {
        self.next().map(|item| item.map_err(Loss::from))
    }

    fn format(&self) -> LogFormat {
        LogFormat::Mcap
    }

    fn bus_names(&self) -> &BusNames {
        self.bus_names()
    }

    fn into_bus_names(self: Box<Self>) -> BusNames {
        (*self).into_bus_names()
    }

    fn position(&self) -> Option<u64> {
        Some(self.messages().position())
    }

    fn metadata(&self, name: &str) -> Option<&BTreeMap<String, String>> {
        self.messages().metadata(name)
    }

    fn has_marks(&self) -> bool {
        let kind = self.metadata(METADATA_NAME).and_then(|found| found.get("segment_kind"));
        kind.is_some_and(|kind| kind == "raw") && !self.messages().topics().is_empty()
    }

    fn no_frame(&self, file: String, first: Option<Box<Loss>>) -> IngestError {
        let topics = self.messages().topics();
        IngestError::NoFrames { file, topics, first }
    }
}

macro_rules! foreign_log {
    ($reader:ty, $format:expr, $name:literal $(, $position:expr)?) => {
        impl LogReader for $reader {
            fn next_frame(&mut self) -> Option<Result<RawFrame, Loss>> {
                self.next().map(|item| item.map_err(Loss::from))
            }

            fn format(&self) -> LogFormat {
                $format
            }

            fn bus_names(&self) -> &BusNames {
                self.bus_names()
            }

            fn into_bus_names(self: Box<Self>) -> BusNames {
                (*self).into_bus_names()
            }

            $(fn position(&self) -> Option<u64> {
                $position(self)
            })?

            fn no_frame(&self, file: String, first: Option<Box<Loss>>) -> IngestError {
                let format = $name;
                IngestError::NoForeignFrame { file, format, first }
            }
        }
    };
}

foreign_log!(AscReader<BufReader<Counted>>, LogFormat::Asc, "ASC");
foreign_log!(BlfReader<BufReader<Counted>>, LogFormat::Blf, "BLF");
foreign_log!(MdfReader<File>, LogFormat::Mdf, "MF4", |reader: &MdfReader<File>| Some(
    reader.position()
));

/// Counts the bytes read, for the progress bar; the reader on top owns it, so the count is shared.
#[derive(Debug)]
pub(super) struct Counted {
    pub(super) file: File,
    pub(super) position: Arc<AtomicU64>,
}

impl Read for Counted {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(buffer)?;
        self.position.fetch_add(read as u64, Ordering::Relaxed);
        Ok(read)
    }
}
