//! The daemon without its threads and sources.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::capture::Capture;
use super::host_clock::HostClock;
use super::identification::Identification;
use super::keep_requests::KeepRequests;
use super::notices::Notices;
use super::pipeline_thread::PipelineThread;
use super::publishing::{publish, publish_last_summaries};
use super::{DaemonError, Observer, Shared, TICK, WindowQueue};
use hmd_core::assess::{Estimator, WindowCounts};
use hmd_core::config::Config;
use hmd_core::frame::BusNames;
use hmd_core::outbox::Notice;
use hmd_core::pipeline::Pipeline;
use hmd_core::record::{LogLevel, Status};
use hmd_ingest::feed::Input;
use hmd_storage::recorder::Recorder;

/// What the threads of a [`Daemon`](super::Daemon) do, one step after another: for a simulation, in which everything happens in a
/// known order.
pub struct Steps<'a, C, O> {
    pub(super) shared: Mutex<Shared>,
    pub(super) windows: WindowQueue,
    pub(super) pipeline: PipelineThread<'a, C>,
    pub(super) identification: Option<Identification<'a, C>>,
    clock: &'a C,
    observer: &'a O,
}

impl<'a, C: HostClock, O: Observer> Steps<'a, C, O> {
    /// Without any input yet; `watch` is what is watched, with the seed of every search.
    ///
    /// # Errors
    /// The configuration names files that cannot be used.
    pub fn new(
        names: BusNames,
        recorder: Option<Recorder>,
        watch: Option<(Arc<Config>, u64)>,
        estimator: Arc<dyn Estimator>,
        clock: &'a C,
        observer: &'a O,
    ) -> Result<Self, DaemonError> {
        let pipeline = match &watch {
            Some((config, _)) => Pipeline::new(config.clone()),
            None => Pipeline::capture(),
        };
        let store_raw = watch.as_ref().is_none_or(|(config, _)| config.output().raw_frames);
        let config = watch.as_ref().map(|(config, _)| config.clone());
        let is_folder = recorder.as_ref().is_some_and(|recorder| recorder.folder().is_some());
        let capture = config
            .as_ref()
            .filter(|_| is_folder)
            .and_then(|config| Capture::of(config, clock.utc_ns()));
        let folder = recorder
            .as_ref()
            .and_then(Recorder::folder)
            .filter(|_| capture.is_some());
        let keep_requests = match (&config, folder) {
            (Some(config), Some(folder)) => KeepRequests::of(config, folder, clock.utc_ns()),
            _ => KeepRequests::default(),
        };
        let mut identification = watch
            .map(|(config, seed)| Identification::new(config, seed, estimator, clock))
            .transpose()?;
        let health_tracker = identification
            .as_mut()
            .map(|identification| identification.resumed_health(observer))
            .unwrap_or_default();
        Ok(Self {
            shared: Mutex::new(Shared {
                recorder,
                names: names.clone(),
                capture,
                lost_captures: 0,
                windows: WindowCounts::default(),
                assessing: (Duration::ZERO, Duration::ZERO),
                last_record: None,
                health_changed: false,
                health_tracker,
                notices: Notices::default(),
            }),
            windows: WindowQueue::new(),
            pipeline: PipelineThread::new(pipeline, names, store_raw, config, keep_requests, clock),
            identification,
            clock,
            observer,
        })
    }

    /// Takes inputs, as the pipeline thread does.
    ///
    /// # Errors
    /// As [`Daemon::run`](super::Daemon::run).
    pub fn take(&mut self, inputs: &mut Vec<Input>) -> Result<(), DaemonError> {
        let now = self.clock.now();
        self.pipeline
            .take(inputs, now, &self.windows, &self.shared, self.observer)
    }

    /// Assesses the oldest window that waits, as the identification thread does. Whether there was one.
    ///
    /// # Errors
    /// As [`Daemon::run`](super::Daemon::run).
    pub fn assess(&mut self) -> Result<bool, DaemonError> {
        self.assess_together(1)
    }

    /// Assesses the oldest windows that wait, of different actuators, at most so many; the identification thread takes [`windows_together`](super::windows_together).
    /// Whether there was one.
    ///
    /// # Errors
    /// As [`Daemon::run`](super::Daemon::run).
    pub fn assess_together(&mut self, at_most: usize) -> Result<bool, DaemonError> {
        let Some(identification) = self.identification.as_mut().filter(|_| self.windows.len() > 0) else {
            return Ok(false);
        };
        identification.assess_next(at_most, &self.windows, &self.shared, self.observer)
    }

    /// The counters as they stand.
    #[must_use]
    pub fn status(&self) -> Status {
        self.pipeline.status(&super::lock(&self.shared))
    }

    /// Ends the open windows, assesses those that wait for a time, and ends the output.
    ///
    /// # Errors
    /// As [`Daemon::run`](super::Daemon::run).
    pub fn finish(mut self, within: Duration) -> Result<Status, DaemonError> {
        let watched = self.pipeline.finish(within, &self.windows, &self.shared, self.observer);
        let assessed = self.assess_last();
        self.windows.close();
        self.end(watched, assessed)
    }

    /// Assesses what waits until the run is over, with a tick each second.
    fn assess_last(&mut self) -> Result<(), DaemonError> {
        let mut ticked = self.clock.now();
        while !self.windows.is_over(self.clock.now()) && self.assess()? {
            if self.clock.now() >= ticked + TICK {
                ticked = self.clock.now();
                self.pipeline.tick_ending(&self.windows, &self.shared, self.observer)?;
            }
        }
        Ok(())
    }

    /// Ends the output after both threads.
    pub(super) fn end(
        mut self,
        watched: Result<(), DaemonError>,
        assessed: Result<(), DaemonError>,
    ) -> Result<Status, DaemonError> {
        let mut shared = self.shared.into_inner().unwrap_or_else(PoisonError::into_inner);
        let mut pipeline = self.pipeline;
        let dropped = pipeline.drop_waiting(&self.windows, &mut shared, self.observer);
        let counted = match &mut self.identification {
            Some(identification) if assessed.is_ok() => identification.end_run(&pipeline.run_ends()),
            _ => Ok(Vec::new()),
        };
        let counted = counted.and_then(|notices| {
            let stamp_ns = self.clock.utc_ns();
            let publish = |message| {
                publish(
                    &Notice { stamp_ns, message },
                    LogLevel::Warning,
                    &mut shared,
                    self.observer,
                )
            };
            notices.into_iter().try_for_each(publish)
        });
        let published = publish_last_summaries(self.clock.utc_ns(), &mut shared, self.observer);
        let mut status = pipeline.status(&shared);
        let is_counted = counted.is_ok() && assessed.is_ok() && self.identification.is_some();
        let written = shared.recorder.map_or(Ok(None), |mut recorder| {
            if is_counted {
                recorder.note_end(self.clock.utc_ns());
            }
            recorder.write_status(self.clock.utc_ns(), &status)?;
            recorder.finish()
        });
        // The file is ended whatever went wrong before; the first error is returned.
        let ended = assessed.and(watched).and(dropped).and(counted).and(published);
        let written = ended.and_then(|()| Ok(written?));
        if let Err(DaemonError::Record(_)) = written {
            self.observer.failed(&status);
        }
        if let Some(store) = written? {
            status.set_storage(&store.status);
            for (level, message) in store.messages {
                self.observer.notice_with_level(level, &message);
            }
        }
        self.observer.status(&status);
        Ok(status)
    }
}
