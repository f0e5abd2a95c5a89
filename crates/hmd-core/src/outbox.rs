//! What leaves the streams of all actuators: ended windows, notices for an operator and, on request, every sample.
//!
//! The streams append to one [`Outbox`]; the caller who pushes frames empties it. Taking from an empty outbox allocates nothing.

use std::sync::Arc;

use ema_models::ActuatorParams;

use crate::config::ActuatorConfig;
use crate::sample::{MeasuredConditions, SampleRate};
use crate::window::{TimedSample, Window};

/// One window and the actuator it belongs to.
#[derive(Clone, Debug)]
pub struct WindowJob {
    /// The actuator.
    pub actuator: Arc<ActuatorConfig>,
    /// Its parameters, with the sample rate of the window.
    pub params: ActuatorParams,
    /// The samples and their defects.
    pub window: Window,
    /// Conditions as last reported when the window ended.
    pub conditions: MeasuredConditions,
    /// Time that the actuator has been operating, with a mode other than idle, since its first frame; s. Missing samples
    /// do not count.
    pub operating_s: f64,
}

impl WindowJob {
    /// Time from the first sample to the one after the last, s.
    #[must_use]
    pub fn length_s(&self) -> f64 {
        self.window.samples.len() as f64 / self.params.sensors.sample_rate
    }
}

/// One sample, assembled from its frames.
#[derive(Clone, Debug)]
pub struct AssembledSample {
    /// The actuator.
    pub actuator: Arc<ActuatorConfig>,
    /// Rate of its samples.
    pub rate: SampleRate,
    /// The sample.
    pub sample: TimedSample,
    /// Conditions as last reported.
    pub conditions: MeasuredConditions,
}

/// Something an operator should read; goes into the log topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Notice {
    /// Stamp of the frame that led to it, ns.
    pub stamp_ns: u64,
    /// One sentence.
    pub message: String,
}

/// Output of the streams, in the order in which the frames caused it. The owner bounds it by emptying it.
#[derive(Debug, Default)]
pub struct Outbox {
    windows: Vec<WindowJob>,
    notices: Vec<Notice>,
    /// Samples, if they are collected.
    samples: Option<Vec<AssembledSample>>,
}

impl Outbox {
    /// An outbox that collects every sample as well, until [`Outbox::take_samples`].
    #[must_use]
    pub fn collecting_samples() -> Self {
        Self {
            samples: Some(Vec::new()),
            ..Self::default()
        }
    }

    /// Windows ended since the last call.
    pub fn take_windows(&mut self) -> Vec<WindowJob> {
        std::mem::take(&mut self.windows)
    }

    /// Notices since the last call.
    pub fn take_notices(&mut self) -> Vec<Notice> {
        std::mem::take(&mut self.notices)
    }

    /// Samples since the last call; none unless they are collected.
    pub fn take_samples(&mut self) -> Vec<AssembledSample> {
        self.samples.as_mut().map(std::mem::take).unwrap_or_default()
    }

    pub(crate) fn push_window(&mut self, job: WindowJob) {
        self.windows.push(job);
    }

    pub(crate) fn push_notice(&mut self, stamp_ns: u64, message: String) {
        self.notices.push(Notice { stamp_ns, message });
    }

    pub(crate) fn push_sample(&mut self, sample: impl FnOnce() -> AssembledSample) {
        if let Some(samples) = &mut self.samples {
            samples.push(sample());
        }
    }
}
