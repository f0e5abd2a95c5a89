//! Logs of measured signals among the logs.

use std::io::BufReader;

use hmd_core::config::Config;
use hmd_core::frame::{BusNames, RawFrame};

use super::{Counted, IngestError, LogFormat, LogReader};
use crate::Loss;
use crate::asc::is_asc;
use crate::signals::{CsvLog, MappedFrames, PARQUET_MAGIC, ParquetLog, SignalLog, Unusable};
use crate::{blf, mdf};

/// A format of logs of measured signals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Csv,
    Parquet,
}

impl Format {
    /// Whether a pipe is not enough.
    pub(super) fn is_sought(self) -> bool {
        self == Self::Parquet
    }
}

/// The format of a file that begins so, if its content is measured signals.
pub(super) fn format(start: &[u8]) -> Option<Format> {
    if start.starts_with(PARQUET_MAGIC) {
        return Some(Format::Parquet);
    }
    let text = start.strip_prefix(super::BYTE_ORDER_MARK).unwrap_or(start);
    let is_other =
        start.contains(&0) || start.starts_with(blf::MAGIC) || mdf::MAGICS.iter().any(|of| start.starts_with(of));
    (!is_other && is_table(text) && !is_asc(text)).then_some(Format::Csv)
}

/// Names or values with separators between them, and no stamp of candump.
fn is_table(start: &[u8]) -> bool {
    let mut lines = start.split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii);
    let first = lines.find(|line| !line.is_empty() && line[0] != b'#');
    first.is_some_and(|line| line[0] != b'(' && line.iter().any(|byte| b",;\t".contains(byte)))
}

/// The frames of a log of measured signals.
pub(super) fn open(
    format: Format,
    input: BufReader<Counted>,
    file: &str,
    names: BusNames,
    config: Option<&Config>,
) -> Result<Box<dyn LogReader>, IngestError> {
    match format {
        Format::Csv => {
            let log = CsvLog::new(input, file).map_err(|cause| unusable(file, cause))?;
            mapped(Box::new(log), file, names, config, LogFormat::Csv)
        }
        Format::Parquet => {
            let log = ParquetLog::new(input.into_inner().file, file).map_err(|cause| unusable(file, cause))?;
            mapped(Box::new(log), file, names, config, LogFormat::Parquet)
        }
    }
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

    fn no_frame(&self, file: String, first: Option<Box<Loss>>) -> IngestError {
        IngestError::NoRow { file, first }
    }
}
