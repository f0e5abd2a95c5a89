//! Healthy windows out of logs.

use std::path::PathBuf;
use std::sync::Arc;

use crate::config::Config;
use crate::frame::BusNames;
use crate::front::WindowJob;
use crate::ingest::{IngestError, open_with};
use crate::pipeline::Pipeline;

/// Why there are no windows to calibrate from.
#[derive(Debug, thiserror::Error)]
pub enum WindowsError {
    /// A log cannot be read.
    #[error(transparent)]
    Ingest(#[from] IngestError),
    /// No actuation fit to be judged.
    #[error("expected windows that can be judged, found none")]
    None,
    /// Windows of several actuators.
    #[error("expected the windows of one actuator, found {found}; choose one with --name")]
    Several {
        /// Their names.
        found: String,
    },
}

/// The windows of one actuator that can be judged, in the order of the logs; `name` chooses where there are several.
///
/// # Errors
/// [`WindowsError`] when a log cannot be read, there is no such window, or it is not clear whose they are.
pub fn windows_of(logs: &[PathBuf], config: &Arc<Config>, name: Option<&str>) -> Result<Vec<WindowJob>, WindowsError> {
    let mut names = BusNames::new();
    let mut found = Vec::new();
    for log in logs {
        let mut source = open_with(log, names)?;
        // Each log is a recording of its own: nothing is carried over.
        let mut pipeline = Pipeline::new(config.clone());
        while let Some(item) = source.next() {
            if let Ok(frame) = item {
                pipeline.push(&frame, source.bus_names(), &mut found);
            }
        }
        pipeline.finish(&mut found);
        names = source.into_bus_names();
    }
    found.retain(|job| job.window.verdict.is_fit() && name.is_none_or(|name| job.actuator.name == name));
    let mut actuators: Vec<&str> = found.iter().map(|job| job.actuator.name.as_str()).collect();
    actuators.sort_unstable();
    actuators.dedup();
    match actuators.len() {
        0 => Err(WindowsError::None),
        1 => Ok(found),
        _ => Err(WindowsError::Several {
            found: actuators.join(", "),
        }),
    }
}
