//! Simulated recordings: a log of a scenario's traffic, and beside it the truth, one line per window.
//!
//! Nothing that assesses a log reads its truth.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use ema_models::FAULT_COUNT;
use ema_models::reference::{Drive, Effects, Scenario, ScenarioRun};
use ema_wire::ActuatorId;
use hmd_core::frame::{BusError, BusNames, RawFrame};
use hmd_ingest::candump::{Decimals, emit};
use hmd_storage::mcap_writer::{McapWriteError, McapWriter, SyncedFile};
use hmd_storage::output_file::OutputFile;
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use thiserror::Error;

use crate::drive_traffic::{DriveLink, DriveTraffic};
use crate::simulate::{Traffic, traffic};

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

/// Whose frames a log has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sender {
    /// Those of the built-in dictionary.
    BuiltIn(ActuatorId),
    /// Those of a drive.
    Drive(ActuatorId, DriveLink),
}

/// Its frames.
enum Frames {
    BuiltIn(Box<Traffic<ScenarioRun>>),
    Drive(Box<DriveTraffic>),
}

impl Frames {
    fn diverged(&self) -> Option<f64> {
        match self {
            Self::BuiltIn(frames) => frames.diverged(),
            Self::Drive(frames) => frames.diverged(),
        }
    }
}

impl Iterator for Frames {
    type Item = RawFrame;

    fn next(&mut self) -> Option<RawFrame> {
        match self {
            Self::BuiltIn(frames) => frames.next(),
            Self::Drive(frames) => frames.next(),
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
    /// The simulated state left all numbers; the log ends there, without truth.
    #[error("{path}: expected a simulation with finite currents and angles, found one that diverges at {time_s} s")]
    Diverged {
        /// The log.
        path: String,
        /// Time in the scenario, s.
        time_s: f64,
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

/// Writes the log of a scenario, and its truth as `LOG.truth.jsonl` beside it. The truth names the drive where it is not that of
/// the type, or any effect is on.
///
/// # Errors
/// A file that cannot be written, or a simulation that diverges.
pub fn write(
    log: &Path,
    format: RecordingFormat,
    scenario: &Scenario,
    start_ns: u64,
    drive_of_type: &Drive,
    sender: Sender,
) -> Result<(), RecordingError> {
    let (actuator, mut frames) = match sender {
        Sender::BuiltIn(actuator) => (
            actuator,
            Frames::BuiltIn(Box::new(traffic(scenario, actuator, start_ns))),
        ),
        Sender::Drive(actuator, link) => (
            actuator,
            Frames::Drive(Box::new(DriveTraffic::new(scenario, link, start_ns))),
        ),
    };
    let begin = |path: &Path| {
        let begun = OutputFile::create(path).and_then(|output| Ok((output.handle()?, output)));
        begun.map_err(|e| io_error(path, e))
    };
    let (file, output) = begin(log)?;
    match format {
        RecordingFormat::Mcap => write_mcap(log, file, scenario.seed, &mut frames)?,
        RecordingFormat::Candump => write_candump(file, &mut frames).map_err(|e| io_error(log, e))?,
    }
    if let Some(time_s) = frames.diverged() {
        let path = log.display().to_string();
        return Err(RecordingError::Diverged { path, time_s });
    }
    let truth = truth_path(log);
    let (file, truth_output) = begin(&truth)?;
    write_truth(file, scenario, drive_of_type, actuator).map_err(|e| io_error(&truth, e))?;
    output.put_in_place().map_err(|e| io_error(log, e))?;
    truth_output.put_in_place().map_err(|e| io_error(&truth, e))
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

fn write_mcap(log: &Path, file: File, seed: u64, frames: impl Iterator<Item = RawFrame>) -> Result<(), RecordingError> {
    let mut names = BusNames::new();
    names.intern(INTERFACE)?;
    let metadata = [
        ("build", concat!("hmd ", env!("CARGO_PKG_VERSION")).to_owned()),
        ("clock_source", "simulated".to_owned()),
        ("seed", seed.to_string()),
    ];
    let metadata = metadata.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
    let failed = |cause| RecordingError::Mcap {
        path: log.display().to_string(),
        cause,
    };
    let mut writer = McapWriter::new(SyncedFile::new(file), &metadata).map_err(failed)?;
    for frame in frames {
        writer.write_frame(&frame, &names).map_err(failed)?;
    }
    writer.finish().map_err(failed)?;
    Ok(())
}

fn write_candump(file: File, frames: impl Iterator<Item = RawFrame>) -> io::Result<()> {
    let mut file = BufWriter::new(file);
    let mut line = Vec::new();
    for frame in frames {
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
    /// Kind of drive, where it is not that of the type or any effect is on.
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

fn write_truth(file: File, scenario: &Scenario, drive_of_type: &Drive, actuator: ActuatorId) -> io::Result<()> {
    let name = actuator.to_string();
    let effects = (!scenario.effects.are_off()).then_some(&scenario.effects);
    let drive = &scenario.effects.drive;
    let names_drive = effects.is_some() || drive.name() != drive_of_type.name();
    let mut file = BufWriter::new(file);
    for window in 0..scenario.actuations.count {
        let line = Truth {
            actuator: &name,
            window,
            k: scenario.fault.to_array(),
            drive: names_drive.then(|| drive.name()),
            effects: effects.map(Active),
        };
        writeln!(file, "{}", serde_json::to_string(&line)?)?;
    }
    file.flush()
}

#[cfg(test)]
mod tests {
    use ema_models::{ActuatorParams, FaultVector};

    use super::*;

    #[test]
    fn a_simulation_that_diverges_is_an_error_and_has_no_truth() {
        let folder = std::env::temp_dir();
        let mut scenario = Scenario::new(ActuatorParams::bench(), FaultVector::NOMINAL, 1);
        scenario.unit.motor.l_s = 1e-12;
        scenario.unit.motor.j = 1e-12;
        for (name, format) in [("a.log", RecordingFormat::Candump), ("a.mcap", RecordingFormat::Mcap)] {
            let log = folder.join(format!("diverges-{}-{name}", std::process::id()));
            let error = write(
                &log,
                format,
                &scenario,
                0,
                &Drive::Hysteresis,
                Sender::BuiltIn(ActuatorId::new(0).unwrap()),
            )
            .unwrap_err();
            assert!(matches!(error, RecordingError::Diverged { .. }), "{error}");
            assert!(!log.exists() && !truth_path(&log).exists());
        }
    }
}
