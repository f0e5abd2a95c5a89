//! This build reads no logs of measured signals.

use std::io::BufReader;

use hmd_core::config::Config;
use hmd_core::frame::BusNames;

use super::{Counted, IngestError, LogReader};

/// No format.
#[derive(Clone, Copy, Debug)]
pub(super) enum Format {}

impl Format {
    pub(super) fn is_sought(self) -> bool {
        match self {}
    }
}

/// None: a log of measured signals is a text or a file without frames here.
pub(super) fn format(_: &[u8]) -> Option<Format> {
    None
}

pub(super) fn open(
    format: Format,
    _: BufReader<Counted>,
    _: &str,
    _: BusNames,
    _: Option<&Config>,
) -> Result<Box<dyn LogReader>, IngestError> {
    match format {}
}
