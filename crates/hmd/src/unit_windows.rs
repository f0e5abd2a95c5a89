//! Windows of one unit out of logs, and what was lost in the logs.

use std::path::PathBuf;
use std::sync::Arc;

use hmd_core::assess::WindowCounts;
use hmd_core::config::Config;
use hmd_core::demux::WindowJob;
use hmd_core::frame::BusNames;
use hmd_core::pipeline::Pipeline;
use hmd_ingest::file::{IngestError, open_with};

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
}

/// Windows out of logs.
#[derive(Debug, Default)]
pub struct UnitWindows {
    /// Those of one actuator that can be judged, in the order of the logs.
    pub jobs: Vec<WindowJob>,
    /// Whether the logs held more than could be read, as a replay of them would say.
    pub data_lost: bool,
}

/// The windows of one actuator that can be judged; `name` chooses where there are several. `tell` gets what an operator
/// should read: each loss with its place, and for each log that has any a sentence about all of them.
///
/// # Errors
/// [`WindowsError`] when a log cannot be read at all, or it is not clear whose windows are meant.
pub fn windows_of(
    logs: &[PathBuf],
    config: &Arc<Config>,
    name: Option<&str>,
    tell: &mut dyn FnMut(&str),
) -> Result<UnitWindows, WindowsError> {
    let mut names = BusNames::new();
    let mut found = UnitWindows::default();
    for log in logs {
        let mut source = open_with(log, names)?;
        // Each log is a recording of its own: nothing is carried over.
        let mut pipeline = Pipeline::new(config.clone());
        let mut damaged_places = 0;
        while let Some(item) = source.next() {
            match item {
                Ok(frame) => pipeline.push(&frame, source.bus_names(), &mut found.jobs),
                Err(loss) => {
                    damaged_places += loss.count_into(&mut pipeline.losses);
                    tell(&loss.to_string());
                }
            }
            for notice in pipeline.take_notices() {
                tell(&notice.message);
            }
        }
        pipeline.finish(&mut found.jobs);
        names = source.into_bus_names();
        let status = pipeline.status(&names, WindowCounts::default());
        if let Some(lost) = status.lost_in_logs(damaged_places) {
            found.data_lost = true;
            tell(&format!("{}: {lost}", log.display()));
        }
    }
    let is_meant = |job: &WindowJob| name.is_none_or(|name| job.actuator.name == name);
    found.jobs.retain(|job| job.window.verdict.is_fit() && is_meant(job));
    let mut actuators: Vec<&str> = found.jobs.iter().map(|job| job.actuator.name.as_str()).collect();
    actuators.sort_unstable();
    actuators.dedup();
    if actuators.len() > 1 {
        let found = actuators.join(", ");
        return Err(WindowsError::Several { found });
    }
    Ok(found)
}
