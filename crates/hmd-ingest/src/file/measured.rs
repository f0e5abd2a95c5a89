//! Logs of measured signals among the logs.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::sync::Arc;

use hmd_core::config::Config;
use hmd_core::frame::{BusNames, RawFrame};

use super::{Counted, IngestError, LogFormat, LogReader, START, open_log};
use crate::Loss;
use crate::asc::is_asc;
use crate::blf;
use crate::foreign::unread_format;
use crate::mdf::{self, MdfSignals};
use crate::signals::{CsvLog, MappedFrames, PARQUET_MAGIC, ParquetLog, SignalLog, Unusable};

/// A format of logs of measured signals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Csv,
    Parquet,
    Mdf,
}

impl Format {
    /// Whether a pipe is not enough.
    pub(super) fn is_sought(self) -> bool {
        self != Self::Csv
    }
}

/// The format of a file that begins so, if its content is measured signals.
pub(super) fn format(start: &[u8]) -> Option<Format> {
    if start.starts_with(PARQUET_MAGIC) {
        return Some(Format::Parquet);
    }
    if mdf::MAGICS.iter().any(|magic| start.starts_with(magic)) {
        return Some(Format::Mdf);
    }
    let text = start.strip_prefix(super::BYTE_ORDER_MARK).unwrap_or(start);
    let is_other = start.contains(&0) || start.starts_with(blf::MAGIC);
    (!is_other && is_table(text) && !is_asc(text)).then_some(Format::Csv)
}

/// Three names or values or more with one separator between them, as time and two signals are, behind words about the recording or not, and
/// no stamp of candump.
fn is_table(start: &[u8]) -> bool {
    let lines = start.split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii);
    let mut lines = lines.filter(|line| !line.is_empty() && line[0] != b'#').peekable();
    let separates = |line: &[u8], separator: u8| line.iter().filter(|&&byte| byte == separator).count() >= 2;
    lines.peek().is_some_and(|line| line[0] != b'(')
        && lines.any(|line| b",;\t".iter().any(|&separator| separates(line, separator)))
}

/// The frames of a log of measured signals.
pub(super) fn open(
    format: Format,
    input: BufReader<Counted>,
    file: &str,
    names: BusNames,
    config: Option<&Config>,
) -> Result<Box<dyn LogReader>, IngestError> {
    if format == Format::Mdf {
        let input = input.into_inner().file;
        let again = input
            .try_clone()
            .map_err(|error| unusable(file, Unusable::new("to read on", error)))?;
        let reader = super::open_mdf_frames(input, file, names.clone())?;
        if reader.has_frames() {
            return Ok(Box::new(reader));
        }
        let log = MdfSignals::new(again, file).map_err(|cause| unusable(file, cause))?;
        if log.signals().is_empty() {
            let (file, format, first) = (file.to_owned(), "MF4", None);
            return Err(IngestError::NoForeignFrame { file, format, first });
        }
        return mapped(Box::new(log), file, names, config, LogFormat::Mdf);
    }
    let log = signals_of(format, input, file).map_err(|cause| unusable(file, cause))?;
    let format = match format {
        Format::Csv => LogFormat::Csv,
        Format::Parquet => LogFormat::Parquet,
        Format::Mdf => LogFormat::Mdf,
    };
    mapped(log, file, names, config, format)
}

fn signals_of(format: Format, input: BufReader<Counted>, file: &str) -> Result<Box<dyn SignalLog>, Unusable> {
    Ok(match format {
        Format::Csv => Box::new(CsvLog::new(input, file)?),
        Format::Parquet => Box::new(ParquetLog::new(input.into_inner().file, file)?),
        Format::Mdf => Box::new(MdfSignals::new(input.into_inner().file, file)?),
    })
}

/// What a log of a bus has, and what makes samples of it.
const FRAMES: &str =
    "frames of a bus: [map] is not for them, but a DBC file (docs/dbc.md) or a drive's preset (docs/drives.md)";

/// Opens a log of measured signals to look into it.
///
/// # Errors
/// [`IngestError`] when it is none, or cannot be read.
pub fn open_signals(path: &Path) -> Result<Box<dyn SignalLog>, IngestError> {
    let file = path.display().to_string();
    let unreadable = |cause| IngestError::Unreadable {
        file: file.clone(),
        cause,
    };
    let opened = open_log(path).map_err(unreadable)?;
    let position = Arc::default();
    let mut input = BufReader::with_capacity(START, Counted { file: opened, position });
    let start = input.fill_buf().map_err(unreadable)?;
    if super::is_utf16(start) {
        return Err(IngestError::Utf16 { file });
    }
    let text = start.strip_prefix(super::BYTE_ORDER_MARK).unwrap_or(start);
    if let Some(format) = unread_format(text) {
        return Err(IngestError::Foreign { file, format });
    }
    let other = |found: &str| unusable(&file, Unusable::new("measured signals (CSV, Parquet, MF4)", found));
    let Some(found) = format(start) else {
        let is_frames =
            start.starts_with(mcap::MAGIC) || start.starts_with(blf::MAGIC) || is_asc(text) || text.starts_with(b"(");
        return Err(other(if is_frames { FRAMES } else { "another format" }));
    };
    if found == Format::Mdf {
        let again = input.get_ref().file.try_clone().map_err(unreadable)?;
        if super::open_mdf_frames(again, &file, BusNames::new())?.has_frames() {
            return Err(other(FRAMES));
        }
    }
    let log = signals_of(found, input, &file);
    let log = log.and_then(|log| match log.signals() {
        [] => Err(Unusable::new("measured signals", "none")),
        _ => Ok(log),
    });
    log.map_err(|cause| unusable(&file, cause))
}

/// The frames of a log by the map of a configuration.
fn mapped(
    log: Box<dyn SignalLog>,
    file: &str,
    names: BusNames,
    config: Option<&Config>,
    format: LogFormat,
) -> Result<Box<dyn LogReader>, IngestError> {
    let Some((actuator, map)) = config.and_then(Config::actuator_of_logs) else {
        return Err(IngestError::NoMap { file: file.to_owned() });
    };
    let frames = MappedFrames::new(log, file, actuator, map, names).map_err(|cause| unusable(file, cause))?;
    Ok(Box::new(Measured { frames, format }))
}

fn unusable(file: &str, cause: Unusable) -> IngestError {
    let (file, cause) = (file.to_owned(), cause.to_string());
    IngestError::Unusable { file, cause }
}

/// A mapped log and its format.
#[derive(Debug)]
struct Measured {
    frames: MappedFrames,
    format: LogFormat,
}

impl LogReader for Measured {
    fn next_frame(&mut self) -> Option<Result<RawFrame, Loss>> {
        self.frames.next().map(|item| item.map_err(Loss::from))
    }

    fn format(&self) -> LogFormat {
        self.format
    }

    fn bus_names(&self) -> &BusNames {
        self.frames.bus_names()
    }

    fn into_bus_names(self: Box<Self>) -> BusNames {
        self.frames.into_bus_names()
    }

    fn position(&self) -> Option<u64> {
        self.frames.position()
    }

    fn remarks(&self) -> Vec<String> {
        self.frames.remarks()
    }

    fn no_frame(&self, file: String, first: Option<Box<Loss>>) -> IngestError {
        IngestError::NoRow { file, first }
    }
}
