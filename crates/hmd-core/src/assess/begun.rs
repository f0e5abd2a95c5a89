//! A window between the beginning of its assessment and its records.

use super::LearningProgress;
use super::explained::Explained;
use crate::outbox::WindowJob;
use crate::sensor_checks::SensorReadings;

/// A window whose assessment has begun.
#[derive(Debug)]
pub struct BegunWindow {
    pub(super) job: WindowJob,
    pub(super) progress: LearningProgress,
}

/// A window with what explains it.
#[derive(Debug)]
pub struct ExplainedWindow {
    /// As the explanation left it.
    pub(super) begun: BegunWindow,
    pub(super) readings: SensorReadings,
    pub(super) explained: Explained,
}

impl BegunWindow {
    pub(super) fn is_learning(&self) -> bool {
        matches!(self.progress, LearningProgress::Learns(_))
    }
}

impl ExplainedWindow {
    /// The window, as its explanation left it.
    pub(crate) fn into_job(self) -> WindowJob {
        self.begun.job
    }
}
