//! Simulated recordings: a log of a scenario's traffic, and beside it the truth, one line per window.
//!
//! Nothing that assesses a log reads its truth.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use ema_models::FAULT_COUNT;
use ema_models::reference::{Effects, Scenario};
use ema_wire::ActuatorId;
use hmd_core::frame::{BusError, BusNames};
use hmd_ingest::candump::{Decimals, emit};
use hmd_storage::mcap_writer::{McapWriteError, McapWriter, SyncedFile};
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use thiserror::Error;

use crate::simulate::{EPOCH_NS, traffic};

/// Name of the simulated interface.
const INTERFACE: &str = "can0";

/// Format of a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordingFormat {
    /// MCAP.
    Mcap,
    /// Candump text.
    Candump,
}

impl RecordingFormat {
    /// The format that a file's name stands for: `.mcap`, or `.log` for candump text.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()? {
            "mcap" => Some(Self::Mcap),
            "log" => Some(Self::Candump),
            _ => None,
        }
    }
}

/// Why a recording could not be written.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// The interface was refused.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// The file cannot be created or written.
    #[error("{path}: {cause}")]
    Io {
        /// The file.
        path: String,
        /// The error of the system.
        cause: io::Error,
    },
    /// The MCAP file cannot be written.
    #[error("{path}: {cause}")]
    Mcap {
        /// The file.
        path: String,
        /// Why.
        cause: McapWriteError,
    },
}

/// Writes the log of a scenario, and its truth as `LOG.truth.jsonl` beside it.
///
/// # Errors
/// A file that cannot be written.
pub fn write(
    log: &Path,
    format: RecordingFormat,
    scenario: &Scenario,
    actuator: ActuatorId,
) -> Result<(), RecordingError> {
    match format {
        RecordingFormat::Mcap => write_mcap(log, scenario, actuator)?,
        RecordingFormat::Candump => write_candump(log, scenario, actuator).map_err(|e| io_error(log, e))?,
    }
    let truth = truth_path(log);
    write_truth(&truth, scenario, actuator).map_err(|e| io_error(&truth, e))
}

/// `LOG.truth.jsonl` beside `LOG`.
#[must_use]
pub fn truth_path(log: &Path) -> PathBuf {
    let mut name = log.as_os_str().to_owned();
    name.push(".truth.jsonl");
    PathBuf::from(name)
}

fn io_error(path: &Path, cause: io::Error) -> RecordingError {
    let path = path.display().to_string();
    RecordingError::Io { path, cause }
}

fn write_mcap(log: &Path, scenario: &Scenario, actuator: ActuatorId) -> Result<(), RecordingError> {
    let mut names = BusNames::new();
    names.intern(INTERFACE)?;
    let metadata = [
        ("build", concat!("hmd ", env!("CARGO_PKG_VERSION")).to_owned()),
        ("clock_source", "simulated".to_owned()),
        ("seed", scenario.seed.to_string()),
    ];
    let metadata = metadata.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
    let failed = |cause| RecordingError::Mcap {
        path: log.display().to_string(),
        cause,
    };
    let file = SyncedFile::new(File::create(log).map_err(|e| io_error(log, e))?);
    let mut writer = McapWriter::new(file, &metadata).map_err(failed)?;
    for frame in traffic(scenario, actuator, EPOCH_NS) {
        writer.write_frame(&frame, &names).map_err(failed)?;
    }
    writer.finish().map_err(failed)?;
    Ok(())
}

fn write_candump(log: &Path, scenario: &Scenario, actuator: ActuatorId) -> io::Result<()> {
    let mut file = BufWriter::new(File::create(log)?);
    let mut line = Vec::new();
    for frame in traffic(scenario, actuator, EPOCH_NS) {
        line.clear();
        emit(&frame, INTERFACE, Decimals::Six, &mut line);
        file.write_all(&line)?;
    }
    file.flush()
}

/// One line of the truth file.
#[derive(Serialize)]
struct Truth<'a> {
    actuator: &'a str,
    window: u32,
    k: [f64; FAULT_COUNT],
    /// Kind of drive, where any effect is on.
    #[serde(skip_serializing_if = "Option::is_none")]
    drive: Option<&'static str>,
    /// Values of everything that is on, by name.
    #[serde(skip_serializing_if = "Option::is_none")]
    effects: Option<Active<'a>>,
}

/// Effects as a map from name to value.
struct Active<'a>(&'a Effects);

impl Serialize for Active<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for (name, value) in self.0.active() {
            map.serialize_entry(name, &value)?;
        }
        map.end()
    }
}

fn write_truth(path: &Path, scenario: &Scenario, actuator: ActuatorId) -> io::Result<()> {
    let name = actuator.to_string();
    let effects = (!scenario.effects.are_off()).then_some(&scenario.effects);
    let mut file = BufWriter::new(File::create(path)?);
    for window in 0..scenario.actuations.count {
        let line = Truth {
            actuator: &name,
            window,
            k: scenario.fault.to_array(),
            drive: effects.map(|effects| effects.drive.name()),
            effects: effects.map(Active),
        };
        writeln!(file, "{}", serde_json::to_string(&line)?)?;
    }
    file.flush()
}
