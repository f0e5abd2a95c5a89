//! Windows of one unit out of logs, and what was lost in the logs.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

use crate::replay::{LOSSES_TOLD, other_frames, watched};
use hmd_core::assess::WindowCounts;
use hmd_core::config::Config;
use hmd_core::counted::counted;
use hmd_core::frame::BusNames;
use hmd_core::outbox::WindowJob;
use hmd_core::pipeline::Pipeline;
use hmd_ingest::file::{IngestError, open_mapped};

/// Why there are no windows to calibrate from.
#[derive(Debug, thiserror::Error)]
pub enum WindowsError {
    /// A log cannot be read.
    #[error(transparent)]
    Ingest(#[from] IngestError),
    /// Windows of several actuators.
    #[error("expected the windows of one actuator, found {found}; choose one with --name")]
    Several {
        /// Their names.
        found: String,
    },
    /// No unit of the name asked for.
    #[error("--name: expected one of {known}, found {found:?}")]
    Name {
        /// The units of which the logs have windows.
        known: String,
        /// What was asked for.
        found: String,
    },
}

/// Windows out of logs.
#[derive(Debug, Default)]
pub struct UnitWindows {
    /// Those of one actuator that can be assessed, in the order of the logs.
    pub jobs: Vec<WindowJob>,
    /// Those that cannot.
    pub left_out: Vec<WindowJob>,
    /// Whether the logs held more than could be read, as a replay of them would say.
    pub data_lost: bool,
}

/// The windows of one actuator that can be assessed; `name` chooses where there are several. `report` gets the notices for
/// an operator: each loss with its place, and for each log that has any a sentence about all of them.
///
/// # Errors
/// [`WindowsError`] when a log cannot be read at all, or it is not clear whose windows are meant.
pub fn windows_of(
    logs: &[PathBuf],
    config: &Arc<Config>,
    name: Option<&str>,
    report: &mut dyn FnMut(&str),
) -> Result<UnitWindows, WindowsError> {
    let mut names = BusNames::new();
    let mut found = UnitWindows::default();
    // What all logs of a unit have, as another sampling rate than its type, is said once.
    let mut notices_told = BTreeSet::new();
    let mut tell_once = |notice: String, report: &mut dyn FnMut(&str)| {
        if !notices_told.contains(&notice) {
            report(&notice);
            notices_told.insert(notice);
        }
    };
    for log in logs {
        let mut source = open_mapped(log, names, config)?;
        // Each log is a recording of its own: nothing is carried over.
        let mut pipeline = Pipeline::new(config.clone());
        let (mut damaged_places, mut losses) = (0, 0_u64);
        while let Some(item) = source.next() {
            match item {
                Ok(frame) => pipeline.push(&frame, source.bus_names()),
                Err(loss) => {
                    damaged_places += loss.count_into(&mut pipeline.losses);
                    losses += 1;
                    if losses <= LOSSES_TOLD {
                        report(&loss.to_string());
                    }
                }
            }
            for notice in pipeline.take_notices() {
                tell_once(notice.message, report);
            }
        }
        if losses > LOSSES_TOLD {
            let untold = losses - LOSSES_TOLD;
            report(&format!(
                "{}: data lost at {}",
                log.display(),
                counted(untold, "more place", "more places")
            ));
        }
        for remark in source.remarks() {
            report(&remark);
        }
        pipeline.finish();
        for notice in pipeline.take_notices() {
            tell_once(notice.message, report);
        }
        found.jobs.extend(pipeline.take_windows());
        names = source.into_bus_names();
        let status = pipeline.status(&names, WindowCounts::default());
        if pipeline.actuators() == 0 {
            let talkers = pipeline.talkers().map(|(_, talker)| talker);
            let (expected, others) = (watched(config), other_frames(&status, talkers));
            report(&format!(
                "{}: expected frames of {expected}, found none ({others})",
                log.display()
            ));
        }
        if let Some(lost) = status.lost_in_logs(damaged_places) {
            found.data_lost = true;
            report(&format!("{}: {lost}", log.display()));
        }
    }
    if let Some(name) = name {
        let known: BTreeSet<&str> = found.jobs.iter().map(|job| job.actuator.name.as_str()).collect();
        if !known.is_empty() && !known.contains(name) {
            return Err(WindowsError::Name {
                known: known.into_iter().collect::<Vec<_>>().join(", "),
                found: name.to_owned(),
            });
        }
        found.jobs.retain(|job| job.actuator.name == name);
    }
    let (fit, left_out): (Vec<_>, Vec<_>) = std::mem::take(&mut found.jobs)
        .into_iter()
        .partition(|job| job.window.quality.is_fit());
    (found.jobs, found.left_out) = (fit, left_out);
    let mut actuators: Vec<&str> = found.jobs.iter().map(|job| job.actuator.name.as_str()).collect();
    actuators.sort_unstable();
    actuators.dedup();
    if actuators.len() > 1 {
        let found = actuators.join(", ");
        return Err(WindowsError::Several { found });
    }
    Ok(found)
}
